"""What a page may break: from its message to the fault that begins now."""

from __future__ import annotations

from typing import Any

import pydantic
import pytest

from firmware_bridge.faults.link_fault import LinkFault
from hil.companion.link_faults import CompanionFault
from hil.dashboard.faults_by_hand import fault_of
from sim.physics.faults import RotorFault
from sim.scene.wind import GustEvent


def test_links_are_broken_from_now_on() -> None:
    fault, words = fault_of(
        {"link": "autopilot", "kind": "drop", "rate": 0.5, "messages": ["HIL_GPS"], "for_s": 3}, 20.5
    )
    assert fault == LinkFault(kind="drop", at_s=20.5, for_s=3.0, rate=0.5, messages=("HIL_GPS",))
    assert words == "link of the autopilot: drop 50 % of HIL_GPS for 3 s"
    fault, words = fault_of({"link": "explore", "kind": "delay", "delay_s": 0.2}, 1.0)
    assert fault == CompanionFault(kind="delay", client="explore", at_s=1.0, delay_s=0.2)
    assert words == "link of explore: delay by 0.2 s"
    fault, words = fault_of({"link": "explore", "kind": "unplug", "for_s": 2.0}, 1.0)
    assert fault.end_ns == 3_000_000_000
    assert words == "link of explore: unplug for 2 s"


def test_all_else_as_before() -> None:
    rotor, words = fault_of({"kind": "efficiency", "rotor": 1, "factor": 0.7}, 2.0)
    assert isinstance(rotor, RotorFault)
    assert words == rotor.text
    sensor, words = fault_of({"kind": "dropout", "sensor": "gps", "for_s": 5}, 2.0)
    assert (sensor.sensor, sensor.at_s, sensor.until_s, words) == ("gps", 2.0, 7.0, "gps: dropout")
    gust, _ = fault_of({"velocity_W_mps": [1.0, 0.0, 0.0], "rise_s": 0.5, "hold_s": 2, "fall_s": 0.5}, 2.0)
    assert isinstance(gust, GustEvent)


@pytest.mark.parametrize(
    "asked",
    [
        {"link": "autopilot", "kind": "drop"},
        {"link": "autopilot", "kind": "drop", "rate": 1, "messages": ["NO_SUCH"]},
        {"link": "autopilot", "kind": "drop", "rate": True},
        {"link": "autopilot", "kind": "unplug", "for_s": "soon"},
        {"link": "autopilot", "kind": "drop", "rate": 0.1, "client": "x"},
        {"link": "", "kind": "unplug"},
        {"link": "explore", "kind": "corrupt", "rate": 0.1},
        {"link": "explore", "kind": "unplug", "for_s": -1},
        {"link": 3, "kind": ["drop"]},
        {"kind": "nonsense"},
    ],
)
def test_nonsense_is_refused(asked: dict[str, Any]) -> None:
    with pytest.raises((ValueError, TypeError, KeyError, pydantic.ValidationError)):
        fault_of(asked, 1.0)
