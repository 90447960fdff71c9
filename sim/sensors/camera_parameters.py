"""Parameters of a camera, as in a bench file or a preset."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from signals.documents.validate import StrictModel
from signals.samples import CHANNEL_UNITS
from sim.frame.camera_model import MAX_FISHEYE_FOV_DEG, MAX_PIXELS_ACROSS, CameraModel
from sim.frame.distortion import BrownConrady, Distortion, KannalaBrandt
from sim.frame.quality import QualityName
from sim.frame.shading import LEVELLED, PLAIN, SRGB_WHITE_K, Shading, ToneCurve
from sim.sensors.sensor import Attitude, Position, check_order

MAX_SAMPLES = 1024  # paths per pixel
MAX_PATH_TRACED_PIXELS = 1 << 24

Pixels = Annotated[int, Field(ge=1, le=MAX_PIXELS_ACROSS)]
_Focal = Annotated[float, Field(gt=0.0, le=1e6)]
_Centre = Annotated[float, Field(ge=-1e5, le=1e5)]
_Coefficient = Annotated[float, Field(ge=-1e4, le=1e4)]


class Intrinsics(StrictModel):
    """Calibration as in OpenCV, ROS and Kalibr: pixel centres have whole numbers."""

    fx: _Focal
    fy: _Focal
    cx: _Centre
    cy: _Centre


class BrownConradyCoefficients(StrictModel):
    """Lens of an ordinary camera; equations: sim/frame/distortion.py."""

    model: Literal["brown_conrady"]
    k1: _Coefficient = 0.0
    k2: _Coefficient = 0.0
    p1: _Coefficient = 0.0
    p2: _Coefficient = 0.0
    k3: _Coefficient = 0.0
    k4: _Coefficient = 0.0
    k5: _Coefficient = 0.0
    k6: _Coefficient = 0.0


class KannalaBrandtCoefficients(StrictModel):
    """Fisheye lens; equations: sim/frame/distortion.py."""

    model: Literal["kannala_brandt"]
    k1: _Coefficient = 0.0
    k2: _Coefficient = 0.0
    k3: _Coefficient = 0.0
    k4: _Coefficient = 0.0


class ExposureControl(StrictModel):
    """Control of brightness. `auto`: the gain of a picture follows the brightness of the previous one."""

    gain: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    auto: bool = False
    target: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.18  # mean linear light that `auto` aims at
    max_gain: Annotated[float, Field(gt=0.0, le=1000.0)] = 16.0
    min_gain: Annotated[float, Field(gt=0.0, le=1000.0)] = 0.0625

    @model_validator(mode="after")
    def _limits_in_order(self) -> ExposureControl:
        check_order(("min_gain", self.min_gain), ("max_gain", self.max_gain))
        return self


class LightNoise(StrictModel):
    """Shot and read noise. `electrons_at_white`: a full well in daylight, far less indoors."""

    electrons_at_white: Annotated[float, Field(ge=1.0, le=1e7)]
    read_noise_electrons: Annotated[float, Field(ge=0.0, le=1e5)] = 0.0


class MotionBlur(StrictModel):
    """Motion blur: the mean, in linear light, of several pictures over the exposure."""

    exposure_s: Annotated[float, Field(gt=0.0, le=1.0)]
    frames: Annotated[int, Field(ge=2, le=64)] = 8


class DepthNoise(StrictModel):
    """Errors of a depth camera: noise of sigma = sigma_m + sigma_per_m z^2, then rounding, then limits.

    Time-of-flight cameras round z to `step_m`. Stereo cameras round 1/z to `inverse_step_per_m` = disparity step /
    (focal length * baseline). At most one of the two may be given.
    """

    sigma_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    sigma_per_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    step_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    inverse_step_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    min_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    max_m: Annotated[float, Field(gt=0.0, le=1e6)] = 1e6

    @model_validator(mode="after")
    def _one_rounding(self) -> DepthNoise:
        if self.step_m > 0.0 and self.inverse_step_per_m > 0.0:
            raise ValueError("step_m rounds the distance and inverse_step_per_m its inverse: give one of the two")
        check_order(("min_m", self.min_m), ("max_m", self.max_m))
        return self


class Infrared(StrictModel):
    """Output of a thermal camera (sim/frame/thermal_device.py): noise and counts of the channel `infrared`."""

    netd_k: Annotated[float, Field(ge=0.0, le=10.0)]  # noise at 300 K, 1 sigma
    counts_per_k: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    zero_k: Annotated[float, Field(ge=0.0, le=400.0)] = 0.0  # temperature of 0 counts
    bits: Annotated[int, Field(ge=8, le=16)] = 16


class LensDrops(StrictModel):
    """Raindrops on the camera's window (sim/frame/lens_drops.py); the defaults are choices."""

    stay_s: Annotated[float, Field(ge=0.1, le=60.0)] = 4.0  # mean
    exposed: Annotated[float, Field(gt=0.0, le=1.0)] = 0.3  # share of a level window's drops
    pupil_mm: Annotated[float, Field(ge=0.2, le=50.0)] = 2.0
    distance_mm: Annotated[float, Field(ge=1.0, le=200.0)] = 10.0  # from the pupil to the window


class CameraParameters(StrictModel):
    """Parameters of one camera. Its axis is at the middle of the picture unless `intrinsics` differ."""

    resolution: tuple[Pixels, Pixels]  # width, height
    # Horizontal. Give this or `intrinsics`.
    fov_deg: Annotated[float, Field(gt=0.0, le=MAX_FISHEYE_FOV_DEG)] | None = None
    intrinsics: Intrinsics | None = None
    distortion: Annotated[BrownConradyCoefficients | KannalaBrandtCoefficients, Field(discriminator="model")] | None = (
        None
    )
    channels: tuple[str, ...] = ("rgb",)  # names of signals.channels
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    mount_rpy_deg: Attitude = (0.0, 0.0, 0.0)  # zeros: looks forward; sim/frame/mount.py
    near_m: Annotated[float, Field(gt=0.0, le=100.0)] = 0.05
    far_m: Annotated[float, Field(gt=0.0, le=100_000.0)] = 10_000.0
    # Level of sim/frame/quality.py, for the report only: the level's values are already in the other parameters.
    quality: QualityName | None = None
    shadows: bool = False
    textures: bool = True  # false: each surface has its mean colour
    filtering: bool = False  # textures are interpolated (sim/frame/shading.py)
    highlights: bool = False  # surfaces mirror sun, sky and ground
    relief: bool = False  # textures of normals
    ambient_occlusion: bool = False
    smooth_edges: bool = False  # colour by coverage on outlines; supersample does so everywhere
    surroundings: bool = False  # clouds, and distant land at the horizon
    tone: ToneCurve = "linear"
    exposure_ev: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0  # doublings of the light, before the tone curve
    white_balance_k: Annotated[float, Field(ge=4000.0, le=25_000.0)] = SRGB_WHITE_K
    # Renderer of rgb: the raster, one of MuJoCo's renderers for machines with a GPU, or a path tracer (docs/frames.md).
    colour: Literal["native", "egl", "filament", "path_traced"] = "native"
    samples: Annotated[int, Field(ge=1, le=MAX_SAMPLES)] | None = None  # paths per pixel of `path_traced`
    supersample: Literal[1, 2, 4] = 1  # samples of colour along a pixel's edge
    exposure: ExposureControl = ExposureControl()
    vignetting: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0  # 1: as cos^4 of the angle to the axis
    noise: LightNoise | None = None
    motion_blur: MotionBlur | None = None
    depth_noise: DepthNoise | None = None
    lens_drops: LensDrops | None = None  # null: the window stays dry in rain
    infrared: Infrared | None = None  # null: no noise, 0.01 K a count
    # Readout time from the first row to the last; 0: global shutter.
    rolling_shutter_s: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    latency_s: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0

    @field_validator("channels")
    @classmethod
    def _known_channels(cls, channels: tuple[str, ...]) -> tuple[str, ...]:
        if not channels:
            raise ValueError("must name at least one channel")
        for channel in channels:
            if channel not in CHANNEL_UNITS:
                raise ValueError(f"there is no channel {channel!r}; channels: {', '.join(CHANNEL_UNITS)}")
        if len(set(channels)) < len(channels):
            raise ValueError("a channel is named twice")
        return channels

    @field_validator("distortion", mode="before")
    @classmethod
    def _names_its_model(cls, distortion: Any) -> Any:
        if isinstance(distortion, dict) and "model" not in distortion:
            raise ValueError("needs a model: brown_conrady or kannala_brandt")
        return distortion

    @model_validator(mode="after")
    def _could_exist(self) -> CameraParameters:
        if (self.fov_deg is None) == (self.intrinsics is None):
            raise ValueError("needs fov_deg or intrinsics, and not both (a preset's fov_deg goes with `fov_deg: null`)")
        check_order(("near_m", self.near_m), ("far_m", self.far_m))
        if self.supersample * max(self.resolution) > MAX_PIXELS_ACROSS:
            max_pixels = MAX_PIXELS_ACROSS // self.supersample
            raise ValueError(f"supersample {self.supersample} takes pictures of at most {max_pixels} pixels across")
        model = self.model()
        check_invertible(model)
        if self.colour == "path_traced":
            self._could_be_path_traced()
        elif self.samples is not None:
            raise ValueError("samples are the paths of `colour: path_traced`: leave it out, or use supersample")
        elif self.colour != "native":
            self._could_be_drawn_by_mujoco(model)
        return self

    def _could_be_path_traced(self) -> None:
        width, height = self.resolution
        if width * height > MAX_PATH_TRACED_PIXELS:
            raise ValueError(
                f"colour 'path_traced' draws at most {MAX_PATH_TRACED_PIXELS} pixels, not {width} x {height}: "
                "use a smaller resolution, or 'native'"
            )
        if self.supersample != 1:
            raise ValueError("colour 'path_traced' has `samples` paths per pixel: supersample 1, or use 'native'")

    def _could_be_drawn_by_mujoco(self, model: CameraModel) -> None:
        renderer = f"colour {self.colour!r}"
        if not model.pinhole:
            raise ValueError(f"{renderer} draws pinhole cameras only; for distortion use 'native'")
        if self.colour == "egl" and abs(model.fx - model.fy) > 1e-6 * model.fy:
            raise ValueError(f"{renderer} draws square pixels only: fx and fy must be the same, or use 'native'")
        if self.colour == "filament" and abs(model.cx - 0.5 * model.width) > 1e-6:
            raise ValueError(f"{renderer} needs the optical axis in the middle: cx = (width - 1) / 2, or use 'native'")
        if self.rolling_shutter_s > 0.0:
            raise ValueError(f"{renderer} draws the whole picture at once: no rolling_shutter_s, or use 'native'")
        if self.supersample != 1:
            raise ValueError(f"{renderer} draws the whole picture at once: supersample 1, or use 'native'")
        if self.shading() != PLAIN:
            keys = ", ".join((*LEVELLED, "white_balance_k"))
            raise ValueError(f"{renderer} has a light and a response of its own: leave out {keys}, or use 'native'")

    def shading(self) -> Shading:
        """Return the settings of the native raster's colour."""
        keys = (*LEVELLED, "white_balance_k")
        return Shading(**{key: getattr(self, key) for key in keys})

    def model(self) -> CameraModel:
        """Return the camera model. Raises ValueError if no lens has these parameters."""
        width, height = self.resolution
        lens = self._lens()
        if self.intrinsics is not None:
            i = self.intrinsics
            return CameraModel.from_opencv(width, height, i.fx, i.fy, i.cx, i.cy, lens)
        assert self.fov_deg is not None
        return CameraModel.from_fov(width, height, self.fov_deg, lens)

    def _lens(self) -> Distortion | None:
        d = self.distortion
        if isinstance(d, BrownConradyCoefficients):
            return BrownConrady(d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6)
        if isinstance(d, KannalaBrandtCoefficients):
            return KannalaBrandt(d.k1, d.k2, d.k3, d.k4)
        return None


def check_invertible(camera: CameraModel) -> None:
    """Raise ValueError if the distortion cannot be inverted at the picture's rim, the farthest pixels from the axis."""
    columns, rows = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    rim = np.concatenate(
        [
            np.stack(np.broadcast_arrays(columns, rows[0]), axis=1),
            np.stack(np.broadcast_arrays(columns, rows[-1]), axis=1),
            np.stack(np.broadcast_arrays(columns[0], rows), axis=1),
            np.stack(np.broadcast_arrays(columns[-1], rows), axis=1),
        ]
    )
    camera.directions((rim - (camera.cx, camera.cy)) / (camera.fx, camera.fy))
