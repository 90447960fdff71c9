"""Facts about ArduPilot.

Texts: ArduCopter/ekf_check.cpp ("EKF Failsafe: changed to LAND Mode"), events.cpp ("Radio Failsafe - Continuing Auto",
"Failsafe: Terrain data missing"), crash_check.cpp, libraries/AC_Fence, libraries/AP_AdvancedFailsafe; ArduPlane's
events.cpp and radio.cpp ("RC Long Failsafe On: RTL", "Throttle failsafe on"). Meanwhile ArduCopter's
HEARTBEAT has MAV_STATE_CRITICAL (`any_failsafe_triggered`).
"""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.ground_station.modes import ARDUPILOT as MAV_AUTOPILOT_ARDUPILOT
from firmware_bridge.ground_station.projections import ardupilot_ned
from firmware_bridge.manual.manual_control import ARDUCOPTER_MODES

ARDUPILOT = Firmware(
    name="ArduPilot",
    failsafe_texts=(
        r"^(?!PreArm:|Arm:).*failsafe(?!.*\b(cleared|off)\b)",
        r"fence breached",
        r"^crash: disarming",
        r"^terminating",
    ),
    mav_autopilot=MAV_AUTOPILOT_ARDUPILOT,
    first_mission_item=1,  # item 0 is home
    project=ardupilot_ned,
    manual_modes=ARDUCOPTER_MODES,
)
