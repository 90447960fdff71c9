"""All cameras of the server, and their renderers.

A renderer is made at the first picture of a view (vehicle, size, lens) and kept. It draws only the channels that a call
asks for, and all channels of one view in one go. Pictures show the present tick.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.pictures.camera import CameraPlace, ServedCamera
from hil.apps.airsim.pictures.image_types import Taken, channel
from hil.apps.airsim.pictures.light import LightState, light_state, present_light
from hil.apps.airsim.pictures.segmentation import Segmentation
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.settings.cameras import camera_of
from hil.apps.airsim.settings.settings import AirSimSettings
from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.frames import Frames
from hil.apps.airsim.world.ned import NedFrame
from hil.apps.airsim.world.surroundings import Surroundings
from hil.run.stepped.world import SteppedWorld
from signals.noise import noise_key
from signals.samples import Vec3
from sim._kernels import SunShadows
from sim.frame.camera_model import CameraModel
from sim.frame.quality import QUALITIES
from sim.frame.rain_streaks import USUAL_EXPOSURE_S, RainStreaks
from sim.frame.renderer import Execution, FrameRenderer
from sim.frame.source import SharedFrames
from sim.scene.light import Light
from sim.scene.weather import Weather

NEAR_M, FAR_M = 0.05, 20_000.0
_MOST_RENDERERS = 48
_MOST_PIXELS = 1 << 26  # of one call
_LARGE_PIXELS = 1 << 19  # larger pictures are drawn by all cores, which changes no pixel
_View = tuple[str, CameraModel, float, bool]  # vehicle, projection, exposure, has colour


class Wanted(NamedTuple):
    """Picture that a call asks for. `instances`: segmentation as Cosys-AirSim has it."""

    camera: ServedCamera
    image_type: int
    instances: bool = False


class Cameras:
    """Cameras of one server."""

    def __init__(
        self,
        settings: AirSimSettings,
        world: SteppedWorld,
        frames: Frames,
        surroundings: Surroundings,
        *,
        world_frame: NedFrame,
        find_drone: Callable[[str], Drone],
    ) -> None:
        """`find_drone` returns a vehicle by name, and raises RpcError if there is none."""
        self._world, self._frames, self._surroundings = world, frames, surroundings
        self._origin, self._find_drone = settings.origin, find_drone
        self._cameras: dict[tuple[str, str], ServedCamera] = {}
        self._external = {
            name: ServedCamera(name, each, None, world_frame) for name, each in settings.external_cameras.items()
        }
        self._renderers: dict[_View, FrameRenderer] = {}
        self._generation = -1
        self._streaks: dict[tuple[str, CameraModel], RainStreaks] = {}
        self._streaks_in: tuple[Weather, Vec3] | None = None  # weather and wind
        self._light_state: LightState | None = None
        self._light: Light | None = None
        self.segmentation = Segmentation(frames, settings.segmentation.random_ids)

    def find(self, name: str, vehicle: str, external: bool = False) -> ServedCamera:
        """Return a camera. Raises RpcError with the names that exist."""
        if external:
            found = self._external.get(name)
            if found is None:
                known = ", ".join(self._external) or "none; add them to ExternalCameras of settings.json"
                raise RpcError(f"there is no external camera '{name[:60]}'; the external cameras are: {known}")
            return found
        drone = self._find_drone(vehicle)
        own = camera_of(drone.settings.cameras, name)
        found = self._cameras.get((drone.name, own))
        if found is None:
            settings = drone.settings.cameras.get(own)
            if settings is None:
                known = ", ".join(drone.settings.cameras)
                raise RpcError(
                    f"{drone.name} has no camera '{name[:60]}'; its cameras are: {known}. Use one of these names, or "
                    "add the camera to Cameras of the vehicle in settings.json"
                )
            found = self._cameras[drone.name, own] = ServedCamera(own, settings, drone, drone.origin)
        return found

    def prepare(self) -> None:
        """Draw a first picture, so that no client waits while the geometry of the world is made."""
        self.take([Wanted(self.find("", ""), 0)])

    def take(self, wanted: Sequence[Wanted]) -> list[Taken]:
        """Return the pictures of the present tick; those of one camera with one lens are drawn together."""
        total = sum(width * height for width, height in (each.camera.size(each.image_type) for each in wanted))
        if total > _MOST_PIXELS:
            raise RpcError(
                f"one call asks for {total / 1e6:.0f} million pixels; ask for at most {_MOST_PIXELS / 1e6:.0f} million"
            )
        views: dict[tuple[int, CameraModel, float], set[str]] = {}
        keys = []
        for camera, image_type, _ in wanted:
            needed = channel(image_type)
            exposure_ev = camera.settings.capture(image_type).exposure_ev if needed == "rgb" else 0.0
            keys.append((id(camera), camera.model(image_type), exposure_ev))
            views.setdefault(keys[-1], set()).add(needed)
        drawn: dict[tuple[int, CameraModel, float], tuple[CameraPlace, dict[str, NDArray[Any]]]] = {}
        taken = []
        for key, (camera, image_type, instances) in zip(keys, wanted, strict=True):
            if key not in drawn:
                place = camera.place()
                drawn[key] = place, self.render(camera, place, image_type, sorted(views[key]))
            place, arrays = drawn[key]
            taken.append(Taken(arrays, self._world.t_ns, camera, place, key[1], self.segmentation, instances))
        return taken

    def render(
        self, camera: ServedCamera, place: CameraPlace, image_type: int, channels: Collection[str]
    ) -> dict[str, NDArray[Any]]:
        """Return channels (signals.channels) of a camera, with size and lens of an image type. Raises RpcError."""
        vehicle = "" if camera.drone is None else camera.drone.name
        frames = self._frames.seen_by(vehicle)
        self._follow(frames)
        colour = "rgb" in channels
        exposure_ev = camera.settings.capture(image_type).exposure_ev if colour else 0.0
        view = (vehicle, camera.model(image_type), exposure_ev, colour)
        renderer = self._renderers.pop(view, None)
        if renderer is None:
            renderer = self._make(frames, view)
            while len(self._renderers) >= _MOST_RENDERERS:
                del self._renderers[next(iter(self._renderers))]
        self._renderers[view] = renderer  # the latest one is the last
        out = renderer.buffers(*channels)
        renderer.render(place.optical, out)
        if colour:
            self._draw_drops(camera, place, view[1], out["rgb"])
        return out

    def _draw_drops(self, camera: ServedCamera, place: CameraPlace, model: CameraModel, rgb: NDArray[np.uint8]) -> None:
        """Draw the streaks of rain and snow. Their noise depends on the camera and the tick alone."""
        scene = self._surroundings.present(self._world.scene)
        falling = scene.weather.precipitation
        if falling is None:
            return
        if self._streaks_in != (scene.weather, self._world.wind_W_mps):
            self._streaks_in = scene.weather, self._world.wind_W_mps
            self._streaks.clear()
        key = (camera.key, model)
        if key not in self._streaks:
            if len(self._streaks) >= _MOST_RENDERERS:
                self._streaks.clear()
            self._streaks[key] = RainStreaks(
                falling,
                model,
                exposure_s=USUAL_EXPOSURE_S,
                wind_W_mps=self._world.wind_W_mps,
                key=noise_key(1, f"{camera.key}.rain"),
            )
        v_W = (0.0, 0.0, 0.0) if camera.drone is None else camera.drone.vehicle.truth.v_WB_W
        self._streaks[key].draw(rgb, replace(place.optical, v_WC_W=v_W), self._world.tick)

    def _follow(self, frames: SharedFrames) -> None:
        """Drop the renderers of a world or a light that is gone."""
        if self._frames.generation != self._generation:
            self._generation = self._frames.generation
            self._renderers.clear()
        around, t_ns = self._surroundings, self._world.t_ns
        state = light_state(around, t_ns)
        if state != self._light_state:
            self._light_state = state
            self._light = present_light(self._world.scene, around, self._origin, t_ns)
            self._renderers = {view: kept for view, kept in self._renderers.items() if not view[3]}
            prepared = frames.geometry.prepared
            for key in [key for key in prepared if isinstance(key, tuple) and key[0] is SunShadows]:
                del prepared[key]

    def _make(self, frames: SharedFrames, view: _View) -> FrameRenderer:
        _, model, exposure_ev, colour = view
        level = QUALITIES["high"]
        planes_m = (NEAR_M, FAR_M)
        large = model.width * model.height > _LARGE_PIXELS
        execution = Execution(threads=min(os.cpu_count() or 1, 16) if large else 1)
        try:
            if not colour:
                return FrameRenderer(frames.geometry, model, planes_m=planes_m, execution=execution)
            shading = level.shading
            if exposure_ev != 0.0:
                shading = replace(shading, exposure_ev=shading.exposure_ev + exposure_ev)
            return FrameRenderer(
                frames.geometry,
                model,
                shadows=level.shadows,
                supersample=level.supersample,
                planes_m=planes_m,
                light=self._light,
                shading=shading,
                execution=execution,
            )
        except ValueError as error:
            raise RpcError(f"this camera cannot be drawn: {error}") from None
