"""Walking person: the step cycle of sim/native/gait.hpp along a `WalkPath`.

    p = p_WH + R_WH p_H,   v = v_WH + w x (p - p_WH) + R_WH dp_H/dphi ds/dt / L

H is the frame that moves along the path s(t), phi the phase of the step cycle, L the length of a cycle.

On straights the standing foot does not slip. In a corner it slips, at most at the yaw rate times its distance from the
pelvis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

from sim import _kernels
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.walk_path import WalkPath


class MovingPerson(_kernels.Walker):
    """`Actor` of a person on a path, with one mocap body per limb."""

    def __init__(
        self,
        name: str,
        figure: Figure,
        path: WalkPath,
        *,
        ground_m: float,
        middle_m: float,
        radius_m: float,
        **posture: Any,
    ) -> None:
        """`ground_m`: height of the ground under the path. `posture`: how the limbs move, for the kernel.

        A sphere of `radius_m`, `middle_m` above the ground, contains the person at all times.
        """
        self.name = name
        self.figure = figure
        self.path, self.max_speed_mps = path, path.max_speed_mps
        self.ground_m = ground_m
        self.bodies = tuple(f"{name}_{limb}" for limb in LIMBS)
        super().__init__(
            path=path, ground_m=ground_m, bound_z_m=ground_m + middle_m, bound_radius_m=radius_m, **posture
        )


def distance_m(row: Sequence[float], middle_m: float) -> float:
    """Return the distance of a limb's origin, the first numbers of its row, from a point above the path."""
    return sqrt(row[0] * row[0] + row[1] * row[1] + (row[2] - middle_m) * (row[2] - middle_m))


class Walker(MovingPerson):
    """A person who walks."""

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
        # A lap has a whole number of cycles, so that the feet do not jump at its end.
        natural_cycle_m = 1.346 * sqrt(path.speed_mps * figure.leg_m)  # two steps
        cycles = max(1, round(path.lap_m / natural_cycle_m))
        self.gait = _kernels.fit_gait(figure.lengths_m, path.speed_mps, path.lap_m / cycles)
        self.cycles_per_m = cycles / path.lap_m
        middle_m = 0.5 * figure.height_m
        super().__init__(
            name,
            figure,
            path,
            ground_m=ground_m,
            middle_m=middle_m,
            radius_m=self._radius_m(middle_m, reach_m or figure.reach_m()),
            shape=self.gait,
            cycles_per_m=self.cycles_per_m,
        )

    def _radius_m(self, middle_m: float, reach_m: Mapping[str, float]) -> float:
        radius = 0.0
        for i in range(64):
            for limb, row in zip(LIMBS, _kernels.gait_rows(self.gait, i / 64), strict=True):
                radius = max(radius, distance_m(row, middle_m) + reach_m[limb])
        return radius + 0.02  # between the sampled phases


class Roller(MovingPerson):
    """A person on wheels; `rows` of the limbs as in sim/native/gait.hpp, without derivatives."""

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
        middle_m = 0.5 * figure.height_m
        super().__init__(
            name,
            figure,
            path,
            ground_m=ground_m,
            middle_m=middle_m,
            radius_m=max(reach_m[limb] + distance_m(row, middle_m) for limb, row in zip(LIMBS, rows, strict=True)),
            seated=[list(row) for row in rows],
        )
