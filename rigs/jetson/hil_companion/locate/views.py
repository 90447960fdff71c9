"""Pictures in which a place was in view: those that should show somebody who is there.

A place is in view if a person's trunk there, `_HALF_M` up and down and to both sides of it, lies within the picture,
no farther than `_FAR_M`, and nothing that the depth picture shows is nearer, for all but a share `_HIDDEN` of the
samples of the trunk. The depth is the companion's own, kept at every `_STEP_PX`th pixel.
"""

from __future__ import annotations

import math
from typing import Sequence

import numpy as np

from hil_companion.locate.geolocation import Camera
from hil_companion.navigation.inertial import NavState
from hil_companion.navigation.rotation import matrix_of

_STEP_PX = 4
_HALF_M = (0.2, 0.45)  # across and up
_FAR_M = 40.0
_NEARER_M, _HIDDEN = 1.0, 0.2
_EDGE_PX = 8.0
_MOVED_M = 0.3  # the pictures of a place are found anew if it moves by more


class Views:
    """Poses and depths of all pictures."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._p_WC: list[np.ndarray] = []
        self._R_WC: list[np.ndarray] = []
        self._depth_m: list[np.ndarray | None] = []
        self._known: dict[int, tuple[np.ndarray, int, list[int]]] = {}  # place, pictures looked at, those in view

    def add(self, pose: NavState | None, depth_m: np.ndarray | None) -> None:
        """Keep a picture; call for every one, in order. Without a pose or a depth, no place is in view."""
        if pose is None or depth_m is None:
            self.keep(np.zeros(3), np.eye(3), None)
            return
        R_WB = matrix_of(pose.q)
        p_WC = np.array(pose.p) + R_WB @ self._camera.p_BC
        self.keep(p_WC, R_WB @ self._camera.R_BC, np.asarray(depth_m[::_STEP_PX, ::_STEP_PX], np.float32).copy())

    def keep(self, p_WC: np.ndarray, R_WC: np.ndarray, samples_m: np.ndarray | None) -> None:
        """Keep a camera's pose and the depth at every `_STEP_PX`th pixel (planar, 0 or not finite: unknown)."""
        self._p_WC.append(p_WC)
        self._R_WC.append(R_WC)
        self._depth_m.append(samples_m)

    def showing(self, key: int, p_W: Sequence[float]) -> list[int]:
        """Return the numbers, from 1, of the pictures in which a place is in view. `key` names the place."""
        place = np.array(p_W, float)
        known = self._known.get(key)
        if known is None or float(np.linalg.norm(known[0] - place)) > _MOVED_M:
            known = (place, 0, [])
        where, begun, numbers = known
        numbers = [*numbers, *self._showing(where, begun)]
        self._known[key] = (where, len(self._p_WC), numbers)
        return numbers

    def _showing(self, place: np.ndarray, begun: int) -> list[int]:
        if begun == len(self._p_WC):
            return []
        away = place - np.array(self._p_WC[begun:])
        p_C = np.einsum("nji,nj->ni", np.array(self._R_WC[begun:]), away)
        near = np.flatnonzero((p_C[:, 2] > 1.0) & (np.linalg.norm(away, axis=1) < _FAR_M))
        if not len(near):
            return []
        pixels = self._camera.pixels(p_C[near])
        return [
            begun + int(i) + 1
            for i, pixel, z_m in zip(near, pixels.tolist(), p_C[near, 2].tolist())
            if self._shows(self._depth_m[begun + int(i)], pixel, z_m)
        ]

    def _shows(self, samples_m: np.ndarray | None, pixel: Sequence[float], z_m: float) -> bool:
        half = [self._camera.focal_px * half_m / z_m for half_m in _HALF_M]
        inside = all(
            half_px + _EDGE_PX < at < size - half_px - _EDGE_PX
            for at, half_px, size in zip(pixel, half, self._camera.size_px)
        )
        if samples_m is None or not inside:
            return False
        columns, rows = (
            slice(math.floor((at - half_px) / _STEP_PX), math.ceil((at + half_px) / _STEP_PX))
            for at, half_px in zip(pixel, half)
        )
        trunk_m = samples_m[rows, columns]
        known = np.isfinite(trunk_m) & (trunk_m > 0.0)
        return bool(trunk_m.size) and float((known & (trunk_m < z_m - _NEARER_M)).mean()) <= _HIDDEN
