"""Actors in the vehicle's contact model: posed while they are near the vehicle, parked out of the way otherwise.

Actor i lies within the sphere (c_i(t), r_i(t)), the vehicle within R of p. No actor is touched in a tick in which the
vehicle travels less than

    gap = min_i |p - c_i(t)| - r_i(t) - R - margin

The path with contact is not known beforehand, so the margin is the distance that a vehicle at the model's speed limit
travels in a tick. A gap found at one tick also serves later ticks: each tick subtracts the vehicle's travel and the
farthest that an actor can have approached, max_speed_mps * tick (the speed of sphere centres; radii do not change).

During a tick actors are static, posed as at its end; contact treats them as being at rest.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from signals.time import NS_PER_S
from sim.scene.scene_map import Actor
from sim.scene.world import World

Float64 = NDArray[np.float64]
_SPEED_LIMIT_MPS = 200.0  # limit of the vehicle's model
_PARKING_M = (10.0, 0.0, -1.0e4)  # body i is parked at (10 i, 0, -10000): MuJoCo sorts bodies along a line
_SLACK_M = 1e-5


class Actors:
    """Actors of a world in the contact model of one flight."""

    def __init__(
        self, world: World, model: mujoco.MjModel, data: mujoco.MjData, *, radius_m: float, tick_ns: int
    ) -> None:
        self._actors = world.map.actors
        self._position, self._quaternion = data.mocap_pos, data.mocap_quat
        self._parked = np.array([(_PARKING_M[0] * row, *_PARKING_M[1:]) for row in range(model.nmocap)]).reshape(-1, 3)
        self._rows: list[NDArray[np.int64]] = []
        self._poses: list[tuple[NDArray[np.int64], Float64, Float64, Float64, Float64]] = []
        for actor in self._actors:
            bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in actor.bodies]
            solid = [i for i, body in enumerate(bodies) if body >= 0]  # the other bodies have no solid geom
            rows = np.array([model.body_mocapid[bodies[i]] for i in solid], np.int64)
            self._rows.append(rows)
            n = len(bodies)
            pose = (np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3)))
            self._poses.append((np.array(solid, np.int64), *pose))
        self._is_near = [True] * len(self._actors)
        self._is_parked = [False] * len(self._actors)
        # Actors that rest: their bounds change in `changed` alone.
        self._still = [index for index, actor in enumerate(self._actors) if actor.max_speed_mps == 0.0]
        self._moving = [index for index, actor in enumerate(self._actors) if actor.max_speed_mps != 0.0]
        self._still_row = {id(self._actors[index]): row for row, index in enumerate(self._still)}
        self._still_bound: Float64 | None = None  # centre and radius of each
        self.posed = 0  # poses that were computed
        tick_s = tick_ns / NS_PER_S
        self._radius_and_margin_m = radius_m + _SPEED_LIMIT_MPS * tick_s + _SLACK_M
        speeds = [actor.max_speed_mps for actor in self._actors]
        # Greatest decrease of a gap in a tick; infinite: the gap must be computed in every tick.
        self.approach_m = max(speeds, default=0.0) * tick_s
        self.park_all()

    @property
    def count(self) -> int:
        """Number of actors."""
        return len(self._actors)

    def gap_m(self, p_WB: Vec3, t_ns: int, travelled_m: float = 0.0) -> float:
        """Return the smallest gap, and mark the actors that a vehicle travelling `travelled_m` may touch as near."""
        min_gap_m = math.inf
        x, y, z = p_WB
        if self._still:
            bound = self._bounds(t_ns)
            offset = np.array(p_WB) - bound[:, :3]
            squares = offset * offset
            gaps = np.sqrt((squares[:, 0] + squares[:, 1]) + squares[:, 2]) - bound[:, 3] - self._radius_and_margin_m
            for index, is_near in zip(self._still, (~(travelled_m < gaps)).tolist(), strict=True):
                self._is_near[index] = is_near
            min_gap_m = float(gaps.min())
        for index in self._moving:
            actor = self._actors[index]
            (cx, cy, cz), radius_m = actor.bound(t_ns)
            dx, dy, dz = x - cx, y - cy, z - cz
            gap_m = math.sqrt(dx * dx + dy * dy + dz * dz) - radius_m - self._radius_and_margin_m
            self._is_near[index] = not travelled_m < gap_m
            min_gap_m = min(min_gap_m, gap_m)
        return min_gap_m

    def pose_all(self, t_ns: int) -> None:
        """Pose all actors at `t_ns`, near or not."""
        for index in range(len(self._actors)):
            self._pose(index, t_ns)

    def pose_near(self, t_ns: int) -> None:
        """Pose at `t_ns` the actors that the last `gap_m` found near, and park the others."""
        for index, is_near in enumerate(self._is_near):
            if is_near:
                self._pose(index, t_ns)
            elif not self._is_parked[index]:
                rows = self._rows[index]
                self._position[rows] = self._parked[rows]
                self._is_parked[index] = True

    def park_all(self) -> None:
        """Park all actors."""
        self._position[:] = self._parked
        self._is_parked = [True] * len(self._actors)

    def changed(self, actor: Actor, t_ns: int) -> None:
        """Take notice that an actor that rests was put elsewhere."""
        row = self._still_row.get(id(actor))
        if row is not None and self._still_bound is not None:
            centre_W, radius_m = actor.bound(t_ns)
            self._still_bound[row] = (*centre_W, radius_m)

    def _bounds(self, t_ns: int) -> Float64:
        if self._still_bound is None:
            bounds = [self._actors[index].bound(t_ns) for index in self._still]
            self._still_bound = np.array([(*centre_W, radius_m) for centre_W, radius_m in bounds])
        return self._still_bound

    def _pose(self, index: int, t_ns: int) -> None:
        self.posed += 1
        self._is_parked[index] = False
        solid, p_WB, q_WB, v_WB_W, w_WB_W = self._poses[index]
        self._actors[index].pose(t_ns, p_WB, q_WB, v_WB_W, w_WB_W)
        rows = self._rows[index]
        self._position[rows] = p_WB[solid]
        self._quaternion[rows] = q_WB[solid]
