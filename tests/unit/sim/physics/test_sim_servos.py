"""Control surfaces: their motion against closed forms and a numerical solution, limits, contact steps and faults."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.surface import Surface
from sim.physics.surface_faults import SurfaceFault
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000
X8 = load_vehicle("skywalker_x8")
LEFT = X8.surfaces[0]
RATE = math.radians(200.0)


def flight(vehicle: Vehicle = X8, *, faults: tuple[Any, ...] = (), height_m: float | None = 300.0) -> VehiclePhysics:
    start = FlightStart() if height_m is None else FlightStart(p_WB=(0.0, 0.0, height_m))
    disturbances = Disturbances(faults=faults)
    physics = VehiclePhysics(vehicle, load_scene("airfield"), TICK_NS, start=start, disturbances=disturbances)
    if height_m is not None:
        physics.state[7:10] = (18.0, 0.0, -0.5)
    return physics


def deflections(physics: VehiclePhysics, commands: list[tuple[float, ...]]) -> np.ndarray:
    out = [physics.advance(0, commands[0]).surface_rad]
    out += [physics.advance(tick, controls).surface_rad for tick, controls in enumerate(commands, start=1)]
    return np.array(out)


def moved(start: float, target: float, t: np.ndarray, tau: float, rate: float) -> np.ndarray:
    """Solution of d' = (c - d) / tau, limited to +-rate, by hand: a line and then an exponential."""
    gap = target - start
    corner = max(0.0, abs(gap) / rate - tau)
    left = gap - math.copysign(rate * corner, gap)
    line = start + math.copysign(1.0, gap) * rate * t
    return np.where(t < corner, line, target - left * np.exp(-(t - corner) / tau))


@pytest.mark.parametrize("command", [1.0, -1.0, 0.4, 0.02])
@pytest.mark.parametrize("height_m", [300.0, None])
def test_a_step_is_a_line_and_then_an_exponential(command: float, height_m: float | None) -> None:
    """In flight, and on the ground in contact steps."""
    found = deflections(flight(height_m=height_m), [(0.0, command, 0.0)] * 120)[:, 0]
    target = LEFT.deflection_rad(command)
    exact = moved(0.0, target, np.arange(121) * 0.004, LEFT.time_constant_s, RATE)
    assert target == pytest.approx(math.radians(35.0 * command if command > 0 else 30.0 * command), rel=1e-15)
    assert found == pytest.approx(exact, abs=1e-14)


def test_any_commands_against_a_numerical_solution() -> None:
    random = np.random.default_rng(5)
    commands = [(0.0, float(u), -float(u)) for u in np.repeat(random.uniform(-1.0, 1.0, 25), 8)]
    found = deflections(flight(), commands)
    state, exact = 0.0, [0.0]
    for _, u, _ in commands:
        target = LEFT.deflection_rad(u)

        def slope(_: float, d: Any, target: float = target) -> Any:
            return np.clip((target - d) / LEFT.time_constant_s, -RATE, RATE)

        state = solve_ivp(slope, (0.0, 0.004), [state], rtol=1e-11, atol=1e-12, max_step=2e-5).y[0, -1]
        exact.append(float(state))
    assert found[:, 0] == pytest.approx(exact, abs=1e-8)


def test_commands_beyond_one_are_saturated() -> None:
    assert np.array_equal(
        deflections(flight(), [(0.0, 1.0, -1.0)] * 30), deflections(flight(), [(0.0, 7.0, -3.0)] * 30)
    )


def test_a_command_that_is_no_number_is_named() -> None:
    from signals.errors import ModelRangeError

    physics = flight()
    physics.advance(0, (0.0,) * 3)
    with pytest.raises(ModelRangeError, match=r"controls\[2\]"):
        physics.advance(1, (0.0, 0.0, math.nan))


def test_signed_commands_are_those_of_surfaces() -> None:
    assert [command.name for command in X8.commands] == ["rotor_0", "elevon_left", "elevon_right"]
    assert X8.signed_commands == {1, 2}
    forces = X8.make_forces(flight()._effects)
    assert [force.is_signed(i) for force in forces for i in range(force.commands)] == [False, True, True]
    assert not load_vehicle("x500").signed_commands


def test_stuck_at_an_angle() -> None:
    faults = (SurfaceFault(kind="stuck", surface="elevon_left", at_s=0.1, angle_deg=10.0),)
    found = deflections(flight(faults=faults), [(0.0, -0.5, 0.3)] * 250)
    assert found[-1, 0] == pytest.approx(math.radians(10.0), abs=1e-9)
    assert found[-1, 1] == pytest.approx(0.3 * math.radians(35.0), abs=1e-9)


def test_stuck_where_it_is() -> None:
    faults = (SurfaceFault(kind="stuck", surface="elevon_right", at_s=0.04),)
    found = deflections(flight(faults=faults), [(0.0, 0.0, 1.0)] * 250)
    assert found[10, 1] > 0.05
    assert found[10:, 1] == pytest.approx(np.full(241, found[10, 1]), abs=1e-15)


def test_floating_returns_to_neutral_without_a_rate_limit() -> None:
    faults = (SurfaceFault(kind="floating", surface="elevon_left", at_s=0.4),)
    found = deflections(flight(faults=faults), [(0.0, 1.0, 1.0)] * 250)
    t = np.arange(151) * 0.004
    assert found[100:251, 0] == pytest.approx(found[100, 0] * np.exp(-t / LEFT.time_constant_s), abs=1e-14)


def test_a_lost_surface_has_no_effect() -> None:
    """The flight is that of a surface that stays at 0."""
    commands = [(0.3, 0.6, 0.1)] * 50
    lost = flight(faults=(SurfaceFault(kind="lost", surface="elevon_left", at_s=0.0),))
    held = flight()
    for tick, controls in enumerate([commands[0], *commands]):
        with_loss = lost.advance(tick, controls)
        without = held.advance(tick, (controls[0], 0.0, controls[2]))
    assert with_loss.surface_rad[0] > 0.2
    for one, other in zip(with_loss[2:6], without[2:6], strict=True):  # but for other lengths of steps
        assert one == pytest.approx(other, abs=1e-11)


def test_repair_ends_faults() -> None:
    physics = flight()
    deflections(physics, [(0.0, 1.0, 1.0)] * 20)
    physics.inject(SurfaceFault(kind="stuck", surface="elevon_left", at_s=0.1, angle_deg=-20.0))
    for tick in range(21, 100):
        physics.advance(tick, (0.0, 1.0, 1.0))
    assert physics.truth.surface_rad[0] < -0.3
    physics.restart(1)
    for tick in range(1, 100):
        truth = physics.advance(tick, (0.0, 1.0, 1.0))
    assert truth.surface_rad[0] == pytest.approx(math.radians(35.0), abs=1e-3)


def test_a_fault_of_no_surface_is_named() -> None:
    fault = SurfaceFault(kind="lost", surface="rudder", at_s=1.0)
    with pytest.raises(ValueError, match="names 'rudder', but the vehicle has elevon_left, elevon_right"):
        flight(faults=(fault,))
    with pytest.raises(ValueError, match="angle_deg has no meaning"):
        SurfaceFault(kind="lost", surface="rudder", at_s=1.0, angle_deg=2.0)


@pytest.mark.parametrize(("most", "least"), [(20.0, 5.0), (0.0, 0.0), (-5.0, -20.0)])
def test_neutral_lies_between_the_limits(most: float, least: float) -> None:
    with pytest.raises(ValueError, match="neutral angle 0 must be between"):
        Surface(name="flap", max_deg=most, min_deg=least, time_constant_s=0.05)
