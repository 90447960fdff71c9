"""MuJoCo's own renderer (software OpenGL through EGL where there is no GPU) at the same poses as the raster.

As its users run it: one `update_scene`, then one `render()` for each channel, since each of colour, depth and
segmentation is a pass of its own. `two passes` is the best that its C interface has: depth is read with colour, so that
only segmentation needs a second pass; nothing in MuJoCo 4 gives all three at once. Multisampling (4 samples by default)
is off, as the raster takes one sample a pixel; with it, the rival is slower still.

All run on one core: the thread is pinned before the OpenGL context is made, and the driver's threads inherit that.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.raster_cases import Case, View
from sim.frame.camera_model import CameraModel
from sim.frame.mujoco_backend import WorldPose, aim, egl_context, egl_problem, with_pictures_of

CHANNELS = ("rgb", "depth", "segmentation")  # what it can give, in its own pass each


class MujocoRenderer:
    """mujoco.Renderer of a case. `antialiased` leaves multisampling as MuJoCo has it by default."""

    def __init__(
        self, case: Case, camera: CameraModel, *, shadows: bool, two_passes: bool = False, antialiased: bool = False
    ) -> None:
        model = with_pictures_of(case.world.model, camera)
        model.vis.quality.offsamples = 4 if antialiased else 0
        self.name = "MuJoCo, two passes" if two_passes else "MuJoCo, a pass a channel"
        self.name += ", 4 samples" if antialiased else ""
        self._camera, self._two_passes = camera, two_passes
        self._posed = WorldPose(case.world)
        with egl_context():
            self._renderer = mujoco.Renderer(model, camera.height, camera.width, max_geom=model.ngeom + 100)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        shape = (camera.height, camera.width)
        self._rgb, self._depth = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)
        self._ids = np.zeros((*shape, 2), np.int32)

    def pose(self, view: View) -> None:
        """Not part of its time: the actors' poses, and the scene that MuJoCo draws."""
        scene = self._renderer.scene
        self._renderer.update_scene(self._posed.at(view.t_ns))
        extent, planes = self._renderer.model.stat.extent, self._renderer.model.vis.map
        for eye in scene.camera:
            aim(eye, self._camera, view.pose, (planes.znear * extent, planes.zfar * extent))

    def render(self, channels: Sequence[str]) -> dict[str, NDArray]:
        """The channels of the view last posed; `geom` stands for segmentation, of which ids are the raw form."""
        frame: dict[str, NDArray] = {}
        renderer = self._renderer
        together = self._two_passes and {"rgb", "depth"} <= set(channels)
        if together:
            self._colour_and_depth(frame)
        elif "rgb" in channels:
            frame["rgb"] = renderer.render(out=self._rgb)
        if "depth" in channels and not together:
            renderer.enable_depth_rendering()
            frame["depth"] = renderer.render(out=self._depth)
            renderer.disable_depth_rendering()
        if "segmentation" in channels:
            renderer.enable_segmentation_rendering()
            frame["geom"] = renderer.render(out=self._ids)[..., 0]
            renderer.disable_segmentation_rendering()
        return frame

    def close(self) -> None:
        """Gives the OpenGL context back."""
        self._renderer.close()

    def _colour_and_depth(self, frame: dict[str, NDArray]) -> None:
        renderer, model = self._renderer, self._renderer.model
        renderer._gl_context.make_current()
        mujoco.mjr_render(renderer._rect, renderer.scene, renderer._mjr_context)
        mujoco.mjr_readPixels(self._rgb, self._depth, renderer._rect, renderer._mjr_context)
        near = model.vis.map.znear * model.stat.extent
        far = model.vis.map.zfar * model.stat.extent
        # Depth is stored reversed: 1 at the near plane, 0 at the far one.
        frame["rgb"] = self._rgb[::-1]
        frame["depth"] = (near * far / (near + self._depth[::-1].astype(np.float64) * (far - near))).astype(np.float32)


def missing() -> str:
    """Why there is no rival on this machine; "" if there is."""
    return egl_problem()


def driver() -> str:
    """What draws: name and version of the OpenGL driver."""
    try:
        gl: Any = import_module("OpenGL.GL")
        return str(gl.glGetString(gl.GL_RENDERER).decode())
    except Exception as error:  # noqa: BLE001 - only a name for the report
        return f"unknown ({error})"


@contextmanager
def one_core() -> Iterator[None]:
    """Within it, this thread and all that it starts stay on one core."""
    if not hasattr(os, "sched_setaffinity"):
        yield  # not Linux
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
