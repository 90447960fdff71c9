"""Battery of a vehicle. Equations: sim/native/battery.hpp."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from signals.documents.validate import StrictModel


class Battery(StrictModel):
    """Lithium-polymer pack that limits the speed of the rotors.

    The rotors' `max_speed_radps` holds at `nominal_voltage_v` and scales with the voltage.
    """

    cells: Annotated[int, Field(ge=1, le=24)]
    capacity_ah: Annotated[float, Field(gt=0.0, le=1000.0)]
    resistance_ohm: Annotated[float, Field(ge=0.0, le=10.0)]  # pack with its leads
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)]  # speed controller and motor: shaft power over electrical
    auxiliary_w: Annotated[float, Field(ge=0.0, le=10_000.0)]  # constant load besides the rotors
    nominal_voltage_v: Annotated[float, Field(gt=0.0, le=1000.0)]
    initial_charge: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  # state of charge at the start


class BatteryState(NamedTuple):
    """State of a battery at one tick."""

    charge: float  # state of charge, 1 full, 0 empty
    voltage_v: float  # at the start of the last tick
    current_a: float  # mean over that tick
