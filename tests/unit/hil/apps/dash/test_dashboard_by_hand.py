"""Faults that a page requests: from its message to a fault that begins at once."""

from __future__ import annotations

from typing import Any

import pydantic
import pytest

from firmware_bridge.faults.companion_fault import CompanionFault
from firmware_bridge.faults.link_fault import LinkFault
from hil.run.loop.fault_request import requested_fault
from sim.physics.faults import RotorFault
from sim.scene.wind import GustEvent


def test_faults_of_links_begin_at_once() -> None:
    fault, words = requested_fault(
        {"link": "autopilot", "kind": "drop", "rate": 0.5, "messages": ["HIL_GPS"], "for_s": 3}, 20.5
    )
    assert fault == LinkFault(kind="drop", at_s=20.5, for_s=3.0, rate=0.5, messages=("HIL_GPS",))
    assert words == "link of the autopilot: drop 50 % of HIL_GPS for 3 s"
    fault, words = requested_fault({"link": "explore", "kind": "delay", "delay_s": 0.2}, 1.0)
    assert fault == CompanionFault(kind="delay", client="explore", at_s=1.0, delay_s=0.2)
    assert words == "link of explore: delay by 0.2 s"
    fault, words = requested_fault({"link": "explore", "kind": "unplug", "for_s": 2.0}, 1.0)
    assert fault.end_ns == 3_000_000_000
    assert words == "link of explore: unplug for 2 s"


def test_faults_of_rotors_sensors_and_wind() -> None:
    rotor, words = requested_fault({"kind": "efficiency", "rotor": 1, "factor": 0.7}, 2.0)
    assert isinstance(rotor, RotorFault)
    assert words == rotor.text
    sensor, words = requested_fault({"kind": "dropout", "sensor": "gps", "for_s": 5}, 2.0)
    assert (sensor.sensor, sensor.at_s, sensor.until_s, words) == ("gps", 2.0, 7.0, "gps: dropout")
    gust, _ = requested_fault({"velocity_W_mps": [1.0, 0.0, 0.0], "rise_s": 0.5, "hold_s": 2, "fall_s": 0.5}, 2.0)
    assert isinstance(gust, GustEvent)


@pytest.mark.parametrize(
    "fields",
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
def test_invalid_requests_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises((ValueError, TypeError, KeyError, pydantic.ValidationError)):
        requested_fault(fields, 1.0)
