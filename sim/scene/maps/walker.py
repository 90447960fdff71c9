"""Walking person: the step cycle of sim/native/gait.hpp along a `WalkPath`.

    p = p_WH + R_WH p_H,   v = v_WH + w x (p - p_WH) + R_WH dp_H/dphi ds/dt / L

H is the frame that moves along the path s(t), phi the phase of the step cycle, L the length of a cycle.

On straights the standing foot does not slip. In a corner it slips, at most at the yaw rate times its distance from the
pelvis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt

from sim import _kernels
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.walk_path import WalkPath


class Walker(_kernels.Walker):
    """`Actor` with one mocap body per limb."""

    def __init__(
        self,
        name: str,
        figure: Figure,
        path: WalkPath,
        *,
        ground_m: float = 0.0,
        reach_m: Mapping[str, float] | None = None,
    ) -> None:
        """`reach_m`: distance from each limb's origin to its farthest point; None: of the figure's shapes."""
        self.name = name
        self.figure = figure
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.ground_m = ground_m  # height of the ground under the path
        # A lap has a whole number of cycles, so that the feet do not jump at its end.
        natural_cycle_m = 1.346 * sqrt(path.speed_mps * figure.leg_m)  # two steps
        cycles = max(1, round(path.lap_m / natural_cycle_m))
        self.gait = _kernels.fit_gait(figure.lengths_m, path.speed_mps, path.lap_m / cycles)
        self.cycles_per_m = cycles / path.lap_m
        self.bodies = tuple(f"{name}_{limb}" for limb in LIMBS)
        super().__init__(
            shape=self.gait,
            path=path,
            cycles_per_m=self.cycles_per_m,
            ground_m=ground_m,
            bound_z_m=ground_m + 0.5 * figure.height_m,
            bound_radius_m=self._bound_radius(reach_m or figure.reach_m()),
        )

    def _bound_radius(self, reach_m: Mapping[str, float]) -> float:
        middle = 0.5 * self.figure.height_m
        radius = 0.0
        for i in range(64):
            for limb, row in zip(LIMBS, _kernels.gait_rows(self.gait, i / 64), strict=True):
                distance = sqrt(row[0] * row[0] + row[1] * row[1] + (row[2] - middle) * (row[2] - middle))
                radius = max(radius, distance + reach_m[limb])
        return radius + 0.02  # between the sampled phases


class Roller(_kernels.Walker):
    """`Actor` of a person on wheels; `rows` of the limbs as in sim/native/gait.hpp, without derivatives."""

    def __init__(
        self,
        name: str,
        figure: Figure,
        path: WalkPath,
        rows: Sequence[Sequence[float]],
        *,
        ground_m: float,
        reach_m: Mapping[str, float],
    ) -> None:
        self.name = name
        self.figure = figure
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.ground_m = ground_m
        self.bodies = tuple(f"{name}_{limb}" for limb in LIMBS)
        middle = 0.5 * figure.height_m
        reaches = [
            reach_m[limb] + sqrt(row[0] * row[0] + row[1] * row[1] + (row[2] - middle) * (row[2] - middle))
            for limb, row in zip(LIMBS, rows, strict=True)
        ]
        super().__init__(
            seated=[list(row) for row in rows],
            path=path,
            ground_m=ground_m,
            bound_z_m=ground_m + middle,
            bound_radius_m=max(reaches),
        )
