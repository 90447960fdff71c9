"""Facts about ArduPilot.

Texts: ArduCopter/ekf_check.cpp ("EKF Failsafe: changed to LAND Mode"), events.cpp ("Radio Failsafe - Continuing Auto",
"Failsafe: Terrain data missing"), crash_check.cpp, libraries/AC_Fence, libraries/AP_AdvancedFailsafe; ArduPlane's
events.cpp and radio.cpp ("RC Long Failsafe On: RTL", "Throttle failsafe on"). Meanwhile ArduCopter's
HEARTBEAT has MAV_STATE_CRITICAL (`any_failsafe_triggered`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

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

# ArduPlane/mode.h
_PLANE_MODES = {
    "MISSION": 10,
    "HOLD": 12,
    "RTL": 11,
    "LAND": 26,
    "TAKEOFF": 13,
    "OFFBOARD": 15,
    "POSITION": 7,
    "ALTITUDE": 6,
    "STABILIZED": 5,
}
_OTHER_PLANE_MODES = {
    0: "MANUAL",
    1: "CIRCLE",
    2: "STABILIZE",
    3: "TRAINING",
    4: "ACRO",
    8: "AUTOTUNE",
    14: "AVOID_ADSB",
    16: "INITIALISING",
    17: "QSTABILIZE",
    18: "QHOVER",
    19: "QLOITER",
    20: "QLAND",
    21: "QRTL",
    22: "QAUTOTUNE",
    23: "QACRO",
    24: "THERMAL",
    25: "LOITER_ALT_QLAND",
}
# MAV_TYPE of ArduPlane: a plane, and its VTOLs (tailsitters, tiltrotor, others).
PLANE_TYPES = (1, 19, 20, 21, 22, 23, 24, 25)


def _modes(numbers: Mapping[str, int]) -> dict[str, ModeNumber]:
    return {word: ModeNumber(number, 0, number) for word, number in numbers.items()}


_COPTER = Firmware(
    name="ArduPilot",
    program="ArduCopter",
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
    modes=_modes(_COPTER_MODES),
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

# It arms in AUTO, and flies no set-points in the local frame.
PLANE = replace(
    _COPTER,
    program="ArduPlane",
    arms_in_guided=False,
    modes=_modes(_PLANE_MODES),
    other_modes=_OTHER_PLANE_MODES,
    project=None,
    manual_modes={
        "manual": (0.0, 0.0),
        "acro": (4.0, 0.0),
        "stabilized": (5.0, 0.0),
        "altitude": (6.0, 0.0),
        "position": (7.0, 0.0),
        "return": (11.0, 0.0),
        "hold": (12.0, 0.0),
        "land": (26.0, 0.0),
    },
)

ARDUPILOT = replace(_COPTER, by_type=dict.fromkeys(PLANE_TYPES, PLANE))
"""Facts about ArduCopter, and by type those about ArduPlane."""
