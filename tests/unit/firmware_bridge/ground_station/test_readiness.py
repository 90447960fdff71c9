"""Readiness to arm: pre-arm check, convergence of the estimator, and texts of a vehicle that is still starting."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.phased_flight import Estimator, Health, StatusTexts

Status = message_class("ESTIMATOR_STATUS")
SysStatus = message_class("SYS_STATUS")
Text = message_class("STATUSTEXT")
GOOD = 0x33F
PREARM = 0x10000000
S = 1_000_000_000


def report(flags: int = GOOD, **ratios: float) -> Any:
    fields = dict.fromkeys(Status._fields, 0.0) | {"time_usec": 0, "flags": flags} | ratios
    return Status(**fields)


def sys_status(*, present: int, health: int) -> Any:
    fields = dict.fromkeys(SysStatus._fields, 0)
    return SysStatus(
        **(fields | {"onboard_control_sensors_present": present, "onboard_control_sensors_health": health})
    )


def test_the_estimator_has_converged_after_good_reports_in_a_row() -> None:
    estimator = Estimator()
    assert "does not report" in estimator.problem()
    for count in range(20):
        estimator.on_status(report(flags=0x21))
        assert not estimator.converged, count
    assert "no horizontal position" in estimator.problem()
    for _ in range(7):
        estimator.on_status(report())
    assert not estimator.converged
    estimator.on_status(report())
    assert estimator.converged


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (report(flags=GOOD | 0x800), "bad accelerometer data"),
        (report(flags=GOOD | 0x400), "GPS glitch"),
        (report(pos_vert_ratio=3.4), "pos_vert_ratio 3.4"),
        (report(vel_ratio=float("nan")), "vel_ratio nan"),
    ],
)
def test_a_bad_report_starts_the_count_again(bad: Any, says: str) -> None:
    estimator = Estimator()
    for _ in range(8):
        estimator.on_status(report())
    estimator.on_status(bad)
    assert not estimator.converged
    assert says in estimator.problem()


def test_a_vehicle_waits_for_its_estimator_as_well_as_for_its_checks() -> None:
    estimator = Estimator()
    health = Health(estimator)
    health.on_sys_status(sys_status(present=PREARM, health=PREARM))
    assert not health.ready(60 * S)
    assert "its estimator" in health.problem()
    for _ in range(8):
        estimator.on_status(report())
    assert health.ready(61 * S)


def test_px4_reports_its_check_in_the_health_word_only() -> None:
    """PX4 1.14 and later never set the bit among the present sensors."""
    health = Health()
    health.on_sys_status(sys_status(present=0, health=0))
    assert not health.ready(0)
    health.on_sys_status(sys_status(present=0, health=PREARM))
    assert health.ready(S)


def test_failed_checks_of_a_vehicle_that_is_still_starting_are_no_errors() -> None:
    texts = StatusTexts()
    for starting in (True, False):
        for text in ("Arming denied: Resolve system health failures first", "Preflight Fail: no GPS", "Motor failed"):
            texts.on_statustext(0, Text(2, text), starting=starting)
    assert [severity for _, severity, _ in texts.texts] == [6, 6, 2, 2, 2, 2]
