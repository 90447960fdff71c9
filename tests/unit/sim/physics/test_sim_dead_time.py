"""Dead time of the speed controller against closed forms: whole and fractional ticks, free flight and contact."""

from __future__ import annotations

import math

import pytest

from signals.errors import ModelRangeError
from signals.samples import TruthState
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene

TICK_NS = 4_000_000
TICK_S = TICK_NS * 1e-9
SCENE = load_scene("airfield")
X500 = load_vehicle("x500")
HIGH = FlightStart(p_WB=(0.0, 0.0, 500.0))


def late(dead_time_s: float) -> Vehicle:
    constants = X500.rotor_constants.model_copy(update={"dead_time_s": dead_time_s})
    return X500.model_copy(update={"rotor_constants": constants})


def physics(
    dead_time_s: float, tick_ns: int = TICK_NS, start: FlightStart = HIGH, *, battery: bool = False
) -> VehiclePhysics:
    return VehiclePhysics(late(dead_time_s), SCENE, tick_ns, start=start, effects=Effects(battery=battery))


def control(t_ns: int) -> tuple[float, ...]:
    """Commands that change every 4 ms, and differ by rotor."""
    k = t_ns // TICK_NS
    return tuple(0.6 + 0.1 * math.sin(0.7 * k + i) for i in range(4))


def fly(made: VehiclePhysics, ticks: int, *, step_ns: int = TICK_NS) -> list[TruthState]:
    """Return the state at each tick, with the command that was given when the tick began."""
    return [made.advance(tick, control((tick - 1) * step_ns) if tick else (0.0,) * 4) for tick in range(ticks + 1)]


@pytest.mark.parametrize("dead_time_s", [0.004, 0.012, 0.0015, 0.0065, 0.0399])
def test_a_step_of_the_command_arrives_after_the_dead_time(dead_time_s: float) -> None:
    """O(t) = c (1 - e^{-(t - D) / tau}) for t > D: exact at every tick, whatever the remainder."""
    made, c = physics(dead_time_s), X500.rotor_constants
    made.advance(0, (0.0,) * 4)
    for tick in range(1, 30):
        speed = made.advance(tick, (0.5,) * 4).rotor_speed_radps[0]
        since_s = tick * TICK_S - dead_time_s
        expected = 0.5 * c.max_speed_radps * (1.0 - math.exp(-since_s / c.time_constant_up_s)) if since_s > 0 else 0.0
        assert speed == pytest.approx(expected, rel=1e-11, abs=1e-9)


def test_whole_ticks_are_the_flight_with_commands_given_later() -> None:
    """To the bit: a delay of three ticks is the flight whose commands come three ticks later."""
    delayed, plain = physics(3 * TICK_S), physics(0.0)
    fly_delayed = fly(delayed, 100)
    for tick in range(101):
        given = control((tick - 4) * TICK_NS) if tick > 3 else (0.0,) * 4
        assert plain.advance(tick, given) == fly_delayed[tick]


def test_a_fraction_of_a_tick_is_exact_to_the_order_of_the_integrator() -> None:
    """A delay of 1.5 ticks equals the flight with half the tick and commands given three half ticks later."""
    fine, delayed = physics(0.0, TICK_NS // 2), fly(physics(1.5 * TICK_S), 120)
    for step in range(241):
        t_ns = (step - 1) * TICK_NS // 2 - 3 * TICK_NS // 2  # of the command in effect
        truth = fine.advance(step, control(t_ns) if step and t_ns >= 0 else (0.0,) * 4)
        if step % 2 == 0:
            other = delayed[step // 2]
            assert other.p_WB == pytest.approx(truth.p_WB, abs=1e-9)
            assert other.q_WB == pytest.approx(truth.q_WB, abs=1e-9)
            assert other.rotor_speed_radps == pytest.approx(truth.rotor_speed_radps, rel=1e-11, abs=1e-9)


def test_the_battery_pays_for_the_tick_as_it_was_flown() -> None:
    """The charge drawn with half a tick of dead time equals that of the flight with half ticks, but for the voltage."""
    fine, coarse = physics(0.0, TICK_NS // 2, battery=True), physics(0.5 * TICK_S, battery=True)
    fly(coarse, 60)
    for step in range(121):
        t_ns = (step - 2) * TICK_NS // 2
        fine.advance(step, control(t_ns) if step > 1 else (0.0,) * 4)
    states = [made.battery for made in (fine, coarse)]
    assert states[0] is not None
    assert states[1] is not None
    assert 1.0 - states[1].charge == pytest.approx(1.0 - states[0].charge, rel=2e-3)


def test_none_is_the_flight_without_the_key() -> None:
    plain = VehiclePhysics(X500, SCENE, TICK_NS, start=HIGH)
    assert fly(plain, 50) == fly(physics(0.0), 50)


def test_on_the_ground_the_rotors_start_late_too() -> None:
    """In contact the change falls on the nearest border of sub-steps of 1 ms."""
    made = physics(0.0065, start=FlightStart())
    speeds = [made.advance(tick, (0.3,) * 4).rotor_speed_radps[0] for tick in range(20)]
    c = X500.rotor_constants
    assert speeds[1] == 0.0
    assert made.truth.in_contact
    early, late_ = (
        0.3 * c.max_speed_radps * (1 - math.exp(-(19 * TICK_S - d) / c.time_constant_up_s)) for d in (0.006, 0.007)
    )
    assert late_ - 1e-9 <= speeds[19] <= early + 1e-9


def test_hold_flies_what_advance_flies() -> None:
    """Many ticks in the kernel at once, with the same commands: the same bits."""
    for dead_time_s in (0.0065, 0.02):
        one, many = physics(dead_time_s), physics(dead_time_s)
        for tick in range(61):
            one.advance(tick, (0.7, 0.72, 0.7, 0.72))
        many.advance(0, (0.0,) * 4)
        many.hold((0.7, 0.72, 0.7, 0.72), 60)
        assert many.truth == one.truth


def test_restart_and_place_forget_the_commands_on_their_way() -> None:
    made = physics(0.0105)
    first = fly(made, 40)
    made.restart(seed=0)
    again = [made.truth, *(made.advance(tick, control((tick - 1) * TICK_NS)) for tick in range(1, 41))]
    assert again == first
    made.advance(41, (0.9,) * 4)
    made.place((0.0, 0.0, 500.0))
    made.advance(42, (0.9,) * 4)
    assert made.truth.rotor_speed_radps == (0.0,) * 4


def test_a_command_that_is_not_finite_is_named_when_it_is_given() -> None:
    made = physics(0.02)
    made.advance(0, (0.0,) * 4)
    with pytest.raises(ModelRangeError, match=r"controls\[2\]"):
        made.advance(1, (0.5, 0.5, math.nan, 0.5))


@pytest.mark.parametrize(
    ("dead_time_s", "first", "count"), [(-0.001, 0, 4), (math.nan, 0, 4), (0.004, 0, 5), (0.004, -1, 2)]
)
def test_the_kernel_refuses_delays_that_cannot_be(dead_time_s: float, first: int, count: int) -> None:
    with pytest.raises(ValueError, match="dead time"):
        physics(0.0).body.delay_commands(dead_time_s=dead_time_s, first=first, count=count)
