"""Take-off, landing, crashes and gaps of a log are found; wrong units and axes are named."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.apps.identify.delays import delays_of
from hil.apps.identify.excitation import DOWN, PITCH, ROLL, ROTOR_DRAG, THRUST, UP, YAW, excitation_of
from hil.apps.identify.plausibility import check_accel, check_flight, check_one_vehicle, gain_of
from hil.apps.identify.preparation import with_measured_voltage
from hil.run.flight_logs.airborne import find_flights, motors_up, note_saturation
from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import LogFile
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.flown_log import CLIMB_S, TAKE_OFF_S, Array, flown_log, scaled, with_series

X500 = load_vehicle("x500")
LOG = flown_log()
Change = Callable[[FlightLog], FlightLog]


def file() -> LogFile:
    return LogFile(Path("flown.ulg"), X500, topics={"rate": "sensor_combined.gyro_rad", "motors": "actuator_motors"})


def flights_of(log: FlightLog) -> tuple[list[FlightLog], list[str]]:
    source = file()
    up = motors_up(log, source)
    check_accel(log, source, up)
    found = find_flights(log, source, up)
    for flight in found:
        check_flight(flight, source)
    note_saturation(found, source)
    return found, [str(note) for note in source.notes]


def refusal(log: FlightLog) -> str:
    with pytest.raises(ConfigError) as error:
        flights_of(log)
    return str(error.value)


def test_flight_lies_between_take_off_and_landing() -> None:
    found, notes = flights_of(LOG)
    assert len(found) == 1
    assert not notes
    # 0.53 m of clearance are reached 1.3 s after the climb of 4 s begins, and left as long before it ends.
    assert TAKE_OFF_S < found[0].start_s < TAKE_OFF_S + 0.5 * CLIMB_S
    assert 40.0 - TAKE_OFF_S - 0.5 * CLIMB_S - 1.0 < found[0].end_s < 40.0 - TAKE_OFF_S
    assert found[0].pose is not None
    assert found[0].pose.values[:, 2].min() > 0.6
    assert gain_of(found[0], X500) == pytest.approx(1.0, abs=1e-3)


def test_log_that_begins_and_ends_in_the_air_is_used_whole() -> None:
    found, _ = flights_of(LOG.between(10.0, 30.0, "cut"))
    assert [(f.start_s, f.end_s) for f in found] == [pytest.approx((10.0, 30.0), abs=0.02)]


def test_crash_at_the_end_is_left_out_with_its_time() -> None:
    def blow(t_s: Array, values: Array) -> tuple[Array, Array]:
        values[(t_s > 31.0) & (t_s < 31.1)] = (150.0, 80.0, -100.0)
        return t_s, values

    def stop(t_s: Array, values: Array) -> tuple[Array, Array]:
        values[t_s > 31.2] = 0.0
        return t_s, values

    def fall(t_s: Array, values: Array) -> tuple[Array, Array]:
        values[t_s > 31.1, 2] = 0.1  # it struck a roof and lies beside the house
        return t_s, values

    crashed = with_series(with_series(with_series(LOG, "accel", blow), "motors", stop), "pose", fall)
    found, notes = flights_of(crashed)
    assert len(found) == 1
    assert found[0].end_s < 31.0
    assert any("crash at 31.0" in note for note in notes)


def test_gap_splits_the_flight_and_is_named() -> None:
    def gap(t_s: Array, values: Array) -> tuple[Array, Array]:
        kept = (t_s < 15.0) | (t_s > 16.5)
        return t_s[kept], values[kept]

    found, notes = flights_of(with_series(LOG, "rate", gap))
    assert len(found) == 2
    assert found[0].end_s == pytest.approx(15.0, abs=0.02)
    assert found[1].start_s == pytest.approx(16.5, abs=0.02)
    assert any("sensor_combined.gyro_rad: has a gap from 14.99 to 16.51 s" in note for note in notes)


def test_rows_repeated_by_a_broken_link_are_a_gap() -> None:
    def held(t_s: Array, values: Array) -> tuple[Array, Array]:
        lost = np.flatnonzero((t_s > 15.0) & (t_s < 16.5))
        values[lost] = values[lost[0] - 1]
        return t_s, values

    found, notes = flights_of(with_series(with_series(LOG, "rate", held), "pose", held))
    assert len(found) == 2
    assert found[0].end_s == pytest.approx(15.0, abs=0.02)
    assert found[1].start_s == pytest.approx(16.5, abs=0.02)
    assert any("sensor_combined.gyro_rad: repeats its values, as the pose does, for 1.5" in note for note in notes)


def test_a_pose_alone_or_a_short_repetition_is_no_gap() -> None:
    def held(until_s: float) -> Callable[[Array, Array], tuple[Array, Array]]:
        def change(t_s: Array, values: Array) -> tuple[Array, Array]:
            lost = np.flatnonzero((t_s > 15.0) & (t_s < until_s))
            values[lost] = values[lost[0] - 1]
            return t_s, values

        return change

    for log in (
        with_series(LOG, "pose", held(15.5)),
        with_series(with_series(LOG, "rate", held(15.25)), "pose", held(15.25)),
    ):
        assert len(flights_of(log)[0]) == 1


def test_saturated_motors_are_counted() -> None:
    def limit(t_s: Array, values: Array) -> tuple[Array, Array]:
        values[(t_s > 20.0) & (t_s < 22.0), 1] = 1.0
        return t_s, values

    _, notes = flights_of(with_series(LOG, "motors", limit))
    assert any("actuator_motors: is at full command in 6% of the flight, first at 20.0" in note for note in notes)
    assert "is at full command in 100%" in refusal(
        with_series(LOG, "motors", lambda t, u: (t, np.where(u > 0, 1.0, u)))
    )


def turned(log: FlightLog, order: list[int]) -> FlightLog:
    return with_series(log, "pose", lambda t, x: (t, np.hstack([x[:, :3], x[:, 3:][:, order]])))


WRONG: list[tuple[Change, str, str]] = [
    (lambda log: scaled(log, "rate", 180.0 / math.pi), "sensor_combined.gyro_rad", "looks like deg/s"),
    (lambda log: scaled(log, "accel", 1.0 / 9.80665), "accel", "looks like g, not"),
    (lambda log: scaled(log, "accel", 1000.0 / 9.80665), "accel", "looks like mg, not"),
    (lambda log: scaled(log, "pose", 100.0, slice(0, 3)), "pose", "looks like cm, not"),
    (lambda log: scaled(log, "pose", 1000.0, slice(0, 3)), "pose", "looks like mm, not"),
    (lambda log: scaled(log, "velocity", 100.0), "velocity", "looks like cm/s, not"),
    (lambda log: scaled(log, "velocity", 3.6), "velocity", "looks like km/h, not"),
    (lambda log: scaled(log, "accel", -1.0, slice(1, 3)), "accel", "points down"),
    (lambda log: scaled(log, "rate", -1.0), "sensor_combined.gyro_rad", "does not turn as the attitude"),
    (lambda log: turned(log, [1, 2, 3, 0]), "sensor_combined.gyro_rad", "the order of the quaternion (w first)"),
    (lambda log: turned(log, [1, 0, 2, 3]), "pose", "away from the vertical"),
    (lambda log: with_series(log, "motors", lambda t, u: (t, u[:, [1, 0, 3, 2]])), "actuator_motors", "against its"),
    (
        lambda log: replace(scaled(log, "motors", 1000.0 * 30.0 / math.pi), motors_kind="speed_radps"),
        "actuator_motors",
        "looks like rpm",
    ),
    (lambda log: scaled(log, "motors", 0.3), "actuator_motors", "lifts 0.09"),
    (
        lambda log: replace(log, voltage=Series(log.motors.t_s, np.full((len(log.motors), 1), 15200.0))),
        "voltage",
        "looks like mV",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("change", "topic", "message"), WRONG)
def test_wrong_unit_or_axis_is_named(change: Change, topic: str, message: str) -> None:
    text = refusal(change(LOG))
    assert text.startswith(f"flown.ulg: {topic}: ")
    assert message in text
    assert " s" in text
    assert text.endswith(")")  # the remedy


def test_two_vehicles_are_told_apart() -> None:
    flights, _ = flights_of(LOG)
    other = replace(scaled(flights[0], "motors", 0.75), source=Path("other.ulg"))
    with pytest.raises(ConfigError, match="two vehicles are mixed"):
        check_one_vehicle([flights[0], other], X500)
    check_one_vehicle([flights[0], scaled(flights[0], "motors", 0.95)], X500)
    speeds = replace(scaled(flights[0], "motors", 1000.0), motors_kind="speed_radps", source=Path("other.ulg"))
    with pytest.raises(ConfigError, match=r"other\.ulg: has measured speeds of its motors from"):
        check_one_vehicle([flights[0], speeds], X500)


@pytest.mark.parametrize("late_s", [0.0, 0.013, 0.05])
def test_delays_of_motors_and_pose_are_found(late_s: float) -> None:
    flight = flights_of(LOG)[0][0]
    early = with_series(flight, "motors", lambda t, u: (t - late_s, u))
    found = delays_of(early, X500)
    # A command is held for 10 ms, so its mean effect is half of that later than its time.
    assert found.motors_to_gyro_s == pytest.approx(late_s - 0.005, abs=2e-3)
    assert delays_of(with_series(flight, "pose", lambda t, x: (t + late_s, x)), X500).gyro_to_pose_s == pytest.approx(
        late_s, abs=2e-3
    )


def test_what_is_flown_is_excited_and_what_is_not_is_named() -> None:
    noise = np.random.default_rng(1)

    def noisy(log: FlightLog) -> FlightLog:
        log = with_series(log, "accel", lambda t, x: (t, x + 0.1 * noise.standard_normal(x.shape)))
        return with_series(log, "rate", lambda t, x: (t, x + 0.005 * noise.standard_normal(x.shape)))

    moving = excitation_of([flights_of(noisy(LOG))[0][0]], X500).parameters
    assert all(moving[i].excited for i in (THRUST, ROLL, PITCH))
    hover = excitation_of([flights_of(noisy(flown_log(motion=0.0)))[0][0].between(12.0, 28.0, "hover")], X500)
    assert not any(hover.parameters[i].excited for i in (ROLL, PITCH, YAW, UP, DOWN, ROTOR_DRAG))
    assert all(hover.parameters[i].relative_sigma > 20.0 * moving[i].relative_sigma for i in (ROLL, PITCH, YAW))
    assert {p.manoeuvre for p in hover.missing} >= {"roll", "pitch", "yaw", "legs"}


def test_measured_speeds_show_no_lag() -> None:
    flight = flights_of(LOG)[0][0]
    speeds = replace(scaled(flight, "motors", X500.rotor_constants.max_speed_radps), motors_kind="speed_radps")
    found = excitation_of([speeds], X500).parameters
    assert math.isinf(found[UP].relative_sigma)
    assert math.isinf(found[DOWN].relative_sigma)
    assert found[ROLL].excited


def test_voltage_that_never_changes_is_not_used() -> None:
    def prepared(volts: np.ndarray) -> tuple[FlightLog, LogFile]:
        source = LogFile(Path("flown.ulg"), X500)
        log = replace(LOG, voltage=Series(LOG.motors.t_s, volts[:, None]))
        return with_measured_voltage(log, source), source

    log, source = prepared(np.full(len(LOG.motors), 12.6))
    assert log.voltage is None
    assert "stays at 12.60 V" in str(source.notes[0])
    log, source = prepared(np.linspace(16.0, 15.0, len(LOG.motors)))
    assert log.voltage is not None
    assert not source.notes
