"""Tight box of an object: upright, with the heading of the object's own forward axis.

With `up` a unit vector and x the object's forward axis,

    heading = (x - (x . up) up) normalised       left = up x heading

and the box has exactly the object's extent along heading, left and up: every point of the object is in it, and each of
its six faces touches the object. Where x is parallel to `up`, the object's left axis stands for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.frame.object_shapes import ObjectShapes, PosedObject

Float64 = NDArray[np.float64]

UP_W = np.array([0.0, 0.0, 1.0])
_PARALLEL = 1e-6  # length of what is left of a unit vector
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class ObjectBox(NamedTuple):
    """Box in W. `axes_W`: rows heading, left, up. `size_m`: length, width, height along them."""

    centre_W: Float64  # (3,) [m]
    axes_W: Float64  # (3, 3)
    size_m: Float64  # (3,)
    v_W: Float64  # (3,) [m/s] of the point of the object at the centre

    @property
    def yaw_rad(self) -> float:
        """Angle of the heading from east, to the north."""
        return math.atan2(float(self.axes_W[0, 1]), float(self.axes_W[0, 0]))

    @property
    def corners_W(self) -> Float64:
        """The eight corners, (8, 3) [m]."""
        return self.centre_W + (_CORNERS * self.size_m) @ self.axes_W


class BoxedPoints:
    """Points of a sweep, sorted so that those in a box are found without looking at all."""

    def __init__(self, points_W: Float64) -> None:
        """`points_W`: (n, 3) [m]."""
        order = np.argsort(points_W[:, 0], kind="stable")
        self._points_W = points_W[order]
        self._x = np.ascontiguousarray(self._points_W[:, 0])

    def count(self, box: ObjectBox) -> int:
        """Return how many points lie inside a box."""
        half = 0.5 * box.size_m
        reach = half @ np.abs(box.axes_W)  # half extents along the axes of W
        first, last = np.searchsorted(self._x, [box.centre_W[0] - reach[0], box.centre_W[0] + reach[0]]).tolist()
        offset = self._points_W[first : last + 1] - box.centre_W
        offset = offset[np.abs(offset[:, 1]) <= reach[1]]
        return int(np.count_nonzero((np.abs(offset @ box.axes_W.T) <= half).all(axis=1)))


def tight_boxes(shapes: ObjectShapes, objects: Sequence[PosedObject], up_W: Float64 = UP_W) -> list[ObjectBox | None]:
    """Return the tight box of each object, upright along the unit vector `up_W`; None if it has no finite extent."""
    if not objects:
        return []
    R_WO = np.stack([posed.R_WO for posed in objects])
    level = R_WO[:, :, :2] - up_W[:, None] * (up_W @ R_WO[:, :, :2])[:, None, :]  # (k, 3, forward and left)
    length = np.sqrt((level * level).sum(axis=1))
    axis = np.where(length[:, 0] > _PARALLEL, 0, 1)
    which = np.arange(len(objects))
    axes = np.empty((len(objects), 3, 3))
    axes[:, 0] = level[which, :, axis] / length[which, axis, None]
    axes[:, 1] = _cross(np.broadcast_to(up_W, axes[:, 0].shape), axes[:, 0])
    axes[:, 2] = up_W
    low, high = shapes.extents(objects, axes)
    with np.errstate(invalid="ignore"):
        middle, size = 0.5 * (low + high), high - low
    finite: NDArray[np.bool_] = np.isfinite(size).sum(axis=1) == 3
    centre = np.einsum("ki,kij->kj", np.where(finite[:, None], middle, 0.0), axes)
    arm = centre - np.stack([posed.p_WO for posed in objects])
    v_W = np.stack([posed.v_WO_W for posed in objects]) + _cross(np.stack([o.w_WO_W for o in objects]), arm)
    return [ObjectBox(centre[i], axes[i], size[i], v_W[i]) if ok else None for i, ok in enumerate(finite.tolist())]


def _cross(a: Float64, b: Float64) -> Float64:
    x, y, z = a.T
    u, v, w = b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
