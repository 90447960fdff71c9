"""Cameras: `CameraDefaults`, `Cameras` of a vehicle, `ExternalCameras`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hil.apps.airsim.settings.reader import Reader, given, number
from signals.samples import Vec3
from sim.frame.camera_model import MAX_PIXELS_ACROSS

IMAGE_TYPES = range(-1, 12)  # -1: the view of AirSim's window; 10 and 11 are Cosys-AirSim's
_MAX_PIXELS = 4096 * 4096

# Position (m, forward right down) and roll, pitch, yaw (degrees) on AirSim's quadrotor.
BUILT_IN: Mapping[str, tuple[Vec3, Vec3]] = {
    "front_center": ((0.46, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "front_right": ((0.46, 0.125, 0.0), (0.0, 0.0, 0.0)),
    "front_left": ((0.46, -0.125, 0.0), (0.0, 0.0, 0.0)),
    "bottom_center": ((0.0, 0.0, 0.0), (0.0, -90.0, 0.0)),
    "back_center": ((-0.46, 0.0, 0.0), (0.0, 0.0, 180.0)),
}
_NUMBERS = {"": "front_center", **{str(i): name for i, name in enumerate(BUILT_IN)}}

_EXPOSURE = (
    "AutoExposureSpeed", "AutoExposureSpeedUp", "AutoExposureSpeedDown", "AutoExposureMaxBrightness",
    "AutoExposureMinBrightness", "AutoExposureMethod", "AutoExposureLowPercent", "AutoExposureHighPercent",
    "AutoExposureHistogramLogMin", "AutoExposureHistogramLogMax", "AutoExposureApplyPhysicalCameraExposure",
    "TargetGamma", "MotionBlurAmount", "MotionBlurMax", "MotionBlurTargetFPS", "BloomIntensity", "BloomThreshold",
    "ChromaticAberrationIntensity", "ChromaticAberrationStartOffset", "ChromaticAberrationScale",
    "CameraShutterSpeed", "CameraISO", "CameraAperture", "CameraMaxAperture", "CameraNumBlades",
    "LensFlareIntensity", "LensFlareBokehSize", "LensFlareThreshold", "DepthOfFieldSensorWidth",
    "DepthOfFieldSqueezeFactor", "DepthOfFieldFocalDistance", "DepthOfFieldDepthBlurAmount",
    "DepthOfFieldDepthBlurRadius", "DepthOfFieldUseHairDepth", "ForceUpdate", "IgnoreMarked", "LumenGIEnable",
    "LumenReflectionEnable", "LumenFinalQuality", "LumenSceneDetail", "LumenSceneLightningDetail",
)  # fmt: skip
_LENS_EFFECTS = (
    "LensDistortionEnable", "LensDistortionAreaFalloff", "LensDistortionAreaRadius", "LensDistortionIntensity",
    "LensDistortionInvert", "FakeMotionBlurEnable", "FakeMotionBlurDirectionX", "FakeMotionBlurDirectionY",
    "FakeMotionBlurMovementSpeed", "FakeMotionBlurShutterSpeed", "FakeMotionBlurFocalLength", "FakeMotionBlurSamples",
    "RadialBlurEnable", "RadialBlurDistance", "RadialBlurRadius", "RadialBlurDensity", "GuassianBlurEnable",
    "GuassianBlurDirections", "GuassianBlurQuality", "GuassianBlurSize",
)  # fmt: skip


@dataclass(frozen=True)
class Capture:
    """Image of one type of one camera."""

    width_px: int = 256
    height_px: int = 144
    fov_deg: float = 90.0
    exposure_ev: float = 0.0


def _of_noise(default: float, key: str) -> Any:
    return number(default, -1e9, 1e9, key)


@dataclass(frozen=True)
class Noise:
    """Noise of one image type, with the names and units of AirSim's post-processing material."""

    enabled: bool = given(False, "Enabled")
    rand_contrib: float = _of_noise(0.2, "RandContrib")
    rand_speed: float = _of_noise(100_000.0, "RandSpeed")
    rand_size: float = _of_noise(500.0, "RandSize")
    rand_density: float = _of_noise(2.0, "RandDensity")
    horz_wave_contrib: float = _of_noise(0.03, "HorzWaveContrib")
    horz_wave_strength: float = _of_noise(0.08, "HorzWaveStrength")
    horz_wave_vert_size: float = _of_noise(1.0, "HorzWaveVertSize")
    horz_wave_screen_size: float = _of_noise(1.0, "HorzWaveScreenSize")
    horz_noise_lines_contrib: float = _of_noise(1.0, "HorzNoiseLinesContrib")
    horz_noise_lines_density_y: float = _of_noise(0.01, "HorzNoiseLinesDensityY")
    horz_noise_lines_density_xy: float = _of_noise(0.5, "HorzNoiseLinesDensityXY")
    horz_distortion_contrib: float = _of_noise(1.0, "HorzDistortionContrib")
    horz_distortion_strength: float = _of_noise(0.002, "HorzDistortionStrength")


@dataclass(frozen=True)
class Gimbal:
    """Angles fixed in the world; None: the angle moves with the vehicle. `stabilization`: 0 no gimbal, 1 full."""

    stabilization: float = 0.0
    roll_deg: float | None = None
    pitch_deg: float | None = None
    yaw_deg: float | None = None


@dataclass(frozen=True)
class Camera:
    """One camera, relative to the vehicle (forward, right, down), or to the world (north, east, down) if external."""

    position_m: Vec3 = (0.0, 0.0, 0.0)
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    captures: Mapping[int, Capture] = field(default_factory=dict)
    noises: Mapping[int, Noise] = field(default_factory=dict)
    gimbal: Gimbal = Gimbal()

    def capture(self, image_type: int) -> Capture:
        """Return size and field of view of an image type."""
        return self.captures.get(image_type, Capture())

    def noise(self, image_type: int) -> Noise:
        """Return the noise of an image type."""
        return self.noises.get(image_type, Noise())


def camera_name(name: str) -> str:
    """Return the name of a camera that may be given as "", "0" to "4" or by its name."""
    return _NUMBERS.get(name, name)


def camera_of(cameras: Mapping[str, Camera], name: str) -> str:
    """Return the name in `cameras` of one that a client means: "fpv" is the front one, or one of the file's own."""
    own = camera_name(name)
    return "front_center" if own == "fpv" and own not in cameras else own


def built_in_cameras(defaults: Camera) -> dict[str, Camera]:
    """Return the five cameras that every vehicle has. Their poses do not come from `CameraDefaults`."""
    return {name: replace(defaults, position_m=p, rotation_deg=r) for name, (p, r) in BUILT_IN.items()}


def read_cameras(vehicle: Reader, defaults: Camera) -> dict[str, Camera]:
    """Return the cameras of a vehicle: the built-in ones first, as far as `Cameras` does not change them."""
    cameras = built_in_cameras(defaults)
    for name, reader in vehicle.named("Cameras") or []:
        own = camera_name(name)
        cameras[own] = read_camera(reader, cameras.get(own, defaults))
    return cameras


def read_camera(reader: Reader, defaults: Camera) -> Camera:
    """Return one camera; what it does not give is taken from `defaults`."""
    captures, noises, gimbal = dict(defaults.captures), dict(defaults.noises), defaults.gimbal
    for item in reader.listed("CaptureSettings"):
        image_type = _image_type(item)
        captures[image_type] = _read_capture(item)
    for item in reader.listed("NoiseSettings"):
        image_type = _image_type(item)
        noises[image_type] = _read_noise(item)
    if (child := reader.child("Gimbal")) is not None:
        angles = (child.optional(key, -3600.0, 3600.0) for key in ("Roll", "Pitch", "Yaw"))
        gimbal = Gimbal(child.number("Stabilization", 0.0, 0.0, 1.0), *angles)
        child.close("Gimbal")
    position_m, rotation_deg = reader.vector(defaults.position_m), reader.angles_deg(defaults.rotation_deg)
    reader.without_meaning("UnrealEngine", "DrawSensor", "ExternalLocal")
    if reader.flag("External", False):
        reader.problem("External", "is not supported on a vehicle's camera", "put the camera into ExternalCameras")
    reader.close("Cameras")
    return Camera(position_m, rotation_deg, captures, noises, gimbal)


def _image_type(reader: Reader) -> int:
    return reader.whole("ImageType", 0, IMAGE_TYPES[0], IMAGE_TYPES[-1])


def _read_capture(reader: Reader) -> Capture:
    """Return one entry of CaptureSettings. It replaces the default of its image type as a whole, as in AirSim."""
    width = reader.whole("Width", 256, 1, MAX_PIXELS_ACROSS)
    height = reader.whole("Height", 144, 1, MAX_PIXELS_ACROSS)
    if width * height > _MAX_PIXELS:
        reader.problem(None, f"asks for an image of {width * height / 1e6:.0f} million pixels", "16 million at most")
    fov = reader.optional("FOV_Degrees", 0.01, 170.0)
    ev = reader.optional("AutoExposureBias", -10.0, 10.0)
    ev = reader.optional("AutoExposureCompensation", -10.0, 10.0) if ev is None else ev
    if reader.choice("ProjectionMode", "Perspective", ("Perspective", "Orthographic"), any_case=True) != "Perspective":
        reader.problem("ProjectionMode", "must be Perspective: the cameras here have no orthographic projection")
    reader.without_meaning("OrthoWidth", *_EXPOSURE)
    reader.close("CaptureSettings")
    return Capture(width, height, 90.0 if fov is None else fov, ev or 0.0)


def _read_noise(reader: Reader) -> Noise:
    noise = Noise(**reader.values(Noise))
    reader.without_meaning(*_LENS_EFFECTS)
    reader.close("NoiseSettings")
    return noise
