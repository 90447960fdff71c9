"""Two rigid bodies in space, each with one frictionless sphere that can touch the other's: a slow reference.

The soft contact of sim.physics.contact_model as a differential equation, stated here again and integrated by the
classical Runge-Kutta method with tiny steps. With the distance r of the spheres (below 0 they overlap), its rate v
along the normal, its acceleration a0 without contact, and J M^-1 J^T = A the inverse mass along the normal:

    f = max(0, (-b v - k d r - a0) / (A + (1 - d) / d (1 / m_1 + 1 / m_2))),  b = 2 / (0.99 T),  k = (1 / (0.99 T))^2
    d = 0.9 + 0.09 y(|r| / 1 mm),   y(x) = 2 x^2, from x = 1/2 on 1 - 2 (1 - x)^2, from x = 1 on 1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A rigid body with a sphere; `state`: p, q (w-x-y-z), v in W, w in B."""

    mass_kg: float
    inertia_kgm2: Float64
    sphere_B_m: Float64
    radius_m: float
    state: Float64


def collide(bodies: tuple[Body, Body], *, time_constant_s: float, seconds: float, step_s: float) -> Float64:
    """Return both states (2, 13) after `seconds`."""
    s = np.array([body.state for body in bodies])
    for _ in range(round(seconds / step_s)):
        k1 = _rates(bodies, s, time_constant_s)
        k2 = _rates(bodies, s + 0.5 * step_s * k1, time_constant_s)
        k3 = _rates(bodies, s + 0.5 * step_s * k2, time_constant_s)
        k4 = _rates(bodies, s + step_s * k3, time_constant_s)
        s = s + step_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        s[:, 3:7] /= np.linalg.norm(s[:, 3:7], axis=1, keepdims=True)
    return s


def _rates(bodies: tuple[Body, Body], s: Float64, time_constant_s: float) -> Float64:
    turns = [_matrix(state[3:7]) for state in s]
    centres = [state[:3] + turn @ body.sphere_B_m for body, state, turn in zip(bodies, s, turns, strict=True)]
    gap = centres[1] - centres[0]
    length = float(np.linalg.norm(gap))
    normal, r = gap / length, length - bodies[0].radius_m - bodies[1].radius_m
    forces, torques = np.zeros((2, 3)), np.zeros((2, 3))
    if r < 0.0:
        point = centres[0] + normal * (bodies[0].radius_m + 0.5 * r)
        arms = [turn.T @ np.cross(point - state[:3], normal) for state, turn in zip(s, turns, strict=True)]
        force = _normal_force(bodies, s, normal, arms, r, time_constant_s)
        for index, sign in enumerate((-1.0, 1.0)):
            forces[index], torques[index] = sign * force * normal, sign * force * arms[index]
    rates = np.zeros((2, 13))
    for index, (body, state) in enumerate(zip(bodies, s, strict=True)):
        w, inertia = state[10:13], body.inertia_kgm2
        rates[index, :3] = state[7:10]
        rates[index, 3:7] = 0.5 * _product(state[3:7], w)
        rates[index, 7:10] = forces[index] / body.mass_kg
        rates[index, 10:13] = (torques[index] - np.cross(w, inertia * w)) / inertia
    return rates


def _normal_force(
    bodies: tuple[Body, Body], s: Float64, normal: Float64, arms: list[Float64], r: float, time_constant_s: float
) -> float:
    speed = float(normal @ (s[1, 7:10] - s[0, 7:10]) + arms[1] @ s[1, 10:13] - arms[0] @ s[0, 10:13])
    free, inverse = 0.0, 0.0
    for body, state, arm, sign in zip(bodies, s, arms, (-1.0, 1.0), strict=True):
        w = state[10:13]
        free += sign * float(arm @ (-np.cross(w, body.inertia_kgm2 * w) / body.inertia_kgm2))
        inverse += 1.0 / body.mass_kg + float(arm @ (arm / body.inertia_kgm2))
    x = min(1.0, -r / 1e-3)
    d = 0.9 + 0.09 * (2.0 * x * x if x < 0.5 else 1.0 - 2.0 * (1.0 - x) ** 2)
    wanted = -2.0 / (0.99 * time_constant_s) * speed - (1.0 / (0.99 * time_constant_s)) ** 2 * d * r
    soft = (1.0 - d) / d * (1.0 / bodies[0].mass_kg + 1.0 / bodies[1].mass_kg)
    return max(0.0, (wanted - free) / (inverse + soft))


def _matrix(q: Float64) -> Float64:
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _product(q: Float64, w: Float64) -> Float64:
    scalar, vector = q[0], q[1:]
    return np.array([-vector @ w, *(scalar * w + np.cross(vector, w))])
