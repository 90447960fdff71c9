"""How much worse or better each sensor of a seed is: one factor on all its errors.

White noise, noise of bias and drift, turn-on errors and the like are multiplied; what a device is by design (ranges,
rates, words, latencies) is not. A camera's shot noise is that of 1 / f^2 of the electrons, its read noise is f times as
large beside white; a camera without any noise is taken for a small daylight camera first, or its pictures would be the
only ones without.
"""

from __future__ import annotations

from typing import Any

from hil.signals.documents.validate import StrictModel
from sim.randomize.draw import between_logarithms, dice
from sim.randomize.settings import NoiseLimits
from sim.sensors.camera_parameters import CameraParameters, LightNoise

_PLAIN_CAMERA = LightNoise(electrons_at_white=10_000.0, read_noise_electrons=5.0)

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
    """Of the sensor `name`; None for kinds that nothing is drawn for. A pure function."""
    of_kind = getattr(limits, kind, None) if kind in SCALED else None
    return None if of_kind is None else between_logarithms(dice(seed, "noise", name), of_kind)


def with_noise(kind: str, parameters: StrictModel, factor: float) -> StrictModel:
    """The sensor with its errors `factor` times as large. pydantic.ValidationError: beyond what it may be."""
    changed: dict[str, Any] = {key: factor * getattr(parameters, key) for key in SCALED[kind]}
    if isinstance(parameters, CameraParameters):
        noise = parameters.noise or _PLAIN_CAMERA
        changed["noise"] = {
            "electrons_at_white": noise.electrons_at_white / (factor * factor),
            "read_noise_electrons": noise.read_noise_electrons / factor,
        }
        depth = parameters.depth_noise
        if depth is not None:
            worse = {"sigma_m": factor * depth.sigma_m, "sigma_per_m": factor * depth.sigma_per_m}
            changed["depth_noise"] = depth.model_dump() | worse
    return type(parameters).model_validate(parameters.model_dump() | changed)
