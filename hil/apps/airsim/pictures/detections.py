"""Objects that a camera sees, by name: their boxes in the picture and in space.

The box in the picture holds exactly the visible pixels of the object. The box in space is along the camera's axes
(forward, right, down) around the object's box along the axes of the world.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.pictures.camera import CameraPlace, ServedCamera
from hil.apps.airsim.pictures.cameras import Cameras
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.world.frames import Frames
from hil.apps.airsim.world.objects.bounds import Bounds, Box
from hil.apps.airsim.world.objects.names import like
from signals.rotation import matrix_of, minus, norm
from signals.samples import Quat, Vec3

_MOST_PATTERNS = 1000


class Detection(NamedTuple):
    """One object in a picture. Pixels have their centres at (i + 0.5, j + 0.5); C is the camera, FLU."""

    name: str
    low_px: tuple[float, float]
    high_px: tuple[float, float]
    low_F: Vec3  # forward, right, down from the camera
    high_F: Vec3
    box: Box
    p_CO: Vec3
    q_WC: Quat


@dataclass
class Filter:
    """Objects that one image type of one camera detects."""

    patterns: list[str] = field(default_factory=list)
    radius_m: float = 200.0


class Detections:
    """Detections of all cameras of one server."""

    def __init__(self, cameras: Cameras, frames: Frames) -> None:
        self._cameras, self._frames = cameras, frames
        self._filters: dict[tuple[int, int], Filter] = {}
        self._bounds: tuple[object, Bounds] | None = None

    def filter(self, camera: ServedCamera, image_type: int) -> Filter:
        """Return the filter of an image type of a camera."""
        return self._filters.setdefault((id(camera), image_type), Filter())

    def add(self, camera: ServedCamera, image_type: int, pattern: str) -> None:
        """Detect objects whose names match a text with wildcards, too. Raises RpcError."""
        patterns = self.filter(camera, image_type).patterns
        if len(pattern) > 200 or len(patterns) >= _MOST_PATTERNS:
            raise RpcError(f"a name has at most 200 characters, and a camera at most {_MOST_PATTERNS} of them")
        if pattern not in patterns:
            patterns.append(pattern)

    def box(self, instance: int) -> Box:
        """Return the box of an instance (`Segmentation.names`) at the present tick."""
        frames = self._frames.seen_by()
        if self._bounds is None or self._bounds[0] is not frames.world:
            self._bounds = (frames.world, Bounds(frames.world))
        return self._bounds[1].of(instance, frames.geometry.t_ns)

    def found(self, camera: ServedCamera, image_type: int) -> list[Detection]:
        """Return the objects that the camera sees now, in the order of the scene's objects."""
        chosen = self.filter(camera, image_type)
        names = self._cameras.segmentation.names
        found = like(chosen.patterns, names[1:])
        wanted = [number for number, name in enumerate(names) if number and name in found]
        if not wanted:
            return []
        place = camera.place()
        seen = self._cameras.render(camera, place, image_type, ("instance",))["instance"]
        present = np.isin(wanted, np.unique(seen))
        detections = []
        for number in np.array(wanted)[present].tolist():
            box = self.box(number)
            if norm(minus(place.p_W, box.p_WO)) <= chosen.radius_m:
                detections.append(_detection(names[number], seen == number, place, box))
        return detections


def _in_camera(place: CameraPlace, points_W: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points in the camera's frame. The order of additions in a matrix product depends on the machine."""
    x, y, z = (points_W - place.p_W).T
    R = matrix_of(place.q_WC)
    return np.stack([R[i] * x + R[i + 3] * y + R[i + 6] * z for i in range(3)], axis=1)


def _detection(name: str, mask: NDArray[np.bool_], place: CameraPlace, box: Box) -> Detection:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    corners = _in_camera(place, box.corners_W) * (1.0, -1.0, -1.0)
    low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    x, y, z = _in_camera(place, np.array([box.p_WO]))[0].tolist()
    return Detection(
        name,
        (float(columns[0]), float(rows[0])),
        (float(columns[-1] + 1), float(rows[-1] + 1)),
        tuple(low),
        tuple(high),
        box,
        (x, y, z),
        place.q_WC,
    )
