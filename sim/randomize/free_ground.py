"""Free ground of a world, where a person can stand or walk: level, under the open sky, on no other person's path.

A place is free if the topmost surface there and round it is ground (by its class) of the same height. So no person is
put into, onto or under an object.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RayCaster
from sim.frame.geometry import FrameGeometry
from sim.scene.world import World

Float64 = NDArray[np.float64]

GROUND_CLASSES = frozenset(
    {
        "ground", "path", "road", "grass", "terrain", "sidewalk", "pavement", "crossing", "marking", "lawn", "pad",
        "hill",
    }
)  # fmt: skip
_ABOVE_M = 300.0  # height from which rays are cast down
_LEVEL_M = 0.04  # greatest difference of heights
_BODY_M = 0.45  # radius that must be free
_APART_M = 1.1  # least distance of two people's paths
_ROUND = (
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
_WATCHED_S, _EVERY_S = 400, 0.4


class FreeGround:
    """Free ground of a world, without the paths that were taken since."""

    def __init__(self, world: World) -> None:
        geometry = FrameGeometry(world)
        self._geometry = geometry  # keeps it alive for the caster
        self._caster = RayCaster(geometry.native)
        ground = np.array([name in GROUND_CLASSES for name in world.class_names])
        self._is_ground = np.append(ground[world.geom_class], False)  # [-1]: the ray hits nothing
        self._taken = [_trail(actor) for actor in world.map.actors]

    def height_m(self, way: Float64) -> float | None:
        """Return the height of the ground under a path of points (n, 2) if all of it is free and level, else None."""
        low, high = way.min(axis=0) - _APART_M, way.max(axis=0) + _APART_M
        for other in self._taken:
            near = other[((other > low) & (other < high)).all(axis=1)]
            if len(near) and _nearer_than(_APART_M, way, near):
                return None
        points = (way[:, None, :] + _BODY_M * np.array(_ROUND)).reshape(-1, 2)
        n = len(points)
        origins, down = np.empty((n, 3)), np.zeros((n, 3))
        origins[:, :2], origins[:, 2], down[:, 2] = points, _ABOVE_M, -1.0
        range_m, geom = np.empty(n), np.empty(n, np.int32)
        self._caster.cast(origins, down, 0.0, 2.0 * _ABOVE_M, range_m, geom)
        if not self._is_ground[geom].all():
            return None
        lowest, highest = _ABOVE_M - float(range_m.max()), _ABOVE_M - float(range_m.min())
        return highest if highest - lowest <= _LEVEL_M else None

    def take(self, way: Float64) -> None:
        """Mark a path as taken."""
        self._taken.append(way)


def _trail(actor: object) -> Float64:
    times = (round(i * _EVERY_S * 1e9) for i in range(round(_WATCHED_S / _EVERY_S)))
    return np.array([actor.bound(t_ns)[0][:2] for t_ns in times])  # type: ignore[attr-defined]


def _nearer_than(distance_m: float, a: Float64, b: Float64) -> bool:
    """Return True if any points of two paths are nearer to each other than `distance_m`."""
    x, y = a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1]
    return bool((x * x + y * y < distance_m * distance_m).any())
