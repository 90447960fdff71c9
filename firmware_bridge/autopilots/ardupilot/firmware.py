"""Facts about ArduPilot.

Texts: ArduCopter/ekf_check.cpp ("EKF Failsafe: changed to LAND Mode"), events.cpp ("Radio Failsafe - Continuing Auto",
"Failsafe: Terrain data missing"), crash_check.cpp, libraries/AC_Fence, libraries/AP_AdvancedFailsafe; ArduPlane's
events.cpp and radio.cpp ("RC Long Failsafe On: RTL", "Throttle failsafe on"). Meanwhile ArduCopter's
HEARTBEAT has MAV_STATE_CRITICAL (`any_failsafe_triggered`).
"""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware

ARDUPILOT = Firmware(
    name="ArduPilot",
    failsafe_texts=(
        r"^(?!PreArm:|Arm:).*failsafe(?!.*\b(cleared|off)\b)",
        r"fence breached",
        r"^crash: disarming",
        r"^terminating",
    ),
    mav_autopilot=3,
    bytewise_params=False,
)
