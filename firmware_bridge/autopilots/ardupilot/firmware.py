"""Facts about ArduPilot.

Texts: ArduCopter/ekf_check.cpp ("EKF Failsafe: changed to LAND Mode"), events.cpp ("Radio Failsafe - Continuing Auto",
"Failsafe: Terrain data missing"), crash_check.cpp, libraries/AC_Fence, libraries/AP_AdvancedFailsafe; ArduPlane's
events.cpp and radio.cpp ("RC Long Failsafe On: RTL", "Throttle failsafe on"). Meanwhile ArduCopter's
HEARTBEAT has MAV_STATE_CRITICAL (`any_failsafe_triggered`).
"""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware, ModeNumber
from firmware_bridge.ground_station.modes import ARDUPILOT as MAV_AUTOPILOT_ARDUPILOT
from firmware_bridge.ground_station.projections import ardupilot_ned

_COPTER_MODES = {
    "MISSION": 3,
    "HOLD": 17,
    "RTL": 6,
    "LAND": 9,
    "OFFBOARD": 4,
    "POSITION": 16,
    "ALTITUDE": 2,
    "STABILIZED": 0,
}

ARDUPILOT = Firmware(
    name="ArduPilot",
    failsafe_texts=(
        r"^(?!PreArm:|Arm:).*failsafe(?!.*\b(cleared|off)\b)",
        r"fence breached",
        r"^crash: disarming",
        r"^terminating",
    ),
    board_params=(
        r"(INS|COMPASS|BARO\d?|GPS\d?|SERIAL\d|BRD|CAN|NET|STAT|RC\d*|SERVO\d+|SIM|BATT\d?|LOG|AHRS_TRIM|EAHRS|NTF)_\w+",
        r"(SYSID_THISMAV|MAV_SYSID|FORMAT_VERSION|FS_THR_ENABLE|AUTO_OPTIONS|SCHED_LOOP_RATE|MOT_(PWM|SPIN|BAT)_\w+)",
    ),
    mav_autopilot=MAV_AUTOPILOT_ARDUPILOT,
    first_mission_item=1,
    arms_in_guided=True,
    fails_until_ready=True,
    plain_masks=True,
    flight_logs={"logs/*.BIN": "DataFlash: MAVExplorer, UAV Log Viewer, pymavlink"},
    modes={word: ModeNumber(number, 0, number) for word, number in _COPTER_MODES.items()},
    project=ardupilot_ned,
    manual_modes={
        "stabilized": (0.0, 0.0),
        "acro": (1.0, 0.0),
        "altitude": (2.0, 0.0),
        "hold": (5.0, 0.0),
        "return": (6.0, 0.0),
        "land": (9.0, 0.0),
        "position": (16.0, 0.0),
    },
)
