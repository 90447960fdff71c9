"""Temperature of the battery against closed forms, and what it changes."""

from __future__ import annotations

import math
from typing import Any

import pydantic
import pytest

from signals.errors import ModelRangeError
from sim.physics.battery import GAS_CONSTANT_J_PER_MOL_K, Battery, BatteryThermal
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Scene, load_scene

TICK_NS = 4_000_000
TICK_S = TICK_NS * 1e-9
SCENE = load_scene("airfield")
X500 = load_vehicle("x500")
CAPACITY, COOLING = 20.0, 0.5  # small, for a flight of seconds
IDEAL: dict[str, Any] = {"heat_capacity_j_per_k": CAPACITY, "cooling_w_per_k": COOLING, "ambient_degc": 10.0}


def powered(thermal: dict[str, Any] | None, *, scene: Scene = SCENE, **battery: Any) -> VehiclePhysics:
    assert X500.battery is not None
    declared = X500.battery.model_dump() | battery | ({} if thermal is None else {"thermal": IDEAL | thermal})
    vehicle = X500.model_copy(update={"battery": Battery.model_validate(declared)})
    return VehiclePhysics(
        vehicle, scene, TICK_NS, effects=Effects(battery=True), start=FlightStart(p_WB=(0.0, 0.0, 500.0))
    )


def at_rest(physics: VehiclePhysics, ticks: int) -> list[float]:
    """Return the temperature after each tick with the rotors at rest: the auxiliary load alone is drawn."""
    found = []
    for tick in range(ticks + 1):
        physics.advance(tick, (0.0,) * 4)
        state = physics.battery
        assert state is not None
        assert state.temperature_degc is not None
        found.append(state.temperature_degc)
    return found


def test_it_warms_to_the_steady_state_with_its_time_constant() -> None:
    """T - T_a = I^2 R / h (1 - e^{-h t / c}), with the current of a constant load."""
    resistance_ohm, load_w = 0.05, 200.0
    physics = powered({}, resistance_ohm=resistance_ohm, auxiliary_w=load_w, capacity_ah=1000.0)
    found = at_rest(physics, 1000)
    state = physics.battery
    assert state is not None
    rise_k = state.current_a**2 * resistance_ohm / COOLING
    t_s = 1000 * TICK_S
    assert found[-1] - 10.0 == pytest.approx(rise_k * (1.0 - math.exp(-COOLING * t_s / CAPACITY)), rel=2e-4)


def test_it_cools_with_its_time_constant() -> None:
    found = at_rest(powered({"initial_degc": 40.0}, auxiliary_w=0.0), 500)
    for tick in (1, 100, 500):
        expected = 10.0 + 30.0 * math.exp(-COOLING * tick * TICK_S / CAPACITY)
        assert found[tick] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("degc", [-10.0, 10.0, 25.0, 45.0])
def test_resistance_follows_arrhenius(degc: float) -> None:
    """V I = P_0 with V = E - R(T) I: the resistance found from voltage and current."""
    energy, leads_ohm, total_ohm = 18_800.0, 0.008, 0.020
    physics = powered(
        {"initial_degc": degc, "activation_j_per_mol": energy, "leads_ohm": leads_ohm, "heat_capacity_j_per_k": 1e6},
        resistance_ohm=total_ohm,
        auxiliary_w=300.0,
    )
    at_rest(physics, 1)
    state = physics.battery
    assert state is not None
    # Open circuit of a full pack, Chen and Rincon-Mora.
    open_v = 4 * (3.685 + 0.2156 - 0.1178 + 0.3201 - 1.031 * math.exp(-35.0))
    found_ohm = (open_v - state.voltage_v) / state.current_a
    factor = math.exp(energy / GAS_CONSTANT_J_PER_MOL_K * (1 / (degc + 273.15) - 1 / 298.15))
    assert found_ohm == pytest.approx(leads_ohm + (total_ohm - leads_ohm) * factor, rel=1e-6)


def test_a_doubling_at_0_degc_is_18_8_kj_per_mol() -> None:
    """The arithmetic behind the figure that docs/physics.md gives."""
    energy = GAS_CONSTANT_J_PER_MOL_K * math.log(2.0) / (1 / 273.15 - 1 / 298.15)
    assert energy == pytest.approx(18_800, rel=2e-3)


def drawn_until_empty(physics: VehiclePhysics) -> float:
    """Return the charge [C] that the auxiliary load draws until the model refuses to go on."""
    drawn_c = 0.0
    for tick in range(100_000):
        try:
            physics.advance(tick, (0.0,) * 4)
        except ModelRangeError as error:
            return drawn_c if error.variable.startswith("battery") else math.nan
        state = physics.battery
        assert state is not None
        drawn_c += state.current_a * TICK_S
    raise AssertionError("the pack was never empty")


def test_a_cold_pack_is_empty_sooner() -> None:
    """Capacity by the table, linear between its points: at 0 degC 85 %, at -10 degC 0.85 - 0.25 / 2."""
    table = ((-20.0, 0.6), (0.0, 0.85), (25.0, 1.0))
    assert X500.battery is not None
    for degc, share in ((-30.0, 0.6), (-10.0, 0.725), (0.0, 0.85), (10.0, 0.91), (40.0, 1.0)):
        physics = powered(
            {"initial_degc": degc, "capacity_share": table, "heat_capacity_j_per_k": 1e6},
            initial_charge=0.5,
            capacity_ah=0.01,
            auxiliary_w=360.0,
        )
        start = physics.battery
        assert start is not None
        assert start.charge == pytest.approx(0.5)
        drawn_c = drawn_until_empty(physics)
        assert drawn_c == pytest.approx(0.5 * share * 36.0, abs=0.3)  # a tick takes 0.1 C or more when nearly empty


@pytest.mark.parametrize(("altitude_m", "degc"), [(0.0, 15.0), (2500.0, -1.244)])
def test_the_air_is_the_standard_atmosphere_of_the_site(altitude_m: float, degc: float) -> None:
    scene = SCENE.model_copy(update={"site": SCENE.site.model_copy(update={"altitude_m": altitude_m})})
    found = at_rest(powered({"ambient_degc": None}, scene=scene, auxiliary_w=0.0), 10)
    assert found[0] == pytest.approx(degc, abs=1e-3)
    assert found[-1] == pytest.approx(found[0], abs=1e-12)


def test_a_temperature_that_changes_nothing_leaves_the_flight_to_the_bit() -> None:
    flights = []
    for thermal in (None, {}):
        physics = powered(thermal)
        flights.append([physics.advance(tick, (0.7, 0.71, 0.72, 0.7)) for tick in range(200)])
    assert flights[0] == flights[1]


def test_reset_begins_with_the_first_temperature_again() -> None:
    physics = powered({"activation_j_per_mol": 18_800.0, "capacity_share": ((0.0, 0.85), (25.0, 1.0))})
    first = [physics.advance(tick, (0.8,) * 4) for tick in range(100)]
    warm = physics.battery
    physics.restart(seed=0)
    start = physics.battery
    assert warm is not None
    assert start is not None
    assert warm.temperature_degc is not None
    assert start.temperature_degc == 10.0
    assert warm.temperature_degc > 10.0
    again = [physics.truth, *(physics.advance(tick, (0.8,) * 4) for tick in range(1, 100))]
    assert again == first


@pytest.mark.parametrize(
    ("thermal", "message"),
    [
        ({"capacity_share": ((0.0, 0.9), (0.0, 1.0))}, "ascending"),
        ({"leads_ohm": 0.03}, "cannot be more"),
        ({"heat_capacity_j_per_k": 0.0}, "heat_capacity"),
    ],
)
def test_thermal_models_that_cannot_be_are_refused(thermal: dict[str, Any], message: str) -> None:
    assert X500.battery is not None
    with pytest.raises(pydantic.ValidationError, match=message):
        Battery.model_validate(X500.battery.model_dump() | {"thermal": IDEAL | thermal})
    assert BatteryThermal.model_validate(IDEAL).initial_degc is None
