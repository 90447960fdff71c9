"""Pictures of a bench's vehicles: from a camera that follows one of them, from a camera on board, or both.

    chase    behind and above the vehicle (chase_camera.py), with its path, its marks, time, height and speed
    CAMERA   what that camera of the bench sends, with its own resolution, noise and lens
    split    chase to the left, the camera to the right

The raster draws them (docs/frames.md), and OpenCV the lines and letters.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.config import Bench
from hil.run.film.chase_camera import ChaseCamera
from hil.run.sensors.simulated_sensors import SimulatedSensors
from signals.documents.validate import nearest
from signals.errors import ConfigError
from signals.rotation import applied_back, minus
from signals.samples import TruthState, Vec3
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.quality import QUALITIES
from sim.frame.source import SharedFrames, channel_array
from sim.physics.vehicle_bodies import with_vehicles
from sim.scene.solids import solid_tree
from sim.world_loader import load_world

CHASE, SPLIT = "chase", "split"
ALONE = "vehicle"  # name of the only vehicle of a bench
Picture = NDArray[np.uint8]  # (height, width, 3), RGB
_FOV_DEG = 60.0
_PLANES_M = (0.05, 5000.0)
_PATH_S = 4.0  # length of the path that is drawn
_MARK_RGB, _PATH_RGB, _TEXT_RGB = (255, 170, 30), (90, 220, 255), (245, 245, 245)
_MARK_M = 0.12  # radius of a mark


class Film:
    """Source of the pictures of one bench, with all its vehicles. Raises ConfigError for a view that it has not."""

    def __init__(
        self,
        bench: Bench,
        size: tuple[int, int] = (640, 480),
        view: str = CHASE,
        vehicle: str = "",
        *,
        threads: int = 1,
    ) -> None:
        """`size`: width and height [px]. `vehicle`: the one that is followed; default the first."""
        names = {name or ALONE: each for name, each in bench.each_vehicle.items()}
        self.vehicle = vehicle or next(iter(names))
        if self.vehicle not in names:
            hint = nearest(self.vehicle, names)
            raise ConfigError.at("vehicle", f"{self.vehicle!r} is not a vehicle of the bench", hint)
        own = names[self.vehicle]
        camera = _camera_of(own, view)
        world = bench.world if bench.vehicles else with_vehicles(load_world(bench.scene), {ALONE: bench.vehicle})
        self.size, self.view = size, view
        self._names = tuple(names)
        self._frames = SharedFrames(world, threads=threads)
        width, height = size
        self._chase_size = (width // 2, height) if view == SPLIT else size
        self._model = CameraModel.from_fov(*self._chase_size, _FOV_DEG)
        quality = QUALITIES["epic"]
        self._renderer = self._frames.renderer(
            self._model,
            shadows=quality.shadows,
            supersample=quality.supersample,
            near_m=_PLANES_M[0],
            far_m=_PLANES_M[1],
            shading=quality.shading,
        )
        radius_m = max(own.vehicle.bounding_radius_m, 0.05)
        self._chase = ChaseCamera(radius_m, solid_tree(load_world(bench.scene)))
        self._rgb = channel_array("rgb", self._model)
        self._depth = channel_array("depth", self._model)
        self._path: deque[tuple[int, Vec3]] = deque()
        self._sensor: Any = None
        if camera:
            on_board = self._frames.seen_by(self.vehicle)
            self._sensor = SimulatedSensors(own, [camera], on_board).make(camera, {"channels": ("rgb",)})
        self._count = 0

    def restart(self) -> None:
        """Begin another flight."""
        self._path.clear()
        self._chase.restart()
        self._count = 0

    def picture(
        self, truths: Mapping[str, TruthState], marks: Sequence[Vec3] = (), lines: Sequence[str] = ()
    ) -> Picture:
        """Return the picture of an instant. `truths`: of every vehicle; `marks`: places in W; `lines`: further text."""
        for name in self._names:
            self._frames.place_alone(name, truths[name])
        truth = truths[self.vehicle]
        parts = []
        if self.view in (CHASE, SPLIT):
            parts.append(self._from_outside(truth, marks, lines))
        if self._sensor is not None:
            sample = self._sensor.sample(truth, self._count)
            width, height = self.size
            parts.append(_fitted(sample.channels["rgb"], (width - width // 2, height) if parts else self.size))
        self._count += 1
        return parts[0] if len(parts) == 1 else np.ascontiguousarray(np.hstack(parts))

    def _from_outside(self, truth: TruthState, marks: Sequence[Vec3], lines: Sequence[str]) -> Picture:
        pose = self._chase.follow(truth)
        self._path.append((truth.t_ns, truth.p_WB))
        while self._path[0][0] < truth.t_ns - 1e9 * _PATH_S:
            self._path.popleft()
        self._frames.expect(truth.t_ns)
        self._renderer.render(pose, {"rgb": self._rgb, "depth": self._depth})
        picture = self._rgb.copy()
        self._draw_path(picture, pose)
        for mark in marks:
            self._draw_mark(picture, pose, mark)
        speed_mps = float(np.linalg.norm(truth.v_WB_W))
        text = f"{truth.t_ns * 1e-9:6.2f} s   {truth.p_WB[2]:5.1f} m   {speed_mps:4.1f} m/s"
        _write(picture, (text, *lines))
        return picture

    def _draw_path(self, picture: Picture, pose: CameraPose) -> None:
        points = [self._seen(pose, p) for _, p in self._path]
        shaded = picture.copy()
        for a, b in pairwise(points):
            if a is not None and b is not None and self._is_clear(a) and self._is_clear(b):
                cv2.line(shaded, a[0], b[0], _PATH_RGB, max(1, self.size[1] // 240), cv2.LINE_AA)
        cv2.addWeighted(shaded, 0.65, picture, 0.35, 0.0, dst=picture)

    def _draw_mark(self, picture: Picture, pose: CameraPose, mark: Vec3) -> None:
        """Draw a ring around a place, paler where something stands before it."""
        seen = self._seen(pose, mark)
        if seen is None:
            return
        at, depth_m = seen
        radius = max(3, round(self._model.fx * _MARK_M / depth_m))
        thick = max(1, radius // 8)
        shaded = picture.copy()
        cv2.circle(shaded, at, radius, _MARK_RGB, thick, cv2.LINE_AA)
        cv2.circle(shaded, at, max(1, radius // 6), _MARK_RGB, -1, cv2.LINE_AA)
        share = 0.9 if self._is_clear(seen) else 0.4
        cv2.addWeighted(shaded, share, picture, 1.0 - share, 0.0, dst=picture)

    def _seen(self, pose: CameraPose, p_W: Vec3) -> tuple[tuple[int, int], float] | None:
        """Return the pixel of a place and its depth; None behind the camera or far out of the picture."""
        x, y, z = applied_back(pose.R_WC, minus(p_W, pose.p_WC))
        if z < _PLANES_M[0]:
            return None
        u, v = self._model.cx + self._model.fx * x / z, self._model.cy + self._model.fy * y / z
        if abs(u) > 1e4 or abs(v) > 1e4:
            return None
        return (round(u), round(v)), z

    def _is_clear(self, seen: tuple[tuple[int, int], float]) -> bool:
        """Return False if something stands before a place in the picture."""
        (u, v), depth_m = seen
        height, width = self._depth.shape[:2]
        if not (0 <= u < width and 0 <= v < height):
            return True
        return bool(self._depth[v, u] > depth_m - 0.05)

    def close(self) -> None:
        """Release renderers."""
        self._frames.close()


def check_view(bench: Bench, view: str) -> None:
    """Raise ConfigError unless a bench has this view."""
    _camera_of(next(iter(bench.each_vehicle.values())), view)


def _camera_of(bench: Bench, view: str) -> str:
    """Return the camera on board that a view shows, "" for none."""
    if view == CHASE:
        return ""
    cameras = [name for name, sensor in bench.config.sensors.items() if sensor.kind == "camera"]
    if view == SPLIT and cameras:
        return cameras[0]
    if view in cameras:
        return view
    known = ", ".join([CHASE, *([SPLIT] if cameras else []), *cameras])
    text = "shows a camera, and the bench has none" if view == SPLIT else f"{view!r} is not a camera of the bench"
    raise ConfigError.at("view", text, f"choose one of {known}")


def _fitted(picture: Picture, size: tuple[int, int]) -> Picture:
    """Return a picture in another size, with black borders where the shapes differ."""
    (height, width), (wide, high) = picture.shape[:2], size
    scale = min(wide / width, high / height)
    inner = max(1, round(scale * width)), max(1, round(scale * height))
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    scaled = cv2.resize(picture, inner, interpolation=way)
    out = np.zeros((high, wide, 3), np.uint8)
    x, y = (wide - inner[0]) // 2, (high - inner[1]) // 2
    out[y : y + inner[1], x : x + inner[0]] = scaled
    return out


def _write(picture: Picture, lines: Sequence[str]) -> None:
    """Write lines at the top left, on a darker band."""
    scale = max(0.42, picture.shape[0] / 1000.0)
    step = round(36 * scale)
    band = picture[: step * len(lines) + step // 3]
    band[:] = (0.55 * band).astype(np.uint8)
    for row, line in enumerate(lines):
        at = step // 3, step * (row + 1) - step // 6
        cv2.putText(picture, line, at, cv2.FONT_HERSHEY_SIMPLEX, scale, _TEXT_RGB, 1, cv2.LINE_AA)
