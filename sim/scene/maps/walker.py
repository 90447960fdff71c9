"""A walking person: the step cycle of `gait` carried along a `walk_path`.

    p = p_WH + R_WH p_H,   v = v_WH + w x (p - p_WH) + R_WH p_H',   ' = d/dphi * ds/dt / L

On straights the standing foot does not slip at all. Round a corner it turns with the walker, at most at the yaw rate
times its distance from the pelvis.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from hil.signals.samples import Vec3
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.gait import Gait, natural_cycle_m
from sim.scene.maps.scene_map import Float64
from sim.scene.maps.walk_path import WalkPath


class Walker:
    """An `Actor` with one mocap body per limb."""

    def __init__(self, name: str, figure: Figure, path: WalkPath, *, ground_m: float = 0.0) -> None:
        self.name = name
        self.figure = figure
        self.path = path
        self.ground_m = ground_m  # height of the ground it walks on
        # A whole number of cycles a lap, or the feet would jump where it closes.
        cycles = max(1, round(path.lap_m / natural_cycle_m(figure, path.speed_mps)))
        self.gait = Gait(figure, path.speed_mps, path.lap_m / cycles)
        self.bodies = tuple(f"{name}_{limb}" for limb in LIMBS)
        self._per_m = cycles / path.lap_m
        self._radius_m = self._bound_radius()

    @property
    def max_speed_mps(self) -> float:
        # Corners are interpolated: their metres are not exactly metres.
        return 1.05 * self.path.speed_mps

    def _bound_radius(self) -> float:
        middle = 0.5 * self.figure.height_m
        reach = {
            limb: max(
                sqrt(s.pos[0] * s.pos[0] + s.pos[1] * s.pos[1] + s.pos[2] * s.pos[2])
                + (sum(s.size) if s.kind == "capsule" else max(s.size))
                for s in self.figure.shapes()
                if s.limb == limb
            )
            for limb in LIMBS
        }
        radius = 0.0
        for i in range(64):
            for limb, row in zip(LIMBS, self.gait.rows(i / 64), strict=True):
                distance = sqrt(row[0] * row[0] + row[1] * row[1] + (row[2] - middle) * (row[2] - middle))
                radius = max(radius, distance + reach[limb])
        return radius + 0.02  # between the sampled phases

    def bound(self, t_ns: int) -> tuple[Vec3, float]:
        _, s_m, _ = self.path.progress(t_ns)
        x, y, *_ = self.path.place(s_m)
        return (x, y, self.ground_m + 0.5 * self.figure.height_m), self._radius_m

    def phase(self, t_ns: int) -> float:
        """Of the step cycle, [0, 1)."""
        _, s_m, _ = self.path.progress(t_ns)
        return s_m * self._per_m % 1.0

    def pose(self, t_ns: int, p_WB: Float64, q_WB: Float64, v_WB_W: Float64, w_WB_W: Float64) -> None:
        _, s_m, speed = self.path.progress(t_ns)
        x0, y0, c, s, dx_ds, dy_ds, yaw_per_m = self.path.place(s_m)
        rate = speed * self._per_m
        yaw_rate = speed * yaw_per_m
        rows = np.array(self.gait.rows(s_m * self._per_m % 1.0))
        x, y, z, tc, ts, yc, ys, dx, dy, dz, d_theta, d_yaw = rows.T
        rx, ry = c * x - s * y, s * x + c * y
        p_WB[:, 0] = x0 + rx
        p_WB[:, 1] = y0 + ry
        p_WB[:, 2] = z + self.ground_m
        dx, dy = dx * rate, dy * rate
        v_WB_W[:, 0] = speed * dx_ds - yaw_rate * ry + (c * dx - s * dy)
        v_WB_W[:, 1] = speed * dy_ds + yaw_rate * rx + (s * dx + c * dy)
        v_WB_W[:, 2] = dz * rate
        # Half heading, without trigonometry; the sign where cos = -1 does not matter, the quaternion's two are one.
        hc = sqrt(0.5 * (1.0 + c)) if c > -0.5 else 0.5 * abs(s) / sqrt(0.5 * (1.0 - c))
        hs = sqrt(0.5 * (1.0 - c)) if c < 0.5 else 0.5 * abs(s) / hc
        if s < 0.0:
            hs = -hs
        zc, zs = hc * yc - hs * ys, hs * yc + hc * ys  # heading and the limb's own yaw
        q_WB[:, 0] = zc * tc
        q_WB[:, 1] = -zs * ts
        q_WB[:, 2] = zc * ts
        q_WB[:, 3] = zs * tc
        d_theta = d_theta * rate
        w_WB_W[:, 0] = -d_theta * (2.0 * zc * zs)
        w_WB_W[:, 1] = d_theta * (zc * zc - zs * zs)
        w_WB_W[:, 2] = yaw_rate + d_yaw * rate
