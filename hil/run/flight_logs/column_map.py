"""Map of a table's columns: which columns hold what, in which unit and frame. The file of `hil identify --columns`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.units import STANDARD_GRAVITY_MPS2

Name = Annotated[str, Field(min_length=1, max_length=200)]
Three = tuple[Name, Name, Name]

TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
SPEED_UNITS: Mapping[str, float] = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6, "ft/s": 0.3048}
RATE_UNITS: Mapping[str, float] = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "mrad/s": 1e-3}
ACCEL_UNITS: Mapping[str, float] = {"m/s2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2}
VOLTAGE_UNITS: Mapping[str, float] = {"V": 1.0, "mV": 1e-3}
ANGLE_UNITS: Mapping[str, float] = {"rad": 1.0, "deg": math.pi / 180.0}
MOTOR_UNITS: Mapping[str, float] = {"rad/s": 1.0, "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi}


class Time(StrictModel):
    """Column of the time, and its unit."""

    column: Name
    unit: Literal["s", "ms", "us", "ns"]


class Motors(StrictModel):
    """Columns of the motors in the order of the vehicle file's rotors.

    `command`: numbers between `range`, which become 0 to 1. `speed`: in `unit`, times `scale`; electrical speeds have
    1 / (pole pairs) as their scale. `late_s`: how much later than the motor the telemetry is, if known.
    """

    columns: Annotated[tuple[Name, ...], Field(min_length=1, max_length=8)]
    kind: Literal["command", "speed"]
    range: tuple[float, float] | None = None
    unit: Literal["rad/s", "rpm", "rev/s"] | None = None
    scale: Annotated[float, Field(gt=0.0, le=1e3)] = 1.0
    late_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0

    @pydantic.model_validator(mode="after")
    def _complete(self) -> Motors:
        if self.kind == "command" and (self.range is None or self.unit is not None):
            raise ValueError("commands need their range, such as range: [0, 65535], and no unit")
        if self.kind == "speed" and (self.unit is None or self.range is not None):
            raise ValueError(f"speeds need their unit, one of {', '.join(MOTOR_UNITS)}, and no range")
        if self.range is not None and not self.range[1] > self.range[0]:
            raise ValueError(f"the range {list(self.range)} must rise from stop to full")
        return self


class Position(StrictModel):
    columns: Three
    unit: Literal["m", "cm", "mm", "ft"]


class Velocity(StrictModel):
    columns: Three
    unit: Literal["m/s", "cm/s", "mm/s", "km/h", "ft/s"]


class Rate(StrictModel):
    columns: Three
    unit: Literal["rad/s", "deg/s", "mrad/s"]


class Accel(StrictModel):
    """Specific force: upwards 1 g at rest."""

    columns: Three
    unit: Literal["m/s2", "g", "mg"]


class Attitude(StrictModel):
    """Attitude of the body in the world: a quaternion in the order w, x, y, z, or roll, pitch, yaw with a unit."""

    quaternion: tuple[Name, Name, Name, Name] | None = None
    euler: Three | None = None
    unit: Literal["rad", "deg"] | None = None

    @pydantic.model_validator(mode="after")
    def _one(self) -> Attitude:
        if (self.quaternion is None) == (self.euler is None):
            raise ValueError("give either quaternion: [w, x, y, z] or euler: [roll, pitch, yaw]")
        if (self.euler is not None) != (self.unit is not None):
            raise ValueError("euler needs its unit, rad or deg, and a quaternion has none")
        return self


class Voltage(StrictModel):
    column: Name
    unit: Literal["V", "mV"]


class Yaw(StrictModel):
    """Heading from the world's first axis towards its second: from east to north in enu, from north to east in ned."""

    column: Name
    unit: Literal["rad", "deg"]


class SetPointColumns(StrictModel):
    """Set-points of the vehicle in the map's world, for `hil run --follow`; an empty cell: not commanded."""

    position: Position | None = None
    velocity: Velocity | None = None
    yaw: Yaw | None = None

    @pydantic.model_validator(mode="after")
    def _leads_somewhere(self) -> SetPointColumns:
        if self.position is None and self.velocity is None:
            raise ValueError("set-points need the columns of a position or a velocity")
        return self


class ColumnMap(StrictModel):
    """Map of one table. World and body hold for all its vectors and the attitude."""

    time: Time
    world: Literal["enu", "ned"]
    body: Literal["flu", "frd"]
    motors: Motors
    estimated: bool  # position and attitude are an autopilot's estimate, not motion capture
    position: Position | None = None
    attitude: Attitude | None = None
    velocity: Velocity | None = None
    rate: Rate | None = None
    accel: Accel | None = None
    voltage: Voltage | None = None
    set_points: SetPointColumns | None = None
    # Height of the floor in the world, for the ground effect; None: where the vehicle stands before take-off.
    ground_m: Annotated[float, Field(ge=-1e4, le=1e4)] | None = None

    @pydantic.model_validator(mode="after")
    def _one_convention(self) -> ColumnMap:
        if self.attitude is not None and (self.world == "enu") != (self.body == "flu"):
            raise ValueError(f"an attitude from {self.body} to {self.world} is unusual: enu with flu, or ned with frd")
        return self
