"""Friction of a plane that slides over the ground.

MuJoCo solves contact as a convex problem (Todorov, ICRA 2014). With friction it lets a sliding contact rise: like every
convex relaxation of Coulomb's law (Anitescu, Math. Program. 105, 2006) it asks for a normal speed of up to mu times the
sliding speed. At 0.4 m/s that is nothing; a plane that touched down at 13 m/s with a sink rate of 1.1 m/s left the
ground with 1.4 m/s. So as long as a plane slides, its contacts are solved without friction, and Coulomb's is added
explicitly:

    F_i = -mu N_i t_i,   t_i = v_i / |v_i|,   v_i = v + w x r_i across the normal of contact i
    dv/dt += sum F_i / m,   dw/dt += I^-1 R^T sum r_i x F_i

N_i is the normal force of the same sub-step. F_i is at most what stops the point in one sub-step,
|v_i| / (h (1 / m + r_i^2 / I_least)). MuJoCo's friction, which can hold, acts where neither the body nor its farthest
point moves faster than 0.5 m/s.

Only + - * / and sqrt, in a fixed order.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import applied, applied_back, cross, dot, matrix_of, norm
from signals.samples import Vec3
from sim.physics.vehicle import Vehicle
from sim.scene.world import VEHICLE

SLIDING_MPS = 0.5
_NO_FRICTION = 1e-5  # MuJoCo's least


class SlidingContact:
    """Contact of one vehicle, alone in its model, with the ground that it slides over."""

    def __init__(self, vehicle: Vehicle, model: mujoco.MjModel, data: mujoco.MjData, *, friction: float) -> None:
        self._model, self._data = model, data
        # Of each geom. MuJoCo takes the greater one of two, and so does `_rub`.
        self._friction = np.full(model.ngeom, friction)
        for sphere in vehicle.contact_spheres:
            self._friction[model.geom(f"{VEHICLE}_{sphere.name}").id] = sphere.friction_on(friction)
        self._of_geom: list[float] = self._friction.tolist()
        self._mass_kg = vehicle.mass_kg
        inverse = np.linalg.inv(vehicle.inertia_tensor_kgm2)
        self._inverse: list[list[float]] = inverse.tolist()
        self._most_turn = float(np.trace(inverse))  # at least the greatest of 1 / I
        self._sliding = False
        model.geom_friction[:, 0] = self._friction

    def forward(self, state: NDArray[np.float64], radius_m: float, step_s: float) -> None:
        """Compute the accelerations of a sub-step at `state`, with friction as the motion asks."""
        v: Vec3 = tuple(state[7:10].tolist())
        w: Vec3 = tuple(state[10:13].tolist())
        self._set(norm(v) + radius_m * norm(w) > SLIDING_MPS)
        mujoco.mj_forward(self._model, self._data)
        if self._sliding and self._data.ncon:
            self._rub(state, v, w, step_s)

    def _set(self, sliding: bool) -> None:
        if sliding != self._sliding:
            self._sliding = sliding
            self._model.geom_friction[:, 0] = _NO_FRICTION if sliding else self._friction

    def _rub(self, state: NDArray[np.float64], v: Vec3, w_B: Vec3, step_s: float) -> None:
        data = self._data
        px, py, pz, *q = state[:7].tolist()
        R = matrix_of(q)
        w = applied(R, w_B)
        force, torque = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        for contact in data.contact:
            first = int(contact.efc_address)
            if first < 0:
                continue
            normal_n = float(data.efc_force[first])
            x, y, z = contact.pos.tolist()
            r = (x - px, y - py, z - pz)
            spin, n = cross(w, r), contact.frame[:3].tolist()
            u = [v[j] + spin[j] for j in range(3)]
            through = dot(u, n)
            across = [u[j] - through * n[j] for j in range(3)]
            speed = math.sqrt(dot(across, across))
            if not speed > 0.0:
                continue
            most_n = speed / (step_s * (1.0 / self._mass_kg + dot(r, r) * self._most_turn))
            friction = max(self._of_geom[contact.geom1], self._of_geom[contact.geom2])
            scale = -min(friction * normal_n, most_n) / speed
            f = (scale * across[0], scale * across[1], scale * across[2])
            about = cross(r, f)
            for j in range(3):
                force[j] += f[j]
                torque[j] += about[j]
        turned = applied_back(R, torque)
        rows = self._inverse
        for j in range(3):
            data.qacc[j] += force[j] / self._mass_kg
            data.qacc[3 + j] += dot(rows[j], turned)
