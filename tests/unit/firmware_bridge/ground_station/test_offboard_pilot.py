"""The offboard pilot against a scripted vehicle: phases, refusals, and set-points bit by bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import pytest

from firmware_bridge.ground_station.modes import ARDUPILOT, PX4, mode_number
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from signals.desired import DesiredState
from signals.errors import HandshakeError
from tests.worlds.scripted_vehicle import (
    ACCEPTED,
    ARM,
    DENIED,
    FAILED,
    REJECTED_FOR_NOW,
    SET_MODE,
    TICK_NS,
    S,
    ScriptedVehicle,
)

TAKEOFF, REQUEST = 22, 512
LAT, LON, ALT = 47.397742, 8.545594, 488.0


def geodetic_from_W(p_W: Sequence[float]) -> tuple[float, float, float]:
    """Map W to latitude and longitude by ArduPilot's projection at the origin, where (north, east) = (y, x)."""
    m_per_deg = 111318.84502145034
    lat = LAT + p_W[1] / m_per_deg
    scale = math.cos(math.radians(0.5 * (LAT + lat)))
    return lat, LON + p_W[0] / m_per_deg / scale, ALT + p_W[2]


class Vehicle(ScriptedVehicle):
    """A vehicle that sends its position ten times a second and is moved by the test."""

    telemetry_ns = S // 10

    def __init__(self, autopilot: int = PX4, *, tells_origin: bool = True, **script: Any) -> None:
        super().__init__(autopilot, **({"ready_ns": 0} | script))
        self.tells_origin = tells_origin
        self.p_N = (0.0, 0.0, 0.0)

    def tell(self, t_ns: int) -> None:
        self.say("LOCAL_POSITION_NED", 0, *self.p_N, 0.0, 0.0, 0.0)
        self.say("GLOBAL_POSITION_INT", 0, round(LAT * 1e7), round(LON * 1e7), round(ALT * 1e3), 0, 0, 0, 0, 0)

    def obey(self, t_ns: int, m: Any) -> int:
        if m.command == REQUEST and self.tells_origin:
            self.say("GPS_GLOBAL_ORIGIN", round(LAT * 1e7), round(LON * 1e7), round(ALT * 1e3), 0)
        return super().obey(t_ns, m)

    def set_points(self) -> list[tuple[int, Any]]:
        return [(t, m) for t, m in self.heard if type(m).__name__.startswith("SET_")]


class Flight:
    """Pilot and vehicle, tick by tick."""

    def __init__(self, vehicle: Vehicle, **settings: Any) -> None:
        self.vehicle = vehicle
        self.events: list[tuple[int, str, str]] = []
        self.pilot = OffboardPilot(
            geodetic_from_W, tick_ns=TICK_NS, on_event=lambda *event: self.events.append(event), **settings
        )
        self.tick = 0

    @property
    def t_ns(self) -> int:
        return self.tick * TICK_NS

    def run(self, seconds: float, desired: DesiredState | None = None) -> None:
        """Run ticks with a new `desired` on every fifth one."""
        for i in range(round(seconds * 250)):
            if desired is not None and i % 5 == 0:
                self.pilot.set_desired(desired, self.t_ns)
            self.vehicle.hear(self.t_ns, self.pilot.step(self.t_ns, self.vehicle.speak(self.t_ns)))
            self.tick += 1

    def fly(self, desired: DesiredState, seconds: float = 4.0) -> None:
        """Bring the flight to FLYING, in the air."""
        self.run(1.0)
        self.run(seconds, desired)
        self.vehicle.landed_state = 2
        self.vehicle.p_N = (0.0, 0.0, -3.0)
        self.run(0.4, desired)
        assert self.pilot.phase is Phase.FLYING

    def last(self) -> Any:
        return self.vehicle.set_points()[-1][1]


UP = DesiredState(p_W=(0.0, 0.0, 3.0))


def test_px4_gets_set_points_first_and_lands_by_its_own_mode() -> None:
    vehicle = Vehicle()
    flight = Flight(vehicle)
    flight.run(3.0)
    assert flight.pilot.phase is Phase.PREFLIGHT  # no desired state yet
    assert vehicle.commands() == []
    hold = flight.last()
    assert (hold.x, hold.y, hold.z, hold.type_mask) == (0.0, 0.0, 0.0, 0xDF8)
    flight.fly(UP)
    assert vehicle.commands() == [(SET_MODE, 1.0, 6.0, 0.0), (ARM, 1.0, 0.0, 0.0)]
    flight.run(0.1, DesiredState(land=True))
    assert flight.pilot.phase is Phase.LANDING
    assert vehicle.mode == mode_number(PX4, "LAND").custom_mode
    count = len(vehicle.set_points())
    vehicle.landed_state, vehicle.armed = 1, False
    flight.run(3.0, UP)  # there is no way back
    assert flight.pilot.phase is Phase.DONE
    assert len(vehicle.set_points()) == count
    assert vehicle.commands()[2:] == [(SET_MODE, 1.0, 4.0, 6.0)]


def test_px4_is_not_asked_for_offboard_before_a_second_of_set_points() -> None:
    flight = Flight(Vehicle())
    flight.run(4.0, UP)  # wanted from the first tick on
    asked_ns = next(t for t, m in flight.vehicle.heard if getattr(m, "command", 0) == SET_MODE)
    before = [t for t, _ in flight.vehicle.set_points() if t < asked_ns]
    assert asked_ns - before[0] >= S - 5 * TICK_NS  # set-points fall on every fifth tick
    assert len(before) == 50


def test_ardupilot_takes_off_before_set_points_fly_it() -> None:
    vehicle = Vehicle(ARDUPILOT)
    flight = Flight(vehicle, takeoff_height_m=2.5)
    flight.run(1.0)
    flight.run(4.0, UP)
    assert vehicle.commands() == [(SET_MODE, 1.0, 4.0, 0.0), (ARM, 1.0, 0.0, 0.0), (TAKEOFF, 0.0, 0.0, 0.0)]
    takeoff = next(m for _, m in vehicle.heard if getattr(m, "command", 0) == TAKEOFF)
    assert takeoff.param7 == 2.5
    assert flight.pilot.phase is Phase.FLYING
    vehicle.landed_state, vehicle.p_N = 3, (0.0, 0.0, -2.2)
    flight.run(0.2, UP)
    assert vehicle.set_points() == []
    vehicle.p_N = (0.0, 0.0, -2.3)
    flight.run(0.2, UP)
    assert flight.last().z == pytest.approx(-3.0, abs=1e-6)
    flight.run(0.1, DesiredState(land=True))
    assert vehicle.commands()[3:] == [(SET_MODE, 1.0, 9.0, 0.0)]


@pytest.mark.parametrize("desired", [DesiredState(), DesiredState(yaw_rad=1.0)], ids=["nothing", "yaw"])
def test_a_desired_state_without_motion_does_not_arm(desired: DesiredState) -> None:
    flight = Flight(Vehicle())
    flight.run(4.0, desired)
    assert flight.pilot.phase is Phase.PREFLIGHT
    assert flight.vehicle.commands() == []


def test_an_old_desired_state_does_not_arm() -> None:
    flight = Flight(Vehicle())
    flight.pilot.set_desired(UP, 0)  # set-points have to come for a second before PX4 can be armed
    flight.run(4.0)
    assert flight.pilot.phase is Phase.PREFLIGHT
    assert flight.vehicle.commands() == []


def test_set_points_fall_on_fixed_ticks_whenever_something_is_wanted() -> None:
    def times(shift_ns: int) -> list[int]:
        flight = Flight(Vehicle(), setpoint_hz=30.0)
        flight.run(1.0)
        flight.pilot.set_desired(UP, flight.t_ns + shift_ns)
        flight.run(2.0)
        return [t for t, _ in flight.vehicle.set_points()]

    first = times(0)
    assert first == times(3 * TICK_NS) == times(100_000)
    assert {b - a for a, b in pairwise(first)} == {8 * TICK_NS, 9 * TICK_NS}  # 30 of 250 Hz
    assert len([t for t in first if S <= t < 2 * S]) == 30


def test_states_apply_at_their_times_whatever_the_order_they_came_in() -> None:
    flight = Flight(Vehicle())
    flight.fly(UP)
    t0_ns = flight.t_ns + TICK_NS  # a tick after the grid
    for z, after_ns in ((6.0, 60_000_000), (5.0, 20_000_001), (9.0, 20_000_000)):
        flight.pilot.set_desired(DesiredState(p_W=(0.0, 0.0, z)), t0_ns + after_ns)
    flight.run(0.1)
    told = {t - t0_ns: -m.z for t, m in flight.vehicle.set_points() if t >= t0_ns}
    assert {t: round(z, 4) for t, z in told.items()} == {0: 3.0, 20_000_000: 9.0, 40_000_000: 5.0} | {
        60_000_000: 6.0,
        80_000_000: 6.0,
    }
    flight.pilot.set_desired(DesiredState(p_W=(0.0, 0.0, 4.0)), t0_ns)  # too late: a newer one applies
    flight.run(0.1)
    assert -flight.last().z == pytest.approx(6.0, abs=1e-5)


P, V, A = (10.0, 20.0, 3.0), (1.0, 2.0, 0.5), (0.1, 0.2, -0.3)
NO_P, NO_V, NO_A, NO_YAW, NO_RATE = 0x7, 0x38, 0x1C0, 0x400, 0x800


@pytest.mark.parametrize(
    ("fields", "mask"),
    [
        ({"p_W": P}, NO_V | NO_A | NO_YAW | NO_RATE),
        ({"p_W": P, "yaw_rad": 0.0}, NO_V | NO_A | NO_RATE),
        ({"p_W": P, "v_W": V}, NO_A | NO_YAW | NO_RATE),
        ({"p_W": P, "v_W": V, "a_W": A, "yaw_rate_radps": 0.2}, NO_YAW),
        ({"v_W": V}, NO_P | NO_A | NO_YAW | NO_RATE),
        ({"v_W": V, "a_W": A, "yaw_rad": 0.0, "yaw_rate_radps": 0.2}, NO_P),
        ({"a_W": A}, NO_P | NO_V | NO_YAW | NO_RATE),
        ({"p_W": P, "a_W": A}, NO_V | NO_YAW | NO_RATE),
    ],
)
def test_masks_ignore_missing_fields_and_axes_are_converted(fields: dict[str, Any], mask: int) -> None:
    flight = Flight(Vehicle(ARDUPILOT))
    flight.fly(UP)
    flight.run(0.1, DesiredState(**fields, hold=True))
    m = flight.last()
    if set(fields) == {"p_W", "a_W"}:
        mask |= NO_A  # which ArduPilot would take for no set-point at all
    assert m.type_mask == mask
    assert m.coordinate_frame == 1
    zero = (0.0, 0.0, 0.0)
    assert (m.x, m.y, m.z) == pytest.approx((20.0, 10.0, -3.0) if "p_W" in fields else zero, abs=1e-3)
    assert (m.vx, m.vy, m.vz) == ((2.0, 1.0, -0.5) if "v_W" in fields else zero)
    assert (m.afx, m.afy, m.afz) == pytest.approx((0.2, 0.1, 0.3) if not mask & NO_A else zero)
    assert m.yaw == pytest.approx(math.pi / 2 if "yaw_rad" in fields else 0.0)
    assert m.yaw_rate == pytest.approx(-0.2 if "yaw_rate_radps" in fields else 0.0)


@pytest.mark.parametrize(
    ("yaw_W", "yaw_N"), [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, 180.0), (-170.0, -100.0), (1000.0, 170.0)]
)
def test_yaw_turns_about(yaw_W: float, yaw_N: float) -> None:
    flight = Flight(Vehicle())
    flight.fly(UP)
    flight.run(0.1, DesiredState(p_W=P, yaw_rad=math.radians(yaw_W)))
    assert abs(math.remainder(math.degrees(flight.last().yaw) - yaw_N, 360.0)) < 1e-4
    assert abs(flight.last().yaw) <= math.pi + 1e-6
    # An attitude without a thrust is its heading.
    half = math.radians(yaw_W) / 2
    flight.run(0.1, DesiredState(p_W=P, q_WB=(math.cos(half), 0.0, 0.0, math.sin(half))))
    assert abs(math.remainder(math.degrees(flight.last().yaw) - yaw_N, 360.0)) < 1e-4


def test_attitudes_and_rates_are_sent_with_thrust() -> None:
    flight = Flight(Vehicle())
    flight.fly(UP)
    half = math.sqrt(0.5)
    north = (half, 0.0, 0.0, half)  # level, facing north
    flight.run(0.1, DesiredState(q_WB=north, thrust=0.25))
    m = flight.last()
    assert (type(m).__name__, m.type_mask, m.thrust) == ("SET_ATTITUDE_TARGET", 0x07, 0.25)
    assert tuple(abs(c) for c in m.q) == pytest.approx((1, 0, 0, 0), abs=1e-7)
    flight.run(0.1, DesiredState(w_B=(1.0, 2.0, 3.0), thrust=0.5))
    m = flight.last()
    assert (m.type_mask, m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate) == (0x80, 1.0, -2.0, -3.0)
    flight.run(0.1, DesiredState(q_WB=north, w_B=(1.0, 2.0, 3.0), thrust=0.5))
    assert flight.last().type_mask == 0
    # Then stay: there is no commanded position to go back to.
    flight.vehicle.p_N = (1.0, 2.0, -5.0)
    flight.run(0.2, DesiredState(yaw_rate_radps=0.5))
    m = flight.last()
    assert (m.x, m.y, m.z, m.type_mask) == (1.0, 2.0, -5.0, NO_V | NO_A | NO_YAW)


def test_a_silent_companion_is_reported_once_and_the_vehicle_holds() -> None:
    flight = Flight(Vehicle(), stale_s=0.5)
    flight.fly(DesiredState(p_W=P, v_W=V, yaw_rad=0.0))
    flight.run(2.0)
    assert [(kind, "holding" in text) for _, kind, text in flight.events] == [("warning", True)]
    assert flight.pilot.stale
    m = flight.last()
    # The last command, carried on for half a second; PX4 has another projection.
    assert (m.x, m.y) == pytest.approx((21.0, 10.5), abs=0.1)
    assert m.type_mask == NO_V | NO_A | NO_RATE
    flight.vehicle.p_N = (4.0, 5.0, -6.0)
    flight.run(0.2, DesiredState(v_W=V))
    assert [kind for _, kind, _ in flight.events] == ["warning", "status"]
    flight.run(2.0)
    flight.vehicle.p_N = (4.5, 5.0, -6.0)  # it holds the position of that time
    flight.run(0.5)
    m = flight.last()
    assert (m.x, m.y, m.z) == (4.0, 5.0, -6.0)
    assert len(flight.events) == 3


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_desired_states_are_extrapolated_from_their_own_time(hold: bool, late_s: float) -> None:
    """p + v dt + a dt^2 / 2 and so on, with north and east exchanged; for half a second at most."""
    flight = Flight(Vehicle(ARDUPILOT))
    flight.fly(UP)
    t0_ns = flight.t_ns
    desired = DesiredState(p_W=P, v_W=V, a_W=(0.0, 3.0, 0.0), yaw_rad=0.5, yaw_rate_radps=0.25, hold=hold)
    flight.pilot.set_desired(desired, t0_ns, t0_ns - round(late_s * S))
    flight.run(0.8)
    told = [(t - t0_ns, m) for t, m in flight.vehicle.set_points() if t >= t0_ns]
    assert len(told) > 30
    for dt_ns, m in told:
        dt_s = 0.0 if hold else min(dt_ns / S + late_s, 0.5)
        assert m.x == pytest.approx(20.0 + V[1] * dt_s + 1.5 * dt_s**2, abs=1e-3), dt_ns
        assert m.vx == pytest.approx(V[1] + 3.0 * dt_s, abs=1e-6)
        assert m.yaw == pytest.approx(math.pi / 2 - 0.5 - 0.25 * dt_s, abs=1e-6)


def test_an_origin_that_is_not_sent_is_inferred() -> None:
    vehicle = Vehicle(ARDUPILOT, tells_origin=False)
    vehicle.p_N = (3.0, -4.0, -1.0)  # though the geodetic place is that of the world's origin
    flight = Flight(vehicle)
    flight.run(7.0)
    flight.run(2.0, UP)
    assert [kind for _, kind, _ in flight.events] == ["status"]
    vehicle.p_N, vehicle.landed_state = (3.0, -4.0, -4.0), 2
    flight.run(0.5, DesiredState(p_W=(0.0, 0.0, 5.0)))
    m = flight.last()
    assert (m.x, m.y, m.z) == pytest.approx((3.0, -4.0, -6.0), abs=0.01)


def test_an_origin_that_moves_is_reported_and_followed() -> None:
    flight = Flight(Vehicle(ARDUPILOT))
    flight.fly(UP)
    before = flight.last().x
    flight.vehicle.say("GPS_GLOBAL_ORIGIN", round(LAT * 1e7) + 1000, round(LON * 1e7), round(ALT * 1e3), 0)
    flight.run(0.1, UP)
    assert flight.last().x == pytest.approx(before - 11.13, abs=0.01)
    assert "moved the origin" in flight.events[-1][2]


def test_leaving_the_mode_is_reported_and_landing_ends_the_flight() -> None:
    flight = Flight(Vehicle())
    flight.fly(UP)
    flight.vehicle.mode = mode_number(PX4, "RTL").custom_mode
    flight.run(2.0, UP)
    assert [(kind, "RTL" in text) for _, kind, text in flight.events] == [("warning", True)]
    flight.vehicle.landed_state, flight.vehicle.armed = 1, False
    flight.run(3.0, UP)
    assert flight.pilot.phase is Phase.DONE


def test_temporarily_declined_commands_are_repeated() -> None:
    vehicle = Vehicle(answers={SET_MODE: [REJECTED_FOR_NOW, REJECTED_FOR_NOW, ACCEPTED], ARM: [None, ACCEPTED]})
    flight = Flight(vehicle)
    flight.fly(UP, 6.0)
    assert [command for command, *_ in vehicle.commands()] == [SET_MODE] * 3 + [ARM] * 2


@pytest.mark.parametrize(
    ("vehicle", "settings", "why"),
    [
        (Vehicle(answers={SET_MODE: DENIED}), {}, "enter mode OFFBOARD and answered MAV_RESULT_DENIED"),
        (Vehicle(answers={ARM: DENIED}), {}, "asked to arm and answered MAV_RESULT_DENIED"),
        (Vehicle(answers={ARM: None}), {}, "ARM_DISARM was sent 5 times without an answer"),
        (
            Vehicle(ARDUPILOT, answers={TAKEOFF: FAILED}),
            {"preflight_limit_s": 3.0},
            r"take off to 2 m and answered MAV_RESULT_FAILED 4\.0 s",
        ),
        (Vehicle(), {"takeoff_limit_s": 2.0}, "not in the air after 2 s .* lead up"),
        (Vehicle(autopilot=0), {}, "modes of .* are not known"),
        (Vehicle(autopilot=4), {"target_sysid": 7, "heartbeat_limit_s": 3.0}, "no heartbeat of vehicle 7 within 3 s"),
    ],
)
def test_refusals_name_the_request_and_the_answer(vehicle: Vehicle, settings: dict[str, Any], why: str) -> None:
    flight = Flight(vehicle, **settings)
    with pytest.raises(HandshakeError, match=why):
        flight.run(20.0, UP)


def test_a_vehicle_that_never_gets_ready_is_refused_with_its_reason() -> None:
    vehicle = Vehicle(ready_ns=1 << 60)
    with pytest.raises(HandshakeError, match=r"not ready to arm after 5 s .*pre-arm check does not pass"):
        Flight(vehicle, preflight_limit_s=5.0).run(20.0, UP)


def test_a_companion_may_take_its_time_and_land_on_the_ground_is_no_flight() -> None:
    flight = Flight(Vehicle(), preflight_limit_s=5.0)
    flight.run(20.0, DesiredState(land=True))
    assert flight.pilot.phase is Phase.PREFLIGHT
    assert flight.vehicle.commands() == []


def test_disarming_on_the_ground_is_refused() -> None:
    flight = Flight(Vehicle())
    flight.run(4.0, UP)
    assert flight.pilot.phase is Phase.FLYING
    flight.vehicle.armed = False
    with pytest.raises(HandshakeError, match="disarmed before it took off"):
        flight.run(2.0, UP)


@pytest.mark.parametrize("settings", [{"setpoint_hz": 2.0}, {"setpoint_hz": 251.0}, {"stale_s": 0.0}])
def test_rates_out_of_range_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"above 0|2 Hz"):
        OffboardPilot(geodetic_from_W, tick_ns=TICK_NS, **settings)
