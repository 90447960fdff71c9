"""Facts about the firmware of the mock Pixhawk (`mock_pixhawk/flight/failsafe.py`), which speaks as PX4."""

from __future__ import annotations

from dataclasses import replace

from firmware_bridge.autopilots.px4.firmware import PX4
from signals._kernel import tangent_ned

MOCK = replace(
    PX4,
    name="mock",
    failsafe_texts=(r"^failsafe", r"^flight termination"),  # the other texts come with MAV_STATE_CRITICAL
    airframe_parameter="",
    flight_logs={},
    project=tangent_ned,
)
