"""Facts about PX4.

Since 1.14 `FailsafeBase::notifyUser` (src/modules/commander/failsafe/framework.cpp) sends "Failsafe activated" for
every action but a warning, as STATUSTEXT and as an EVENT with the cause. Meanwhile HEARTBEAT has MAV_STATE_CRITICAL.
EVENTs are not read: their texts lie in a file of each build.
"""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware, ModeNumber
from firmware_bridge.ground_station.modes import PX4 as MAV_AUTOPILOT_PX4
from firmware_bridge.ground_station.projections import px4_ned


def _mode(main: int, sub: int = 0) -> ModeNumber:
    return ModeNumber(main, sub, main << 16 | sub << 24)  # px4_custom_mode.h


PX4 = Firmware(
    name="PX4",
    mav_autopilot=MAV_AUTOPILOT_PX4,
    failsafe_texts=(r"^failsafe (?!warning|.*deactivated)", r"^flight terminat"),
    board_params=(
        r"SYS_(AUTOSTART|AUTOCONFIG|HITL|HAS_\w+|FMU_TASK|USB_AUTO|PARAM_VER|SUPPLY_\w+)",
        r"(CAL|TC|SENS|SER|UAVCAN|CANNODE|BAT\d?|EKF2_(MAG|ABIAS|BARO|GBIAS)BIAS)_\w+",
        r"(PWM|HIL_ACT|DSHOT|UAVCAN|RC|RC\d+|MAV|GPS_\d|UXRCE_DDS|NET|LED)_\w+",
        r"(LND_FLIGHT_T|COM_FLIGHT_UUID|COM_RC_IN_MODE|CBRK_\w+|IMU_\w+|SDLOG_\w+)\w*",
    ),
    bytewise_params=True,
    airframe_parameter="SYS_AUTOSTART",
    project=px4_ned,
    resumes_missions=True,
    auto="AUTO.",
    flight_logs={"log/*/*.ulg": "ULog: Flight Review, PlotJuggler, pyulog"},
    modes={
        "MISSION": _mode(4, 4),
        "HOLD": _mode(4, 3),
        "RTL": _mode(4, 5),
        "LAND": _mode(4, 6),
        "TAKEOFF": _mode(4, 2),
        "OFFBOARD": _mode(6),
        "POSITION": _mode(3),
        "ALTITUDE": _mode(2),
        "STABILIZED": _mode(7),
    },
    manual_modes={
        "manual": (1.0, 0.0),
        "altitude": (2.0, 0.0),
        "position": (3.0, 0.0),
        "stabilized": (7.0, 0.0),
        "acro": (5.0, 0.0),
        "hold": (4.0, 3.0),
        "return": (4.0, 5.0),
        "land": (4.0, 6.0),
        "takeoff": (4.0, 2.0),
    },
)
