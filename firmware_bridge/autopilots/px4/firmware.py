"""Facts about PX4.

Since 1.14 `FailsafeBase::notifyUser` (src/modules/commander/failsafe/framework.cpp) sends "Failsafe activated" for
every action but a warning, as STATUSTEXT and as an EVENT with the cause. Meanwhile HEARTBEAT has MAV_STATE_CRITICAL.
EVENTs are not read: their texts lie in a file of each build.
"""

from __future__ import annotations

from firmware_bridge.autopilots.firmware import Firmware

PX4 = Firmware(
    name="PX4",
    failsafe_texts=(r"^failsafe (?!warning|.*deactivated)", r"^flight terminat"),
    mav_autopilot=12,
    bytewise_params=True,
    airframe_parameter="SYS_AUTOSTART",
)
