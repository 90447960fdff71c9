"""What can be said about a LiDAR in a bench file or a preset."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from hil.signals.documents.validate import StrictModel
from sim.sensors.lidar_pattern import AnyPattern
from sim.sensors.sensor import Position, check_order

Distance = Annotated[float, Field(gt=0.0, le=10_000.0)]
_Angle = Annotated[float, Field(ge=-360.0, le=360.0)]


class LidarParameters(StrictModel):
    """Where it looks and how well it measures; deviations 1 sigma."""

    pattern: AnyPattern
    min_range_m: Annotated[float, Field(ge=0.0, le=1000.0)]
    max_range_m: Distance
    range_noise_m: Annotated[float, Field(ge=0.0, le=10.0)]
    range_resolution_m: Annotated[float, Field(gt=0.0, le=1.0)]
    # Range to which a head-on surface of 10 % reflectivity is seen; null: everything within max_range_m is.
    range_at_10_percent_m: Distance | None = None
    dropout_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    # Range from which on intensity falls with its square; null: the device makes up for range.
    intensity_falloff_m: Distance | None = None
    beam_divergence_rad: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0  # full angle; 0: one ray a point
    echo: Literal["strongest", "first", "last"] = "strongest"  # of a beam that meets several surfaces
    echo_separation_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3  # surfaces nearer to each other are one echo
    rolling: bool = True  # false: the whole sweep at the instant of capture
    subsweeps: Annotated[int, Field(ge=1, le=1000)] = 10  # times that the scene's movers are posed in a sweep
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    mount_rpy_deg: tuple[_Angle, _Angle, _Angle] = (0.0, 0.0, 0.0)  # turns about the axes of B; zeros: L as B
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _limits_in_order(self) -> LidarParameters:
        check_order(("min_range_m", self.min_range_m), ("max_range_m", self.max_range_m))
        return self
