"""Colour by MuJoCo's own renderers, for machines with a GPU: `egl` (classic OpenGL) and `filament` (Vulkan).

Pose and frustum are those of the raster, so that the colour matches the raster's depth and ids pixel by pixel. With
near plane n and the intrinsics in this bench's pixel coordinates (pixel (i, j) covers [i, i+1] x [j, j+1]):

    left = -n cx / fx,  right = n (W - cx) / fx,  top = n cy / fy,  bottom = -n (H - cy) / fy.

The raster still makes depth, ids, normals and velocities: these renderers have depth of 24 bits only, and need another
pass for ids. Their pictures differ between machines and drivers (and Filament's between runs), so a run with such
colour is not reproducible bit for bit. Only pinhole cameras are supported.
"""

from __future__ import annotations

import copy
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.errors import HilError

if TYPE_CHECKING:
    from sim.frame.camera_model import CameraModel
    from sim.frame.renderer import CameraPose, FrameRenderer
    from sim.scene.world import World

Planes = tuple[float, float]  # distance of the near and the far plane [m]
BACKENDS = ("egl", "filament")
_OUTSIDE_M = 1e8  # beyond every far plane
_FILAMENT_PROBE = (
    "import mujoco.studio.window; from mujoco import mjrf; "
    "mjrf.Context(mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))"
)


class ColourBackendError(HilError):
    """MuJoCo's renderer is missing on this machine, or does not support this camera."""


class WorldPose:
    """MuJoCo's data of a world with its actors posed at a time, and the velocities of bodies."""

    def __init__(self, world: World) -> None:
        self.model = world.model
        self.data = mujoco.MjData(world.model)
        self.v_WB_W = np.zeros((world.model.nbody, 3))  # of the bodies' origins (data.xpos)
        self.w_WB_W = np.zeros((world.model.nbody, 3))
        self._actors = []
        for actor in world.map.actors:
            n = len(actor.bodies)
            bodies = np.array([self.model.body(name).id for name in actor.bodies])
            arrays = (np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3)))
            self._actors.append((actor, bodies, self.model.body_mocapid[bodies], arrays))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)  # bodies may carry lights

    def at(self, t_ns: int, left_out: int = -1) -> mujoco.MjData:
        """Return the data, posed at `t_ns`. `left_out`: number of an actor that is not shown, -1 for none."""
        for number, (actor, bodies, mocap, (p_WB, q_WB, v_WB_W, w_WB_W)) in enumerate(self._actors):
            actor.pose(t_ns, p_WB, q_WB, v_WB_W, w_WB_W)
            if number == left_out:
                p_WB[:] = _OUTSIDE_M
            self.v_WB_W[bodies] = v_WB_W
            self.w_WB_W[bodies] = w_WB_W
            self.data.mocap_pos[mocap] = p_WB
            self.data.mocap_quat[mocap] = q_WB
        if self._actors:
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_camlight(self.model, self.data)
        return self.data


class MujocoColour:
    """Renderer of `rgb` of a world. Raises ColourBackendError if the machine has no such renderer."""

    def __init__(
        self,
        world: World,
        camera: CameraModel,
        *,
        backend: str = "egl",
        shadows: bool = False,
        near_m: float = 0.05,
        far_m: float = 1000.0,
    ) -> None:
        if backend not in BACKENDS:
            raise ColourBackendError(f"no colour backend {backend!r}; backends: {', '.join(BACKENDS)}")
        if not camera.pinhole:
            raise ColourBackendError(
                f"the colour backend {backend!r} draws pinhole cameras only; use the backend 'native' for distortion"
            )
        if backend == "egl" and abs(camera.fx - camera.fy) > 1e-6 * camera.fy:
            raise ColourBackendError("the colour backend 'egl' draws square pixels only: fx and fy must be the same")
        if backend == "filament" and abs(camera.cx - 0.5 * camera.width) > 1e-6:
            raise ColourBackendError(
                "the colour backend 'filament' needs the optical axis in the middle: cx = width / 2"
            )
        problem = egl_problem() if backend == "egl" else filament_problem()
        if problem:
            raise ColourBackendError(f"the colour backend {backend!r} does not work here: {problem}")
        self._world_pose = WorldPose(world)
        renderer_class = _Classic if backend == "egl" else _Filament
        self._renderer = renderer_class(world.model, camera, (near_m, far_m), shadows=shadows)
        self._data = self._world_pose.data

    def pose(self, t_ns: int, left_out: int = -1) -> None:
        """Pose the actors at `t_ns`, without the actor of that number."""
        self._data = self._world_pose.at(t_ns, left_out)

    def render(self, pose: CameraPose, rgb: NDArray[np.uint8]) -> None:
        """Fill the caller's array (H, W, 3) with colour, row 0 on top."""
        self._renderer.colour(self._data, pose, rgb)

    def geom_ids(self, pose: CameraPose) -> NDArray[np.int32]:
        """Return the geom at each pixel (H, W), -1 for none, for comparison with the raster's. Backend `egl` only."""
        if not isinstance(self._renderer, _Classic):
            raise ColourBackendError("only the backend 'egl' gives geom ids")
        return self._renderer.geom_ids(self._data, pose)

    def close(self) -> None:
        """Release the graphics context."""
        self._renderer.close()


@contextmanager
def egl_context() -> Iterator[None]:
    """Make `mujoco.Renderer` use EGL inside the block, even if MUJOCO_GL named another backend."""
    from mujoco.egl import GLContext
    from mujoco.rendering.classic import renderer

    module: Any = renderer.gl_context
    previous = getattr(module, "GLContext", None)  # missing if MUJOCO_GL is "disabled"
    module.GLContext = GLContext
    try:
        yield
    finally:
        if previous is None:
            del module.GLContext
        else:
            module.GLContext = previous


@cache
def egl_problem() -> str:
    """Return why the classic renderer does not work on this machine; "" if it does."""
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><light/><geom size='1'/></worldbody></mujoco>")
    try:
        with egl_context():
            mujoco.Renderer(model, 4, 4).close()
    except Exception as error:  # noqa: BLE001 - whatever a missing or broken driver raises, there is no renderer
        return f"{error} (on Debian: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri)"
    return ""


@cache
def filament_problem() -> str:
    """Return why Filament does not work on this machine, or "". Tried in a child process, which may abort."""
    try:
        result = subprocess.run(
            [sys.executable, "-P", "-c", _FILAMENT_PROBE], capture_output=True, text=True, timeout=60.0, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if result.returncode == 0:
        return ""
    lines = [line for line in (result.stdout + result.stderr).splitlines() if line.strip()]
    return f"{lines[-1] if lines else 'it aborts'} (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers)"


class _Classic:
    """Classic renderer: MjvScene and mujoco.Renderer, with the frustum of a CameraModel."""

    def __init__(self, model: mujoco.MjModel, camera: CameraModel, planes_m: Planes, *, shadows: bool) -> None:
        model = with_buffers_for(model, camera)
        self._camera, self._planes_m = camera, planes_m
        with egl_context():
            self._renderer = mujoco.Renderer(model, camera.height, camera.width, max_geom=model.ngeom + 100)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows

    def colour(self, data: mujoco.MjData, pose: CameraPose, rgb: NDArray[np.uint8]) -> None:
        self._aim(data, pose)
        self._renderer.render(out=rgb)

    def geom_ids(self, data: mujoco.MjData, pose: CameraPose) -> NDArray[np.int32]:
        self._aim(data, pose)
        self._renderer.enable_segmentation_rendering()
        ids = self._renderer.render()
        self._renderer.disable_segmentation_rendering()
        return np.where(ids[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, ids[..., 0], -1).astype(np.int32)

    def close(self) -> None:
        self._renderer.close()

    def _aim(self, data: mujoco.MjData, pose: CameraPose) -> None:
        self._renderer.update_scene(data)
        for eye in self._renderer.scene.camera:  # both eyes of the stereo pair: mjr_render uses their mean
            aim(eye, self._camera, pose, self._planes_m)


class _Filament:
    """Filament through the objects of mjrf, because MuJoCo's own wrapper needs Python 3.12."""

    def __init__(self, model: mujoco.MjModel, camera: CameraModel, planes_m: Planes, *, shadows: bool) -> None:
        import mujoco.studio.window  # noqa: F401 - registers where Filament's materials are found
        from mujoco import mjrf
        from mujoco.rendering.filament.model_scene import ModelScene

        self._rf: Any = mjrf
        self._camera, self._planes_m, self._shadows = camera, planes_m, shadows
        self._context = mjrf.Context(mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))
        self._scene = ModelScene(self._context, model)
        self._target = self._context.create_render_target(
            mjrf.RenderTargetConfig(color_format=mjrf.PixelFormat.PIXEL_FORMAT_RGB8)
        )
        self._target.resize(camera.width, camera.height)

    def colour(self, data: mujoco.MjData, pose: CameraPose, rgb: NDArray[np.uint8]) -> None:
        self._scene.update(data)
        request, read = self._rf.RenderRequest(), self._rf.ReadRequest(target=self._target)
        request.scene, request.target = self._scene.scene, self._target
        eye = self._rf.Camera()
        aim(eye, self._camera, pose, self._planes_m)
        request.camera, request.shadows = eye, self._shadows
        request.viewport.width, request.viewport.height = self._camera.width, self._camera.height
        read.set_buffer(rgb)
        self._context.wait_for_frame(self._context.render([request], [read]))

    def close(self) -> None:
        del self._scene, self._target, self._context


def with_buffers_for(model: mujoco.MjModel, camera: CameraModel) -> mujoco.MjModel:
    """Return a copy of the model with buffers of the camera's size; the shared model of a World must not change."""
    model = copy.copy(model)
    view = model.vis
    view.global_.offwidth = max(int(view.global_.offwidth), camera.width)
    view.global_.offheight = max(int(view.global_.offheight), camera.height)
    return model


def aim(eye: Any, camera: CameraModel, pose: CameraPose, planes_m: Planes) -> None:
    """Set MuJoCo's GL camera to the pose and the frustum of `camera` (its width follows from the picture's shape)."""
    near_m, far_m = planes_m
    R_WC = np.reshape(pose.R_WC, (3, 3))
    left, right = -near_m * camera.cx / camera.fx, near_m * (camera.width - camera.cx) / camera.fx
    eye.pos, eye.forward, eye.up = pose.p_WC, R_WC[:, 2], -R_WC[:, 1]
    eye.frustum_center, eye.frustum_width = 0.5 * (left + right), 0.5 * (right - left)
    eye.frustum_top = near_m * camera.cy / camera.fy
    eye.frustum_bottom = -near_m * (camera.height - camera.cy) / camera.fy
    eye.frustum_near, eye.frustum_far = near_m, far_m


class MixedRenderer:
    """FrameRenderer whose `rgb` is drawn by MuJoCo, for the same camera, pose and time."""

    def __init__(self, native: FrameRenderer, colour: MujocoColour) -> None:
        self._native, self._colour = native, colour
        self._rgb = np.empty((native.camera.height, native.camera.width, 3), np.uint8)

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out`; `rows`: only these."""
        self._native.render(pose, {name: array for name, array in out.items() if name != "rgb"}, rows=rows)
        if "rgb" in out:
            self._colour.pose(self._native.geometry.t_ns, self._native.geometry.left_out)
            self._colour.render(pose, self._rgb)
            first, last = rows if rows is not None else (0, len(self._rgb))
            out["rgb"][first:last] = self._rgb[first:last]

    def close(self) -> None:
        """Release the graphics context."""
        self._colour.close()
