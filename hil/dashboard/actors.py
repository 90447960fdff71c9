"""People and vehicles of a scene, for the 3-D view: each one stiff thing that is where its first body is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Actors:
    """Where they are at any time. Limbs do not move in the view; in pictures they do."""

    def __init__(self, world: Any) -> None:
        """`world`: sim.scene.world.World."""
        self._actors = world.map.actors
        self._arrays = [tuple(np.zeros((len(actor.bodies), width)) for width in (3, 4, 3, 3)) for actor in self._actors]

    def places(self, t_ns: int) -> list[tuple[float, float, float, float]]:
        """x, y, z [m, W] and yaw [rad] of each."""
        found = []
        for actor, arrays in zip(self._actors, self._arrays, strict=True):
            actor.pose(t_ns, *arrays)
            x, y, z = arrays[0][0].tolist()
            qw, qx, qy, qz = arrays[1][0].tolist()
            yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
            found.append((round(x, 3), round(y, 3), round(z, 3), round(yaw, 4)))
        return found


def into_frame(corners: NDArray[np.float32], place: tuple[float, float, float, float]) -> NDArray[np.float32]:
    """Points of W in the frame of a place."""
    x, y, z, yaw = place
    moved = corners - np.array((x, y, z), np.float32)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)), np.float32)
    return np.asarray(moved @ turn.T, np.float32)
