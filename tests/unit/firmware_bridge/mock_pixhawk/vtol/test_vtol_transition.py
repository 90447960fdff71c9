"""The transitions of the mock's VTOL: weights of the lifters, ramp of the pusher, ends, and reasons to give up."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vtol.transition import Motion, Regime, Transition

STEP_US = 20_000
GIVEN = {"VT_ARSP_BLEND": 10.0, "VT_ARSP_TRANS": 15.0, "VT_TRANS_TIMEOUT": 12.0}


def table(**more: float) -> ParamTable:
    params = ParamTable.of_firmware(plane=True, vtol=True)
    for name, value in (GIVEN | more).items():
        assert params.set(name, value) is None
    return params


def motion(**changed: float | None) -> Motion:
    usual = {"airspeed_mps": 0.0, "ahead_mps": 0.0, "height_m": 40.0, "asked_height_m": 40.0}
    return Motion(**(usual | {"roll_rad": 0.0, "pitch_rad": 0.0} | changed))  # type: ignore[arg-type]


def run(transition: Transition, seconds: float, now_us: int, **changed: float | None) -> tuple[int, str | None]:
    """Run for so long with one motion. Return the time and the first reason to give up."""
    reason = None
    for _ in range(round(seconds * 1e6 / STEP_US)):
        now_us += STEP_US
        reason = reason or transition.step(now_us, motion(**changed))
    return now_us, reason


def on_wings(**more: float) -> tuple[Transition, int]:
    transition = Transition(table(**more))
    assert transition.start_front(0, motion())
    now, reason = run(transition, 2.1, 0, airspeed_mps=16.0)
    assert reason is None
    assert transition.regime is Regime.WING
    return transition, now


def test_the_values_are_those_of_mav_vtol_state() -> None:
    from pymavlink.dialects.v20 import common

    names = {"FRONT": "TRANSITION_TO_FW", "BACK": "TRANSITION_TO_MC", "HOVER": "MC", "WING": "FW"}
    for regime in Regime:
        assert regime.value == getattr(common, f"MAV_VTOL_STATE_{names[regime.name]}")


def test_the_pusher_rises_at_its_slew_and_the_lifters_give_way_by_airspeed() -> None:
    transition = Transition(table(VT_PSHER_SLEW=0.25, VT_F_TRANS_THR=0.8))
    transition.start_front(0, motion())
    now, _ = run(transition, 1.0, 0, airspeed_mps=4.0)
    assert transition.throttle == pytest.approx(0.25)
    now, _ = run(transition, 3.0, now, airspeed_mps=4.0)
    assert transition.throttle == pytest.approx(0.8)
    for airspeed, weight in ((9.0, 1.0), (10.0, 1.0), (12.0, 0.6), (14.5, 0.1)):
        now, _ = run(transition, 0.02, now, airspeed_mps=airspeed)
        assert transition.weight == pytest.approx(weight)
        assert transition.regime is Regime.FRONT
    run(transition, 0.02, now, airspeed_mps=15.0)
    assert (transition.regime, transition.weight) == (Regime.WING, 0.0)


def test_no_front_transition_is_shorter_than_the_least_time() -> None:
    transition = Transition(table(VT_TRANS_MIN_TM=3.0))
    transition.start_front(0, motion())
    now, _ = run(transition, 3.0, 0, airspeed_mps=20.0)
    assert transition.regime is Regime.FRONT
    assert transition.weight == 1.0
    run(transition, 0.04, now, airspeed_mps=20.0)
    assert transition.regime is Regime.WING


def test_the_lifters_come_back_with_time_and_the_transition_ends_by_speed() -> None:
    transition, now = on_wings(VT_B_TRANS_RAMP=2.0, MPC_XY_CRUISE=5.0)
    assert transition.start_back(now)
    now, _ = run(transition, 1.0, now, airspeed_mps=14.0, ahead_mps=14.0)
    assert transition.weight == pytest.approx(0.5)
    now, _ = run(transition, 2.0, now, airspeed_mps=8.0, ahead_mps=8.0)
    assert transition.weight == 1.0
    assert transition.regime is Regime.BACK
    run(transition, 0.02, now, ahead_mps=4.9)
    assert transition.regime is Regime.HOVER


def test_a_back_transition_ends_after_its_time() -> None:
    transition, now = on_wings(VT_B_TRANS_DUR=4.0)
    transition.start_back(now)
    now, _ = run(transition, 4.0, now, airspeed_mps=12.0, ahead_mps=12.0)
    assert transition.regime is Regime.BACK
    run(transition, 0.04, now, airspeed_mps=12.0, ahead_mps=12.0)
    assert transition.regime is Regime.HOVER


@pytest.mark.parametrize(
    ("airspeed", "after_s", "reason"),
    [(9.0, 6.0, "airspeed too low"), (12.0, 12.0, "transition timeout")],
)
def test_a_front_transition_that_does_not_end(airspeed: float, after_s: float, reason: str) -> None:
    transition = Transition(table())
    transition.start_front(0, motion())
    now, found = run(transition, after_s, 0, airspeed_mps=airspeed)
    assert found is None
    _, found = run(transition, 0.02, now, airspeed_mps=airspeed)
    assert found == reason
    assert (transition.regime, transition.weight, transition.throttle) == (Regime.HOVER, 1.0, 0.0)
    assert not transition.start_front(now, motion()), "the wings are not used again in this flight"
    transition.reset()
    assert transition.start_front(now, motion())


def test_height_lost_in_the_front_transition_and_shortly_after_it() -> None:
    transition = Transition(table(VT_QC_T_ALT_LOSS=6.0))
    transition.start_front(0, motion())
    now, found = run(transition, 1.0, 0, airspeed_mps=5.0, height_m=34.5)
    assert found is None
    assert run(transition, 0.02, now, airspeed_mps=5.0, height_m=33.5)[1] == "altitude loss"
    for wait_s, reason in ((4.0, "altitude loss"), (5.1, None)):
        transition, now = on_wings(VT_QC_T_ALT_LOSS=6.0)
        now, _ = run(transition, wait_s, now, airspeed_mps=16.0)
        assert run(transition, 0.02, now, airspeed_mps=16.0, height_m=33.0)[1] == reason


@pytest.mark.parametrize(
    ("name", "value", "safe", "broken", "reason"),
    [
        ("VT_FW_MIN_ALT", 25.0, {"height_m": 25.1}, {"height_m": 24.9}, "minimum altitude"),
        ("VT_QC_ALT_LOSS", 8.0, {"height_m": 32.1}, {"height_m": 31.9}, "altitude loss"),
        ("VT_FW_QC_P", 30, {"pitch_rad": math.radians(29)}, {"pitch_rad": math.radians(-31)}, "maximum pitch"),
        ("VT_FW_QC_R", 60, {"roll_rad": math.radians(59)}, {"roll_rad": math.radians(-61)}, "maximum roll"),
    ],
)
def test_quad_chute_on_the_wings(
    name: str, value: float, safe: dict[str, float], broken: dict[str, float], reason: str
) -> None:
    transition, now = on_wings(VT_QC_T_ALT_LOSS=0.0, **{name: value})
    now, found = run(transition, 1.0, now, airspeed_mps=16.0, ahead_mps=16.0, **safe)
    assert found is None
    assert transition.regime is Regime.WING
    now, found = run(transition, 0.02, now, airspeed_mps=16.0, ahead_mps=16.0, **broken)
    assert found == reason
    # Fast, it brakes first, with all lifters.
    assert (transition.regime, transition.weight) == (Regime.BACK, 1.0)
    now, found = run(transition, 0.1, now, ahead_mps=4.0, **broken)
    assert found is None
    assert transition.regime is Regime.HOVER
    assert transition.failure == reason


def test_every_reason_fits_into_a_statustext() -> None:
    from firmware_bridge.mock_pixhawk.vtol import transition

    text = Path(transition.__file__).read_text(encoding="utf-8")
    reasons = [line.split('return "')[1].split('"')[0] for line in text.splitlines() if 'return "' in line]
    assert len(reasons) == 7
    assert all(len(f"Failsafe activated: quad-chute, {reason}") <= 50 for reason in [*reasons, "pusher failure"])
