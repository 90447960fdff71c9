"""A world in closed form: ground, spheres, and a slow, exact renderer.

Stands in for `sim.frame.source.SharedFrames` in tests of cameras and of the use of their pictures, so that these do not
depend on the raster. Sphere 1 moves at 1 m/s to the east.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.classes import Classes
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.scene.scene import load_scene
from sim.world_loader import load_world

SPHERES = np.array([[8.0, 0.0, 2.0, 1.0], [5.0, 3.0, 1.0, 0.6], [12.0, -4.0, 3.0, 2.0]])  # centre [m], radius [m]
SPEED_MPS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
COLOURS = np.array([[90, 140, 60], [200, 40, 40], [40, 60, 210], [230, 190, 40]], np.uint8)  # ground, then spheres
SKY = np.array([120, 170, 230], np.uint8)


class FormulaFrames:
    """Frames of spheres. `expected` lists moments asked for, `drawn` the calls of a renderer: (channels, rows)."""

    classes = Classes(("none", "ground", "ball"), ((0, 0, 0), (90, 140, 60), (200, 40, 40)))

    def __init__(self) -> None:
        self.expected: list[int] = []
        self.drawn: list[tuple[tuple[str, ...], tuple[int, int] | None]] = []
        self.options: list[dict[str, Any]] = []
        self.t_ns = 0
        self.posed, self.unposed = 0, 7
        self.geometry = FrameGeometry(load_world(load_scene("airfield")))  # for LiDARs

    def expect(self, t_ns: int) -> None:
        self.expected.append(t_ns)
        self.posed += t_ns != self.t_ns
        self.t_ns = t_ns

    def renderer(self, camera: CameraModel, **options: Any) -> FormulaRenderer:
        self.options.append(options)
        return FormulaRenderer(self, camera)

    def close(self) -> None:
        pass


class FormulaRenderer:
    def __init__(self, frames: FormulaFrames, camera: CameraModel) -> None:
        self._frames = frames
        self._rays_C = camera.rays()

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        self._frames.drawn.append((tuple(out), rows))
        first, last = rows or (0, len(self._rays_C))
        rays_C = self._rays_C[first:last]
        R_WC = np.array(pose.R_WC).reshape(3, 3)
        rays_W = rays_C @ R_WC.T
        p = np.array(pose.p_WC)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(rays_W[..., 2] < 0.0, -p[2] / rays_W[..., 2], np.inf)
        distance = np.where(distance > 0.0, distance, np.inf)
        geom = np.where(np.isfinite(distance), 0, -1)
        normal_W = np.broadcast_to([0.0, 0.0, 1.0], rays_W.shape).copy()
        speed_W = np.zeros_like(rays_W)
        for i, (*middle, radius) in enumerate(SPHERES, start=1):
            centre = np.array(middle) + SPEED_MPS[i - 1] * self._frames.t_ns * 1e-9
            b = rays_W @ (p - centre)
            c = float((p - centre) @ (p - centre)) - radius * radius
            under = b * b - c
            hit = -b - np.sqrt(np.where(under > 0.0, under, np.nan))
            nearer = (hit > 0.0) & (hit < distance)
            distance = np.where(nearer, hit, distance)
            geom = np.where(nearer, i, geom)
            where = p + rays_W * np.where(nearer, hit, 0.0)[..., None]
            normal_W[nearer] = ((where - centre) / radius)[nearer]
            speed_W[nearer] = SPEED_MPS[i - 1]
        seen = geom >= 0
        point_W = p + rays_W * np.where(seen, distance, 0.0)[..., None]
        camera_speed = np.array(pose.v_WC_W)
        answers = {
            "rgb": np.where(seen[..., None], COLOURS[geom], SKY),
            "range": distance,
            "depth": distance * rays_C[..., 2],
            "geom": geom,
            "instance": geom + 1,
            "segmentation": np.where(seen, np.where(geom > 0, 2, 1), 0),
            "material": np.where(geom > 0, 1, 0),
            "normal": np.where(seen[..., None], normal_W @ R_WC, 0.0),
            "temperature": np.where(seen, 280.0 + geom, 230.0),
            "infrared": np.where(seen, 28000 + 100 * geom, 23000),
            "radial_velocity": np.where(seen, np.sum((speed_W - camera_speed) * rays_W, axis=-1), 0.0),
        }
        assert np.all(np.isfinite(point_W))
        for name, picture in out.items():
            picture[first:last] = answers[name]
