"""Facts about the firmware of the mock Pixhawk (`firmware_bridge.mock_pixhawk.flight.failsafe`)."""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware

MOCK = Firmware(
    name="mock",
    failsafe_texts=(r"^failsafe", r"^flight termination"),  # the other texts come with MAV_STATE_CRITICAL
    mav_autopilot=12,
    bytewise_params=True,
)
