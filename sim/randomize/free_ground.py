"""Free ground of a world, where a person can stand or walk: level, under the open sky, on no other person's path.

A position is free if the topmost surface there and around it is ground (by its class) of the same height. So no person
stands in, on or under an object.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RayCaster
from sim.frame.geometry import FrameGeometry
from sim.scene.classes import GROUND_CLASSES
from sim.scene.world import World

Float64 = NDArray[np.float64]

_ABOVE_M = 300.0  # height from which rays are cast down
_MAX_HEIGHT_DIFFERENCE_M = 0.04
_BODY_RADIUS_M = 0.45  # must be free
_MIN_DISTANCE_M = 1.1  # between two people's paths
_OFFSETS_AROUND = (  # of the checked positions, in body radii
    (0.0, 0.0),
    (1.0, 0.0),
    (0.7, 0.7),
    (0.0, 1.0),
    (-0.7, 0.7),
    (-1.0, 0.0),
    (-0.7, -0.7),
    (0.0, -1.0),
    (0.7, -0.7),
)
# The paths of the map's actors are sampled over this time, which is longer than any of their laps.
_SAMPLED_S, _SAMPLE_PERIOD_S = 400, 0.4


class FreeGround:
    """Ground of a world that is free of objects, of its actors' paths, and of paths marked with `take`."""

    def __init__(self, world: World) -> None:
        geometry = FrameGeometry(world)
        self._geometry = geometry  # keeps it alive for the caster
        self._caster = RayCaster(geometry.native)
        ground = np.array([name in GROUND_CLASSES for name in world.class_names])
        self._is_ground = np.append(ground[world.geom_class], False)  # geom -1 (no hit) selects the last element
        self._taken_paths = [_actor_path(actor) for actor in world.map.actors]

    def height_m(self, path_xy: Float64) -> float | None:
        """Return the height of the ground under a path (n, 2) if all of it is free and level, else None."""
        low, high = path_xy.min(axis=0) - _MIN_DISTANCE_M, path_xy.max(axis=0) + _MIN_DISTANCE_M
        for taken_xy in self._taken_paths:
            near_xy = taken_xy[((taken_xy > low) & (taken_xy < high)).all(axis=1)]
            if len(near_xy) and _nearer_than(_MIN_DISTANCE_M, path_xy, near_xy):
                return None
        points = (path_xy[:, None, :] + _BODY_RADIUS_M * np.array(_OFFSETS_AROUND)).reshape(-1, 2)
        n = len(points)
        origins, down = np.empty((n, 3)), np.zeros((n, 3))
        origins[:, :2], origins[:, 2], down[:, 2] = points, _ABOVE_M, -1.0
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        self._caster.cast(origins, down, 0.0, 2.0 * _ABOVE_M, range_m, geom)
        if not self._is_ground[geom].all():
            return None
        lowest, highest = _ABOVE_M - float(range_m.max()), _ABOVE_M - float(range_m.min())
        return highest if highest - lowest <= _MAX_HEIGHT_DIFFERENCE_M else None

    def take(self, path_xy: Float64) -> None:
        """Mark a path (n, 2) as no longer free."""
        self._taken_paths.append(path_xy)


def _actor_path(actor: object) -> Float64:
    times = (round(i * _SAMPLE_PERIOD_S * 1e9) for i in range(round(_SAMPLED_S / _SAMPLE_PERIOD_S)))
    return np.array([actor.bound(t_ns)[0][:2] for t_ns in times])  # type: ignore[attr-defined]


def _nearer_than(distance_m: float, a: Float64, b: Float64) -> bool:
    """Return True if any points of two paths are nearer to each other than `distance_m`."""
    x, y = a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1]
    return bool((x * x + y * y < distance_m * distance_m).any())
