"""Faults by hand that would not reach the autopilot are refused, as declared ones are."""

from __future__ import annotations

import pytest

from hil.run.parts.links.intake import make
from sim.sensors.faults import FAULT_LIST
from tests.worlds.bench_files import elsewhere, load

__all__ = ["elsewhere"]


@pytest.mark.parametrize(
    ("rig", "fault", "says"),
    [
        ("ardupilot_sitl", {"sensor": "gps", "kind": "freeze"}, "kind cannot be freeze: it would not reach"),
        ("mock", {"sensor": "imu", "kind": "offset", "field": "temperature_degc", "value": 1.0}, "field cannot be"),
        ("ardupilot_sitl", {"sensor": "gps", "kind": "dropout"}, ""),
        ("mock", {"sensor": "gps", "kind": "freeze"}, ""),
        ("mock", {"sensor": "gps", "kind": "offset", "field": "none", "value": 1.0}, ""),  # the sensor refuses it
    ],
)
def test_a_fault_by_hand(rig: str, fault: dict[str, object], says: str) -> None:
    part = make(load(f"rig: {rig}\n" + ("autopilot: {start: false}\n" if rig == "ardupilot_sitl" else "")))
    (made,) = FAULT_LIST.validate_python([{**fault, "at_s": 1.0}])
    if says:
        with pytest.raises(ValueError, match=says):
            part.inject(made, declared=False)
    else:
        assert part.inject(made, declared=False) is False
