"""Default view points of a scene whose file names none.

One is above the scene and one at a corner. Two are searched for, at eye level and at flying height: the search renders
40 x 30 pixels from a grid of positions in eight directions and takes the picture with the most objects and classes at a
good distance, rather than a wall or an empty sky. The result is a pure function of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np

from signals.samples import TruthState, Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames, channel_array
from sim.scene.view_point import ViewPoint

_SEARCH_PX = (40, 30)
_FOV_DEG = 90.0
_GRID = 7  # positions along each side
_DIRECTIONS = 8
_EYE_M, _FLYING_M = 1.7, 8.0
_MIN_DISTANCE_M, _MAX_DISTANCE_M = 1.5, 60.0  # of objects that count
_MIN_EXTENT_M = 6.0


class Extent(NamedTuple):
    """Axis-aligned box in W [m] that holds the objects of a scene."""

    low: Vec3
    high: Vec3

    @property
    def middle(self) -> Vec3:
        """Centre of the box."""
        return tuple(0.5 * (a + b) for a, b in zip(self.low, self.high, strict=True))  # type: ignore[return-value]

    @property
    def width_m(self) -> float:
        """The larger of the two horizontal lengths."""
        return max(self.high[0] - self.low[0], self.high[1] - self.low[1])


def extent_of(world: Any) -> Extent:
    """Return the extent of a World's visible geoms, without planes and without the outermost 2 % on each side."""
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    has_extent = world.geom_visible & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    centres = data.geom_xpos[has_extent]
    if not len(centres):
        centres = np.zeros((1, 3))
    low, high = np.percentile(centres, [2.0, 98.0], axis=0)
    margin = np.maximum(_MIN_EXTENT_M - (high - low), 0.0) * 0.5
    low, high = low - margin, high + margin
    return Extent(tuple(low.tolist()), tuple(high.tolist()))


def looking_at(name: str, at: Vec3, target: Vec3) -> ViewPoint:
    """Return a view point at `at` that faces `target`, both in W [m]."""
    east, north, up = (b - a for a, b in zip(at, target, strict=True))
    yaw = math.degrees(math.atan2(north, east))
    pitch = math.degrees(math.atan2(-up, math.hypot(east, north)))
    return ViewPoint(name=name, at_m=at, look_deg=(yaw, pitch))


def pose_of(point: ViewPoint) -> TruthState:
    """Return the true state of a vehicle at rest at a view point, its nose along the view's direction."""
    yaw, pitch = point.look_deg
    q = Mount((0.0, 0.0, 0.0), (0.0, pitch, yaw), optical=False).q_BC
    zero = (0.0, 0.0, 0.0)
    return TruthState(0, 0, point.at_m, q, zero, zero, zero, zero, (0.0,) * 4, False)


def default_points(frames: SharedFrames, extent: Extent) -> tuple[ViewPoint, ...]:
    """Return the four default view points: air, eye, corner and above."""
    x, y, _ = extent.middle
    half = 0.5 * extent.width_m
    corner = (extent.low[0] - 0.1 * half, extent.low[1] - 0.1 * half, 0.6 * half + 2.0)
    return (
        _best_point("air", frames, extent, height_m=_FLYING_M, pitch_deg=20.0),
        _best_point("eye", frames, extent, height_m=_EYE_M, pitch_deg=0.0),
        looking_at("corner", corner, (x, y, 0.0)),
        ViewPoint(name="above", at_m=(x, y, 1.4 * half + 5.0), look_deg=(90.0, 90.0)),
    )


def _best_point(name: str, frames: SharedFrames, extent: Extent, *, height_m: float, pitch_deg: float) -> ViewPoint:
    camera = CameraModel.from_fov(*_SEARCH_PX, _FOV_DEG)
    renderer = frames.renderer(camera, shadows=False, supersample=1, near_m=0.05, far_m=1000.0)
    out = {channel: channel_array(channel, camera) for channel in ("range", "instance", "segmentation")}
    mount = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    frames.expect(0)
    best, best_score = None, -math.inf
    for point in _candidates(name, extent, height_m, pitch_deg):
        renderer.render(mount.pose(pose_of(point)), out)
        score = _score(out["range"], out["instance"], out["segmentation"])
        if score > best_score:
            best, best_score = point, score
    assert best is not None
    return best


def _candidates(name: str, extent: Extent, height_m: float, pitch_deg: float) -> Iterator[ViewPoint]:
    low, high = extent.low, extent.high
    for i in range(_GRID):
        for j in range(_GRID):
            x = low[0] + (high[0] - low[0]) * (i + 0.5) / _GRID
            y = low[1] + (high[1] - low[1]) * (j + 0.5) / _GRID
            for k in range(_DIRECTIONS):
                yaw = 360.0 * k / _DIRECTIONS - 180.0
                yield ViewPoint(name=name, at_m=(x, y, height_m), look_deg=(yaw, pitch_deg))


def _score(range_m: Any, instance: Any, segmentation: Any) -> float:
    """Score a picture: objects and classes at a good distance, less a penalty for surfaces close to the lens."""
    counts = (range_m > _MIN_DISTANCE_M) & (range_m < _MAX_DISTANCE_M)
    objects = len(np.unique(instance[counts]))
    classes = len(np.unique(segmentation[counts]))
    blocked = float(np.mean(range_m <= 2.0 * _MIN_DISTANCE_M))
    return objects + 3.0 * classes - 60.0 * max(0.0, blocked - 0.1)
