"""Battery of a vehicle. Equations: sim/native/battery.hpp."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel

GAS_CONSTANT_J_PER_MOL_K = 8.31446261815324

Degrees = Annotated[float, Field(ge=-60.0, le=100.0)]


class BatteryThermal(StrictModel):
    """Temperature of the cells, and what it changes: they warm by I^2 R and cool to the air around them.

    The pack's `resistance_ohm` and `capacity_ah` hold at `reference_degc`. Without `activation_j_per_mol` and
    `capacity_share` the temperature changes nothing and is only reported.
    """

    heat_capacity_j_per_k: Annotated[float, Field(gt=0.0, le=1e6)]  # of the pack: mass times 0.9 to 1.1 kJ/kg/K
    cooling_w_per_k: Annotated[float, Field(gt=0.0, le=1e3)]  # to the air: area times 10 to 50 W/m2/K
    leads_ohm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0  # part of `resistance_ohm` outside the cells
    reference_degc: Degrees = 25.0
    activation_j_per_mol: Annotated[float, Field(ge=0.0, le=1e5)] = 0.0  # of the cells' resistance
    # (temperature [degC], capacity over that at the reference), ascending; linear between, constant beyond.
    capacity_share: Annotated[
        tuple[tuple[Degrees, Annotated[float, Field(gt=0.0, le=1.5)]], ...], Field(max_length=16)
    ] = ()
    initial_degc: Degrees | None = None  # null: that of the air
    ambient_degc: Degrees | None = None  # null: the standard atmosphere's at the site

    @model_validator(mode="after")
    def _ascending(self) -> BatteryThermal:
        at_degc = [degc for degc, _ in self.capacity_share]
        if any(not upper > lower for lower, upper in pairwise(at_degc)):
            raise ValueError(f"capacity_share needs ascending temperatures, not {at_degc}")
        return self


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
    thermal: BatteryThermal | None = None  # null: the pack has no temperature, as at `reference_degc`

    @model_validator(mode="after")
    def _leads(self) -> Battery:
        if self.thermal is not None and self.thermal.leads_ohm > self.resistance_ohm:
            raise ValueError(
                f"thermal.leads_ohm {self.thermal.leads_ohm:g} is part of resistance_ohm {self.resistance_ohm:g}, and "
                "cannot be more"
            )
        return self


class BatteryState(NamedTuple):
    """State of a battery at one tick."""

    charge: float  # state of charge, 1 full, 0 empty; a cold pack is empty sooner
    voltage_v: float  # at the start of the last tick
    current_a: float  # mean over that tick
    temperature_degc: float | None = None  # of the cells; None without a thermal model
