"""Colour by path tracing, with the raster's depth and labels for the same camera, pose and time.

Geometry is that of the raster with round shapes as triangles. The picture is the mean of the light over each pixel, so
its edges lie where the raster's ids change, to a tenth of a pixel (`hil bench photo`). A picture is a function of the
scene, the poses and the number of paths alone, on one machine: other processors and other versions of LLVM, Mitsuba
and the denoiser give other bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.process import TracerProcess
from sim.frame.path_traced.protocol import Exposure, LensData, RenderRequest
from sim.frame.path_traced.scene_data import MovingGeoms, SceneData, make_scene_data
from sim.frame.path_traced.sky_request import sky_request
from sim.frame.renderer import FrameRenderer
from sim.frame.shading import PLAIN, Shading
from sim.scene.world import World

DEFAULT_SAMPLES = 32
MAX_PIXELS = 1 << 24  # of one picture
_FINE_PIXELS = 1 << 22  # up to here a lens is tabulated twice per pixel, with the centres exact
Band = tuple[tuple[int, int], CameraPose]  # rows [from, to) and the pose at their time


class PathTracer:
    """Path tracer of a world: one process for all cameras of a run. Raises PathTracerError if it cannot start."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._data: SceneData = make_scene_data(world)
        self._moving = MovingGeoms(world, self._data.origin_W)
        self._lenses: list[LensData] = []
        self._process: TracerProcess | None = None
        self.users = 0
        self._started()

    def add_camera(self, camera: CameraModel, planes_m: tuple[float, float]) -> int:
        """Return the number of a new camera."""
        if camera.width * camera.height > MAX_PIXELS:
            raise PathTracerError(
                f"the path tracer draws at most {MAX_PIXELS:,} pixels (4096 x 4096), not {camera.width} x "
                f"{camera.height}"
            )
        nodes = 2 if camera.width * camera.height <= _FINE_PIXELS else 1
        table = None if camera.pinhole else _directions(camera, nodes).astype(np.float32)
        f, c = (camera.fx, camera.fy), (camera.cx, camera.cy)
        lens = LensData(camera.width, camera.height, f, c, table, nodes, planes_m)
        process = self._started()
        self._lenses.append(lens)
        process.add_lens(len(self._lenses) - 1, lens)
        return len(self._lenses) - 1

    def render(
        self,
        lens: int,
        moments: Sequence[Sequence[Band]],
        *,
        samples: int,
        t_ns: int,
        left_out: int = -1,
        shading: Shading = PLAIN,
    ) -> NDArray[np.uint8]:
        """Return a picture: the mean over `moments`, each of bands of rows. Raises PathTracerError.

        Of `shading` only textures, exposure and white balance count.
        """
        request = self._request(lens, moments, samples, t_ns, left_out)
        request = request._replace(textures=shading.textures, gain=shading.gain())
        return self._started().render(request)

    @property
    def cpu_s(self) -> float:
        """Processor time of the tracer's process so far, in seconds."""
        return self._started().cpu_s()

    def surfaces(
        self, lens: int, pose: CameraPose, t_ns: int, left_out: int = -1
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the geom at each pixel's centre (-1: none) and its range [m], for comparison with the raster."""
        height = self._lenses[lens].height
        return self._started().surfaces(self._request(lens, [[((0, height), pose)]], 1, t_ns, left_out))

    def close(self) -> None:
        """End the process. A later picture starts it again."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _started(self) -> TracerProcess:
        if self._process is None or not self._process.usable:
            scene = self._world.scene
            process = TracerProcess(sky_request(scene.light, scene.extinction_per_m), self._data.message())
            for number, lens in enumerate(self._lenses):
                process.add_lens(number, lens)
            self._process = process
        return self._process

    def _request(
        self, lens: int, moments: Sequence[Sequence[Band]], samples: int, t_ns: int, left_out: int
    ) -> RenderRequest:
        poses = [pose for bands in moments for _, pose in bands]
        p_WC = np.array([pose.p_WC for pose in poses], np.float64) - self._data.origin_W
        R_WC = np.array([np.ravel(pose.R_WC) for pose in poses], np.float64)
        (first, end), _ = moments[0][0]
        exposure = Exposure(p_WC, R_WC, len(moments), len(moments[0]), end - first)
        seed = crc32(p_WC.tobytes() + R_WC.tobytes() + t_ns.to_bytes(8, "little", signed=True))
        moving = self._moving.at(t_ns, left_out)
        return RenderRequest(lens, exposure, moving, max(samples, len(moments)), seed)


class PathTracedRenderer:
    """FrameRenderer whose `rgb` is path traced, for the same camera, pose and time."""

    def __init__(
        self, native: FrameRenderer, tracer: PathTracer, *, samples: int = DEFAULT_SAMPLES, shading: Shading = PLAIN
    ) -> None:
        self._native, self._tracer = native, tracer
        self._samples, self._shading = samples, shading
        self._lens = tracer.add_camera(native.camera, (native.near_m, native.far_m))
        self._is_open = True
        tracer.users += 1

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these."""
        self._native.render(pose, {name: array for name, array in out.items() if name != "rgb"}, rows=rows)
        if "rgb" in out:
            height = self._native.camera.height
            picture = self._draw([[((0, height), pose)]])
            first, last = rows if rows is not None else (0, height)
            out["rgb"][first:last] = picture[first:last]

    def expose(self, moments: Sequence[Sequence[Band]], rgb: NDArray[np.uint8]) -> None:
        """Fill `rgb` with the mean, in linear light, over moments of an exposure; each moment is a list of bands."""
        rgb[:] = self._draw(moments)

    def close(self) -> None:
        """End the tracer's process if no other renderer uses it. Idempotent."""
        if self._is_open:
            self._is_open = False
            self._tracer.users -= 1
            if self._tracer.users == 0:
                self._tracer.close()

    def _draw(self, moments: Sequence[Sequence[Band]]) -> NDArray[np.uint8]:
        geometry = self._native.geometry
        return self._tracer.render(
            self._lens,
            moments,
            samples=self._samples,
            t_ns=geometry.t_ns,
            left_out=geometry.left_out,
            shading=self._shading,
        )


def tracer_of(geometry: FrameGeometry) -> PathTracer:
    """Return the tracer of a geometry, shared by all its cameras."""
    if PathTracer not in geometry.prepared:
        geometry.prepared[PathTracer] = PathTracer(geometry.world)
    tracer: PathTracer = geometry.prepared[PathTracer]
    return tracer


def _directions(camera: CameraModel, nodes: int) -> NDArray[np.float64]:
    """Return unit directions at `nodes` points per pixel and edge, (nodes height + 1, nodes width + 1, 3)."""
    x = (np.arange(nodes * camera.width + 1) / nodes - camera.cx) / camera.fx
    y = (np.arange(nodes * camera.height + 1) / nodes - camera.cy) / camera.fy
    distorted = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    try:
        directions = camera.directions(distorted)
    except ValueError as error:
        raise PathTracerError(f"the path tracer needs the lens half a pixel beyond the picture: {error}") from error
    return directions.reshape(len(y), len(x), 3)
