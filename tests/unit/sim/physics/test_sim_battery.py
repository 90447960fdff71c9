"""The battery against its formulas: open-circuit voltage, hover current, charge drawn, sag, and its end."""

from __future__ import annotations

import math
from typing import Any

import pytest

from signals.errors import ModelRangeError
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from tests.worlds.rotor_models import quadratic

TICK_NS = 4_000_000
ON = Effects(battery=True)


def powered(vehicle: Vehicle, **battery: Any) -> VehiclePhysics:
    assert vehicle.battery is not None
    vehicle = vehicle.model_copy(update={"battery": vehicle.battery.model_copy(update=battery)})
    return VehiclePhysics(
        vehicle, load_scene("airfield"), TICK_NS, effects=ON, start=FlightStart(p_WB=(0.0, 0.0, 500.0))
    )


def fly_on(physics: VehiclePhysics, control: float) -> None:
    for tick in range(1, 100):
        physics.advance(tick, (control,) * 4)


def open_circuit_v(charge: float) -> float:
    """Chen and Rincon-Mora 2006, eq. 2."""
    return -1.031 * math.exp(-35 * charge) + 3.685 + 0.2156 * charge - 0.1178 * charge**2 + 0.3201 * charge**3


@pytest.mark.parametrize("charge", [1.0, 0.7, 0.2, 0.03])
def test_voltage_at_rest(charge: float) -> None:
    physics = powered(quadratic("x500"), initial_charge=charge, auxiliary_w=0.0)
    physics.advance(0, (0.0,) * 4)
    physics.advance(1, (0.0,) * 4)
    assert physics.battery is not None
    assert physics.battery.voltage_v == pytest.approx(4 * open_circuit_v(charge), rel=1e-12)
    assert physics.battery.current_a == 0.0
    assert physics.battery.charge == pytest.approx(charge, abs=1e-15)


@pytest.mark.parametrize("name", ["x500", "racer"])
def test_hover_current_and_the_charge_it_takes(name: str) -> None:
    """V I = P / eta + P0 with P = 4 m_ratio T O, and V = nE - R I."""
    vehicle = quadratic(name)
    b, c = vehicle.battery, vehicle.rotor_constants
    assert b is not None
    physics = powered(vehicle)
    speed = math.sqrt(vehicle.mass_kg * 9.80665 / 4 / c.thrust_coefficient_n_per_radps2)
    physics.state[13:] = speed
    # The command that asks for hover speed at the voltage there is.
    watts = 4 * c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * speed**3 / b.efficiency + b.auxiliary_w
    start_v = b.cells * open_circuit_v(1.0)
    volts = 0.5 * (start_v + math.sqrt(start_v**2 - 4 * b.resistance_ohm * watts))
    relative = speed / c.max_speed_radps * b.nominal_voltage_v / volts
    control = relative if c.thrust_model_factor == 1.0 else relative**2
    physics.advance(0, (control,) * 4)
    truth = physics.advance(1, (control,) * 4)
    state = physics.battery
    assert state is not None
    assert truth.rotor_speed_radps == pytest.approx([speed] * 4, rel=1e-12)
    assert state.voltage_v == pytest.approx(volts, rel=1e-12)
    assert state.current_a == pytest.approx(watts / volts, rel=1e-10)
    assert volts == pytest.approx(start_v - b.resistance_ohm * state.current_a, rel=1e-9)
    assert 1.0 - state.charge == pytest.approx(state.current_a * 0.004 / (3600 * b.capacity_ah), rel=1e-3)
    assert 8.0 < state.current_a < 40.0  # a plausible hover


def test_charge_drawn_while_spinning_up_is_the_integral_of_the_power() -> None:
    vehicle = quadratic("x500")
    physics = powered(vehicle, auxiliary_w=0.0, resistance_ohm=0.0, efficiency=1.0)
    c = vehicle.rotor_constants
    physics.advance(0, (0.9,) * 4)
    drawn_c = 0.0
    for tick in range(1, 20):
        before = physics.state[13]
        physics.advance(tick, (0.9,) * 4)
        state = physics.battery
        assert state is not None
        target = 0.9 * c.max_speed_radps * state.voltage_v / 14.8
        n, energy_j = 2000, 0.0
        for k in range(n):  # midpoint rule
            t = (k + 0.5) * 0.004 / n
            speed = target + (before - target) * math.exp(-t / c.time_constant_up_s)
            energy_j += 4 * c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * speed**3 * 0.004 / n
        assert state.current_a == pytest.approx(energy_j / state.voltage_v / 0.004, rel=1e-6)
        drawn_c += state.current_a * 0.004
    assert 1.0 - state.charge == pytest.approx(drawn_c / 18_000.0, rel=1e-9)


def test_an_empty_battery_ends_the_run_by_name() -> None:
    physics = powered(load_vehicle("x500"), initial_charge=1e-4)
    physics.advance(0, (0.7,) * 4)
    with pytest.raises(ModelRangeError, match=r"battery_charge = -.*pack is empty"):
        fly_on(physics, 0.7)


def test_a_pack_too_weak_ends_the_run_by_name() -> None:
    physics = powered(load_vehicle("x500"), resistance_ohm=0.5)
    physics.advance(0, (1.0,) * 4)
    with pytest.raises(ModelRangeError, match=r"battery_voltage_v = nan"):
        fly_on(physics, 1.0)


def test_without_the_switch_there_is_none() -> None:
    physics = VehiclePhysics(load_vehicle("x500"), load_scene("airfield"), TICK_NS)
    assert physics.battery is None
    with pytest.raises(ValueError, match="'iris' has no battery"):
        VehiclePhysics(load_vehicle("iris"), load_scene("airfield"), TICK_NS, effects=ON)
