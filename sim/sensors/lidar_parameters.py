"""Parameters of a LiDAR, as in a bench file or a preset."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from sim.sensors.lidar_pattern import AnyPattern
from sim.sensors.sensor import Attitude, Position, check_order

Distance = Annotated[float, Field(gt=0.0, le=10_000.0)]


class Sunlight(StrictModel):
    """Noise of sunlight in the receiver; equations: sim/sensors/lidar_sun.py. The defaults are choices."""

    white_ground_noise: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0  # variance, in parts of the receiver's own
    threshold_sigma: Annotated[float, Field(ge=4.0, le=20.0)] = 8.0  # of detection, over the noise
    greatest_rise: Annotated[float, Field(ge=1.0, le=1000.0)] = 4.0  # of the threshold


class LidarParameters(StrictModel):
    """Pattern, limits and errors of a LiDAR; deviations are 1 sigma."""

    pattern: AnyPattern
    min_range_m: Annotated[float, Field(ge=0.0, le=1000.0)]
    max_range_m: Distance
    range_noise_m: Annotated[float, Field(ge=0.0, le=10.0)]
    range_resolution_m: Annotated[float, Field(gt=0.0, le=1.0)]
    # Range up to which a head-on surface of 10 % reflectivity is detected; null: all surfaces up to max_range_m.
    range_at_10_percent_m: Distance | None = None
    dropout_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    # Range beyond which intensity falls with the square of the range; null: the device compensates for range.
    intensity_falloff_m: Distance | None = None
    beam_divergence_rad: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0  # full angle; 0: one ray per point
    aperture_m: Annotated[float, Field(ge=0.0, le=0.5)] = 0.01  # width of the beam at the device; drops matter by it
    # Strength of the weakest echo of a drop or of fog that the receiver reports at any range, however near.
    least_drop_echo: Annotated[float, Field(gt=0.0, le=1.0)] = 0.005
    pulse_s: Annotated[float, Field(ge=1e-9, le=1e-7)] = 2e-8  # half-power width; fog returns light by it
    echo: Literal["strongest", "first", "last"] = "strongest"  # for a beam that hits several surfaces
    echo_separation_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3  # surfaces closer to each other give one echo
    retroreflectors: bool = False  # signs and number plates return light to where it came from
    sunlight: Sunlight | None = None  # null: no noise of the sun
    rolling: bool = True  # false: the whole sweep at the instant of capture
    subsweeps: Annotated[int, Field(ge=1, le=1000)] = 10  # number of times that actors are posed in a sweep
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    mount_rpy_deg: Attitude = (0.0, 0.0, 0.0)  # about the axes of B; zeros: the axes of B
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _limits_in_order(self) -> LidarParameters:
        check_order(("min_range_m", self.min_range_m), ("max_range_m", self.max_range_m))
        return self
