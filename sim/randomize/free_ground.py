"""Where in a world a person can stand or walk: level ground under the open sky, with nobody else's way across it.

Seen from straight above, a place is free if the first thing there is ground (by its class) and so all round it, to the
same height. So nobody is put into, onto, or under anything.
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
_ABOVE_M = 300.0  # where one looks down from
_LEVEL_M = 0.04  # feet may be so far above or in the ground
_BODY_M = 0.45  # radius that must be free
_APART_M = 1.1  # of two people's ways
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
# Where those of the map walk is looked up over so long a time: longer than any lap of theirs.
_WATCHED_S, _EVERY_S = 400, 0.4


class FreeGround:
    """The free ground of a world, less what was taken since."""

    def __init__(self, world: World) -> None:
        geometry = FrameGeometry(world)
        self._geometry = geometry  # the caster reads it
        self._caster = RayCaster(geometry.native)
        ground = np.array([name in GROUND_CLASSES for name in world.class_names])
        self._is_ground = np.append(ground[world.geom_class], False)  # [-1]: nothing is met
        self._taken = [_trail(actor) for actor in world.map.actors]

    def height_m(self, way: Float64) -> float | None:
        """Height of the ground under a way of points (n, 2), if all of it is free and level; else None."""
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
        """Somebody is there from now on."""
        self._taken.append(way)


def _trail(actor: object) -> Float64:
    times = (round(i * _EVERY_S * 1e9) for i in range(round(_WATCHED_S / _EVERY_S)))
    return np.array([actor.bound(t_ns)[0][:2] for t_ns in times])  # type: ignore[attr-defined]


def _nearer_than(distance_m: float, a: Float64, b: Float64) -> bool:
    """Whether any point of one way is so near to one of the other."""
    x, y = a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1]
    return bool((x * x + y * y < distance_m * distance_m).any())
