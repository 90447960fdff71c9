"""Declared measurements of flights with known figures, and their effect on the verdict."""

from __future__ import annotations

import math
from typing import Any

import pytest

from firmware_bridge.ground_station.actions import Record
from hil.config.missions.script import Expectation, Script
from hil.config.schema import Limits
from hil.run.verdict.flight import Measurements, judge
from hil.run.verdict.measurements import DeclaredMeasurements, judge_script, measured_on_ground
from signals.samples import TruthState

DT_NS = 10_000_000


def truth(tick: int, **fields: Any) -> TruthState:
    state: dict[str, Any] = {
        "p_WB": (1.0, 2.0, 0.2),
        "q_WB": (1.0, 0.0, 0.0, 0.0),
        "v_WB_W": (0.0, 0.0, 0.0),
        "w_WB_B": (0.0, 0.0, 0.0),
        "a_WB_W": (0.0, 0.0, 0.0),
        "alpha_WB_B": (0.0, 0.0, 0.0),
        "rotor_speed_radps": (0.0,) * 4,
        "in_contact": True,
    }
    return TruthState(tick=tick, t_ns=tick * DT_NS, **(state | fields))


def measure(states: list[TruthState], *declared: dict[str, Any]) -> list[float | None]:
    observer = DeclaredMeasurements([Expectation(**d) for d in declared])
    for state in states:
        observer.add(state)
    return [measured.value for measured in observer.results()]


def hop(height_m: float = 3.0, seconds: float = 10.0) -> list[TruthState]:
    """Up and down as half a sine, drifting east by 0.1 m/s, tilting up to 20 degrees."""
    states = [truth(0)]
    for tick in range(1, round(seconds * 100)):
        t = tick / 100
        phase = math.pi * t / seconds
        roll = math.radians(20.0) * math.sin(phase)
        states.append(
            truth(
                tick,
                p_WB=(1.0 + 0.1 * t, 2.0, 0.2 + height_m * math.sin(phase)),
                q_WB=(math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0),
                v_WB_W=(0.1, 0.0, height_m * math.pi / seconds * math.cos(phase)),
                w_WB_B=(0.0, 0.0, math.radians(tick % 50)),
                in_contact=False,
            )
        )
    return [*states, truth(len(states), p_WB=(2.0, 2.0, 0.2)), truth(len(states) + 1, p_WB=(2.0, 2.0, 0.2))]


def test_every_measure_of_a_known_flight() -> None:
    names = ["max_tilt_deg", "max_rate_degps", "max_speed_mps", "max_climb_mps", "max_sink_mps", "max_altitude_m"]
    names += ["max_distance_m", "flight_time_s", "time_to_complete_s"]
    values = dict(zip(names, measure(hop(), *({"measure": name} for name in names)), strict=True))
    climb = 3.0 * math.pi / 10.0
    assert values == pytest.approx(
        {
            "max_tilt_deg": 20.0,
            "max_rate_degps": 49.0,
            "max_speed_mps": math.hypot(climb, 0.1),
            "max_climb_mps": climb,
            "max_sink_mps": climb,
            "max_altitude_m": 3.0,
            "max_distance_m": 1.0,
            "flight_time_s": 10.0 - 0.32,  # 0.3 m up after 0.319 s
            "time_to_complete_s": 10.0,
        },
        rel=1e-3,
    )


def test_windows_are_closed_and_drift_counts_from_their_start() -> None:
    window = {"from_s": 4.0, "to_s": 6.0}
    drift, height, least, most = measure(
        hop(),
        {"measure": "hover_drift_m", **window},
        {"measure": "height_drift_m", **window},
        {"measure": "min_altitude_m", **window},
        {"measure": "max_altitude_m", "from_s": 0.0, "to_s": 1.0},
    )
    low = 3.0 * math.sin(0.4 * math.pi)
    assert drift == pytest.approx(0.2)
    assert height == pytest.approx(3.0 - low)
    assert least == pytest.approx(low)
    assert most == pytest.approx(3.0 * math.sin(0.1 * math.pi))


def test_a_missing_measurement_is_none_and_nan_stays() -> None:
    assert measure(hop(), {"measure": "max_speed_mps", "from_s": 60.0}) == [None]
    assert measure(hop()[:500], {"measure": "flight_time_s"}, {"measure": "time_to_complete_s"}) == [None, None]
    broken = [*hop(), truth(2000, v_WB_W=(math.nan, 0.0, 0.0)), truth(2001, v_WB_W=(99.0, 0.0, 0.0))]
    (value,) = measure(broken, {"measure": "max_speed_mps"})
    assert value is not None
    assert math.isnan(value)


def verdict_of(script: dict[str, Any], states: list[TruthState], records: tuple[Record, ...] = ()) -> Any:
    parsed = Script(**script)
    observer = DeclaredMeasurements(parsed.expect)
    for state in states:
        observer.add(state)
    return judge_script(observer.results(), records)


@pytest.mark.parametrize("limit", ["at_most", "at_least"])
def test_a_limit_on_what_was_never_measured_fails(limit: str) -> None:
    never = verdict_of({"expect": ({"measure": "max_speed_mps", "from_s": 50.0, limit: 1.0},)}, hop())
    assert never.status == "FAIL"
    assert never.reasons == (
        "max_speed_mps has a limit but was never measured: the run ended too early or without a touch-down",
    )


def test_a_missed_window_names_the_take_off() -> None:
    late = [truth(tick) for tick in range(2000)]
    late += [truth(2000 + i, p_WB=s.p_WB, in_contact=s.in_contact) for i, s in enumerate(hop())]
    window = {"expect": ({"measure": "min_altitude_m", "from_s": 5, "to_s": 15.5, "at_least": 1.4},)}
    missed = "min_altitude_m is 0 m, less than the required 1.4 m (from 5 s to 15.5 s; "
    assert verdict_of(window, late).reasons == (missed + "it took off at 20.3 s)",)
    assert verdict_of(window, late[:2000]).reasons == (missed + "it never took off)",)


@pytest.mark.parametrize(("to_s", "status"), [(9.9, "PASS"), (10.004, "PASS"), (10.5, "FAIL"), (1000.0, "FAIL")])
def test_a_window_that_the_run_did_not_reach_the_end_of_was_not_measured(to_s: float, status: str) -> None:
    for window in ({"from_s": 4.0, "to_s": to_s}, {"to_s": to_s}):
        verdict = verdict_of({"expect": ({"measure": "max_tilt_deg", "at_most": 90.0, **window},)}, hop())
        assert verdict.status == status
        assert ["only until the run ended at 10.0 s" in r for r in verdict.reasons] == [True] * (status == "FAIL")
        assert verdict_of({"expect": ({"measure": "max_tilt_deg", **window},)}, hop()).status == "PASS"  # only shown


def test_limits_on_measurements_decide() -> None:
    good = verdict_of({"expect": ({"measure": "max_tilt_deg", "at_most": 21.0},)}, hop())
    assert good.status == "PASS"
    assert [(row.name, row.limit, row.unit, row.ok) for row in good.rows[-1:]] == [("max_tilt_deg", 21.0, "deg", True)]
    bad = verdict_of(
        {
            "expect": (
                {"measure": "max_tilt_deg", "at_most": 19.0},
                {"measure": "max_altitude_m", "at_least": 4.0, "name": "height"},
                {"measure": "max_speed_mps", "from_s": 50.0, "at_most": 1.0},
                {"measure": "max_speed_mps", "from_s": 51.0, "name": "only shown"},
            )
        },
        hop(),
    )
    assert bad.status == "FAIL"
    assert bad.reasons == (
        "max_tilt_deg is 20 deg, more than the 19 deg allowed",
        "height is 3 m, less than the required 4 m",
        "max_speed_mps has a limit but was never measured: the run ended too early or without a touch-down",
    )
    assert [row.ok for row in bad.rows[-4:]] == [False, False, False, True]
    nan = verdict_of({"expect": ({"measure": "max_speed_mps", "at_most": 900.0},)}, [truth(0, v_WB_W=(math.nan, 0, 0))])
    assert nan.status == "FAIL"


def plan_measured(*, completed: bool) -> Measurements:
    called_for = frozenset({"max_cross_track_m", "final_error_m"})
    reached = 3 if completed else 1
    value = 0.1 if completed else None
    return Measurements(3, reached, completed, completed, False, value, None, value, None, None, called_for)


@pytest.mark.parametrize(
    ("outcome", "completed", "status"),
    [
        ("complete", True, "PASS"),
        ("complete", False, "FAIL"),
        ("aborted", True, "FAIL"),
        ("aborted", False, "PASS"),
        ("any", True, "PASS"),
        ("any", False, "PASS"),
        ("crashed", True, "PASS"),  # the crash itself is judged by its own part
        ("crashed", False, "PASS"),
    ],
)
def test_the_outcome_that_a_script_expects(outcome: Any, completed: bool, status: str) -> None:
    assert judge(plan_measured(completed=completed), Limits(), outcome=outcome).status == status


def test_actions_that_never_ran_fail_the_flight() -> None:
    records = (
        Record("a.yaml:3: set_mode HOLD", True, None, "waiting"),
        Record("a.yaml:4: arm", True, 5, "running"),
        Record("a.yaml:5: gust", False, None, "waiting"),
        Record("a.yaml:6: gust", True, 7, "done"),
    )
    verdict = verdict_of({}, hop(), records)
    assert verdict.reasons == (
        "a.yaml:3: set_mode HOLD: never ran, its condition was never met",
        "a.yaml:4: arm: not acknowledged before the run ended",
    )


@pytest.mark.parametrize(
    ("window", "reason", "warned"),
    [
        ({"from_s": 10.01, "to_s": 10.02}, "was measured on the ground (from 10.01 s to 10.02 s", True),
        ({"from_s": 0, "to_s": 0.005}, "was measured on the ground (from 0 s to 0.005 s", True),
        ({"from_s": 9.98, "to_s": 10.02}, "", False),
    ],
)
def test_what_is_measured_on_the_ground_says_nothing(window: dict[str, float], reason: str, warned: bool) -> None:
    """A hover that had landed before its window passed, without a word."""
    names = ("hover_drift_m", "height_drift_m", "max_tilt_deg")
    observer = DeclaredMeasurements([Expectation(measure=name, at_most=25, **window) for name in names])
    for state in hop():
        observer.add(state)
    reasons = judge_script(observer.results()).reasons
    assert [text.split(" ")[0] for text in reasons] == (list(names[:2]) if reason else [])
    assert all(reason in text for text in reasons)
    assert [text.split(" ")[0] for text in measured_on_ground(observer.results())] == ([names[2]] if warned else [])


@pytest.mark.parametrize(("again_m", "complete_s"), [(0.2, 10.0), (3.0, None)])
def test_a_flight_that_goes_on_is_not_complete(again_m: float, complete_s: float | None) -> None:
    """One that touched down, took off again and was in the air at the end had its time; one that bounces has it."""
    states = hop()
    up = [truth(len(states) + k, p_WB=(2.0, 2.0, 0.2 + again_m), in_contact=False) for k in range(50)]
    complete, flight = measure([*states, *up], {"measure": "time_to_complete_s"}, {"measure": "flight_time_s"})
    assert complete == (None if complete_s is None else pytest.approx(complete_s))
    assert (flight is None) == (complete is None)
