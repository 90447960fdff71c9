"""Renderer of a camera: any set of channels of one frame; only requested channels are computed.

Method and accuracy of the native raster: sim/native/frame/raster.hpp and resolve.hpp, docs/frames.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.channels import CHANNELS
from signals.classes import Classes
from sim import _kernels
from sim._kernels import Daylight, FieldOfView, Picture, Scenery, SkyVisibility, SunShadows, mean_of_four
from sim.frame.camera_model import MAX_PIXELS_ACROSS, CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.derived import Fill, View, fill_of
from sim.frame.geometry import FrameGeometry
from sim.frame.shading import PLAIN, Shading
from sim.scene.light import Light, light_in_haze
from sim.scene.weather import HAZE_M

__all__ = ["CameraPose", "FrameRenderer", "RenderSkips"]

SUPERSAMPLES = (1, 2, 4)  # samples of colour along the edge of a pixel
_SHADOW_PIXELS = 2048  # along the longer edge of the scene
_SKY_CELL_M, _SKY_REACH_M = 1.0, 10.0
_GROUND_LIGHT = 0.45  # share of the ambient light that the ground reflects


@dataclass(frozen=True)
class RenderSkips:
    """Skipping of work that cannot change the picture. Without it: the same bits, but slower (`hil bench skip`).

    Except `mesh_backs`: on outlines, where front and back of a fine mesh are closer than the rounding of their
    distances, a few pixels in a million differ, in depth by at most 2 mm (measured in three maps, up to 40 m away).
    """

    frustum: bool = True  # geoms and branches of the tree outside the picture, pixels outside a geom's bounds
    occlusion: bool = True  # geometry hidden in all its pixels
    mesh_backs: bool = True  # triangles of closed meshes that face away
    static_shadows: bool = True  # the shadow map of static geoms is drawn once
    unseen_actors: bool = True  # actors that no pixel (and no shadow) can show are not posed
    unseen_shadows: bool = True  # moving geoms whose shadows no pixel can show are not drawn in the shadow map

    @classmethod
    def none(cls) -> RenderSkips:
        """Return the switches with all skipping off."""
        return cls(**{field.name: False for field in fields(cls)})


@dataclass(frozen=True)
class Execution:
    """Threads, skipping and instruction set. Every choice gives the same picture, but for `RenderSkips.mesh_backs`."""

    threads: int = 1
    skips: RenderSkips = RenderSkips()
    isa: str = ""  # instruction set of the kernels; "": the best of the processor


class FrameRenderer:
    """Renderer of one camera's view of a geometry.

    `planes_m`: near and far plane, the minimum and maximum visible depth (range, for a camera that is not a pinhole).
    `supersample` 2 (4) averages colour over 2 x 2 (4 x 4) rays per pixel in linear light; the other channels always
    belong to the pixel's centre ray. `light` replaces the scene's light. Raises ValueError for a value outside its
    range.
    """

    def __init__(
        self,
        geometry: FrameGeometry,
        camera: CameraModel,
        *,
        shadows: bool = False,
        supersample: int = 1,
        planes_m: tuple[float, float] = (0.05, 10_000.0),
        light: Light | None = None,
        shading: Shading = PLAIN,
        execution: Execution = Execution(),
    ) -> None:
        near_m, far_m = planes_m
        threads, isa = execution.threads, execution.isa
        if not 0.0 < near_m < far_m <= 1e5:
            raise ValueError(f"planes_m ({near_m:g}, {far_m:g}): need 0 < near < far <= 100000")
        if supersample not in SUPERSAMPLES:
            raise ValueError(f"supersample must be 1, 2 or 4, not {supersample}")
        if threads < 1:
            raise ValueError(f"threads must be at least 1, not {threads}")
        self.geometry = geometry
        self.camera = camera
        self.near_m, self.far_m, self.threads, self.skips = near_m, far_m, threads, execution.skips
        self._edges = _edges(camera)
        self._sources: dict[str, NDArray[Any]] = {}  # of derived channels, where the caller does not want them
        self._fills: dict[str, Fill] = {}
        self._view = View(
            geometry, camera, Classes(geometry.world.class_names, geometry.world.class_colours), shadows=shadows
        )
        scenery = geometry.scenery if shading.textures else geometry.plain_scenery
        made = (shading.native(), isa)
        self._picture = _picture(geometry, scenery, camera, 1, *made)
        self._supersampled = _picture(geometry, scenery, camera, supersample, *made) if supersample > 1 else None
        self._finer: Picture | None = None
        if shading.smooth_edges and supersample == 1 and _has_samples(camera):
            self._finer = _picture(geometry, scenery, camera, 2, *made)
        # Buffers of the supersampled picture, and of its reductions by 2 x 2 down to twice the camera's size.
        self._larger_rgb: list[NDArray[np.uint8]] = []
        while supersample > 1:
            self._larger_rgb.append(np.empty((supersample * camera.height, supersample * camera.width, 3), np.uint8))
            supersample //= 2
        extinction_per_m = geometry.world.scene.extinction_per_m if light is None else light.fog_per_m
        light = light if light is not None else geometry.world.scene.light
        self._light = daylight(light, extinction_per_m, surroundings=shading.surroundings)
        self._shadows: SunShadows | None = None
        self._sky = sky_visibility(geometry, isa) if shading.ambient_occlusion else None
        if shadows and light.sun_elevation_deg > 0.0:
            self._shadows = sun_shadows(geometry, light, isa)

    def buffers(self, *channels: str) -> dict[str, NDArray[Any]]:
        """Return new arrays for these channels."""
        return {name: CHANNELS[name].empty(self.camera.height, self.camera.width) for name in channels}

    def render(self, pose: CameraPose, out: Mapping[str, NDArray[Any]], *, rows: tuple[int, int] | None = None) -> None:
        """Fill exactly the channels in `out` (caller-owned, C-contiguous), at the geometry's time.

        `rows`: only pixel rows [from, to), multiples of 4 or the height. Raises KeyError for a channel that does not
        exist, TypeError for an array of another type or shape, ValueError for rows outside the picture.
        """
        for name in out:
            if name not in CHANNELS:
                raise KeyError(f"no channel {name!r}; channels: {', '.join(CHANNELS)}")
        if not out:
            return
        sources = self._with_sources(out)
        derived = [name for name in CHANNELS if name in sources and CHANNELS[name].of]
        arrays = {name: array for name, array in sources.items() if name not in derived}
        shadows = self._shadows if "rgb" in arrays else None
        # With shadows all actors are posed: an actor out of sight may cast a visible shadow.
        skip_unseen = self.skips.unseen_actors and shadows is None and self.camera.pinhole
        if not self.geometry.settled:
            self.geometry.pose_within(FieldOfView(pose.p_WC, pose.R_WC, *self._edges) if skip_unseen else None)
        if shadows is not None:
            seen_by = self._picture if self.skips.unseen_shadows and self.camera.pinhole else None
            shadows.update(self.skips.static_shadows, seen_by, pose.p_WC, pose.R_WC)
        first, last = rows if rows is not None else (0, self.camera.height)
        if self._supersampled is not None and "rgb" in arrays:
            buffers, out_rgb = self._larger_rgb, arrays.pop("rgb")
            scale = 1 << len(buffers)
            self._draw(self._supersampled, pose, shadows, {"rgb": buffers[0]}, scale * first, scale * last)
            for larger, smaller in pairwise([*buffers, out_rgb]):
                scale //= 2
                mean_of_four(larger[2 * scale * first : 2 * scale * last], smaller[scale * first : scale * last])
        if arrays:
            self._draw(self._picture, pose, shadows, arrays, first, last, self._finer)
        for name in derived:
            if name not in self._fills:
                self._fills[name] = fill_of(name, self._view)
            rows_of = {source: sources[source][first:last] for source in CHANNELS[name].of}
            self._fills[name](rows_of, pose, first, sources[name][first:last])

    def _with_sources(self, out: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the arrays of `out`, and own ones of all channels that these are computed from."""
        arrays = dict(out)
        wanted = [source for name in out for source in CHANNELS[name].of]
        while wanted:
            source = wanted.pop()
            wanted += CHANNELS[source].of
            if source not in arrays:
                if source not in self._sources:
                    self._sources |= self.buffers(source)
                arrays[source] = self._sources[source]
        return arrays

    def _draw(
        self,
        picture: Picture,
        pose: CameraPose,
        shadows: SunShadows | None,
        out: dict[str, NDArray[Any]],
        first: int,
        last: int,
        finer: Picture | None = None,
    ) -> None:
        picture.take(
            pose.p_WC,
            pose.R_WC,
            pose.v_WC_W,
            self._light,
            shadows,
            out,
            self.near_m,
            self.far_m,
            self.skips.frustum,
            self.skips.occlusion,
            self.skips.mesh_backs,
            first,
            last,
            self.threads,
            self._sky,
            finer if "rgb" in out else None,
        )


def _edges(camera: CameraModel) -> tuple[float, float, float, float]:
    """Return the tangents of a pinhole's left, right, top and bottom edges, with a margin of a pixel."""
    return (
        (-camera.cx - 1.0) / camera.fx,
        (camera.width + 1.0 - camera.cx) / camera.fx,
        (-camera.cy - 1.0) / camera.fy,
        (camera.height + 1.0 - camera.cy) / camera.fy,
    )


def _has_samples(camera: CameraModel) -> bool:
    """Return True if the camera has rays at the quarters of its pixels: a lens may end between them and the centres."""
    if camera.pinhole:
        return True
    if 2 * max(camera.width, camera.height) > MAX_PIXELS_ACROSS:
        return False
    try:
        camera.scaled(2).rays()
    except ValueError:
        return False
    return True


def _picture(
    geometry: FrameGeometry, scenery: Scenery, camera: CameraModel, scale: int, shading: _kernels.Shading, isa: str
) -> Picture:
    if camera.pinhole:
        return Picture(
            geometry.native,
            scenery,
            scale * camera.width,
            scale * camera.height,
            scale * camera.fx,
            scale * camera.fy,
            scale * camera.cx,
            scale * camera.cy,
            isa,
            shading,
        )
    scaled = camera if scale == 1 else camera.scaled(scale)
    return Picture(geometry.native, scenery, np.ascontiguousarray(scaled.rays(), np.float64), isa, shading)


def daylight(light: Light, extinction_per_m: float = 0.0, *, surroundings: bool = False) -> Daylight:
    """Return the light of a scene for the kernels. `surroundings`: clouds, and distant land at the horizon."""
    hazy = light_in_haze(light, extinction_per_m)
    ambient = hazy.ambient_rgb
    ground = (_GROUND_LIGHT * ambient[0], _GROUND_LIGHT * ambient[1], _GROUND_LIGHT * ambient[2])
    return Daylight(
        light.to_sun_W,
        hazy.sun_rgb,
        ambient,
        ground,
        light.sky_zenith_rgb,
        light.sky_horizon_rgb,
        hazy.air_rgb,
        extinction_per_m,
        HAZE_M,
        light.clouds if surroundings else -1.0,
    )


def sky_visibility(geometry: FrameGeometry, isa: str = "") -> SkyVisibility:
    """Return the ambient occlusion of a geometry's static geoms, shared by all cameras."""
    if SkyVisibility not in geometry.prepared:
        geometry.forget_all()
        geometry.prepared[SkyVisibility] = SkyVisibility(geometry.native, _SKY_CELL_M, _SKY_REACH_M, isa=isa)
    sky: SkyVisibility = geometry.prepared[SkyVisibility]
    return sky


def sun_shadows(geometry: FrameGeometry, light: Light, isa: str = "") -> SunShadows:
    """Return the shadow maps of a geometry, shared by all cameras with the same sun."""
    key = (SunShadows, light.to_sun_W, isa)
    if key not in geometry.prepared:
        geometry.prepared[key] = SunShadows(geometry.native, light.to_sun_W, _SHADOW_PIXELS, isa)
    shadows: SunShadows = geometry.prepared[key]
    return shadows
