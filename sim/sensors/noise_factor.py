"""Random factor f on all errors of a sensor.

White noise, bias noise, drift, turn-on errors and the like are multiplied; design values (ranges, rates, words,
latencies) are not. The electrons of a camera are divided by f^2 and its read noise by f, so that shot and read noise
relative to white grow by f. A camera without noise first gets the noise of a small daylight camera.
"""

from __future__ import annotations

from typing import Any

from signals.documents.validate import StrictModel
from sim.randomize.settings import NoiseLimits
from sim.scene.random_generator import feature_rng
from sim.sensors.camera_parameters import CameraParameters, LightNoise

_DAYLIGHT_CAMERA = LightNoise(electrons_at_white=10_000.0, read_noise_electrons=5.0)

# Parameters that are multiplied.
SCALED: dict[str, tuple[str, ...]] = {
    "imu": (
        "accel_noise_mps2_per_rthz",
        "gyro_noise_radps_per_rthz",
        "accel_bias_instability_mps2",
        "gyro_bias_instability_radps",
        "accel_walk_mps3_per_rthz",
        "gyro_walk_radps2_per_rthz",
        "accel_turn_on_bias_mps2",
        "gyro_turn_on_bias_radps",
        "accel_scale_error",
        "gyro_scale_error",
        "accel_misalignment_rad",
        "gyro_misalignment_rad",
    ),
    "gps": (
        "horizontal_noise_m",
        "vertical_noise_m",
        "horizontal_drift_m",
        "vertical_drift_m",
        "horizontal_speed_noise_mps",
        "vertical_speed_noise_mps",
    ),
    "lidar": ("range_noise_m",),
    "camera": (),
}


def noise_factor(limits: NoiseLimits, seed: int, kind: str, name: str) -> float | None:
    """Return the factor of the sensor `name`, a pure function of the arguments; None for kinds without a factor."""
    kind_limits = getattr(limits, kind, None) if kind in SCALED else None
    return None if kind_limits is None else feature_rng(seed, "noise", name).log_between(*kind_limits)


def with_noise(kind: str, parameters: StrictModel, factor: float) -> StrictModel:
    """Return parameters with `factor` times the errors. Raises pydantic.ValidationError beyond their limits."""
    changed: dict[str, Any] = {key: factor * getattr(parameters, key) for key in SCALED[kind]}
    if isinstance(parameters, CameraParameters):
        noise = parameters.noise or _DAYLIGHT_CAMERA
        changed["noise"] = {
            "electrons_at_white": noise.electrons_at_white / (factor * factor),
            "read_noise_electrons": noise.read_noise_electrons / factor,
        }
        depth = parameters.depth_noise
        if depth is not None:
            worse = {"sigma_m": factor * depth.sigma_m, "sigma_per_m": factor * depth.sigma_per_m}
            changed["depth_noise"] = depth.model_dump() | worse
    return type(parameters).model_validate(parameters.model_dump() | changed)
