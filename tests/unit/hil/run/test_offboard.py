"""Ends of flights by set-points: something of the bench judges them, or the vehicle has landed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from firmware_bridge.ground_station.phased_flight import Phase
from hil.run.offboard import why_unflown, why_unlanded


def bench(**judged: object) -> Any:
    config = {"mission": None, "goal": None, "search": None, "duration_s": 5.0} | judged
    return SimpleNamespace(config=SimpleNamespace(**config), script=None)


def pilot(phase: Phase) -> Any:
    return SimpleNamespace(phase=phase, ready=True)


@pytest.mark.parametrize("judge", ["mission", "goal", "search"])
def test_a_flight_whose_end_is_judged_may_end_in_the_air(judge: str) -> None:
    assert "never landed" in why_unlanded(pilot(Phase.FLYING), bench(), "companion", "let it land")
    assert why_unlanded(pilot(Phase.FLYING), bench(**{judge: object()}), "companion", "let it land") == ""


def test_a_vehicle_that_is_being_armed_has_not_flown() -> None:
    assert why_unlanded(pilot(Phase.ARMING), bench(), "companion", "let it land") == ""
    assert why_unflown(pilot(Phase.ARMING), bench(), "companion").endswith("the flight ended in the phase arming")
    assert why_unflown(pilot(Phase.PREFLIGHT), bench(), "companion").endswith("moves the vehicle")
