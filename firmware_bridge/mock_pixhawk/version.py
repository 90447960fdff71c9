"""AUTOPILOT_VERSION: what the mock says it is and can do."""

from __future__ import annotations

from enum import IntFlag
from typing import Any

from firmware_bridge.codecs.messages import message_class

_Version = message_class("AUTOPILOT_VERSION")

_RELEASE = 255  # FIRMWARE_VERSION_TYPE_OFFICIAL
_SOFTWARE = 1 << 24 | 15 << 16 | 0 << 8 | _RELEASE  # behaves as PX4 1.15.0
_VENDOR, _PRODUCT = 0x26AC, 0x0011  # 3D Robotics, Pixhawk: what QGroundControl shows as PX4 FMU


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY, those the mock has. No FTP: clients then do not ask for files."""

    PARAM_FLOAT = 2
    MISSION_INT = 4
    COMMAND_INT = 8
    PARAM_ENCODE_BYTEWISE = 16
    SET_ATTITUDE_TARGET = 64
    SET_POSITION_TARGET_LOCAL_NED = 128
    SET_POSITION_TARGET_GLOBAL_INT = 256
    FLIGHT_TERMINATION = 2048
    MAVLINK2 = 8192


def autopilot_version(sysid: int) -> Any:
    """The message. The unique id is the system id: the mock has no serial number."""
    capabilities = 0
    for capability in Capability:
        capabilities |= int(capability)
    return _Version(
        capabilities=capabilities,
        uid=sysid,
        flight_sw_version=_SOFTWARE,
        middleware_sw_version=_SOFTWARE,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=(0,) * 8,
        middleware_custom_version=(0,) * 8,
        os_custom_version=(0,) * 8,
        vendor_id=_VENDOR,
        product_id=_PRODUCT,
    )
