"""MAVLink numbers that the mock autopilot uses (https://mavlink.io/en/messages/common.html), by pymavlink's names."""

from __future__ import annotations

from firmware_bridge.codecs.dialect import dialect


class Numbers:
    """Entries of one enum as plain integers, by name without the prefix: `Cmd.NAV_LAND` is MAV_CMD_NAV_LAND."""

    def __init__(self, enum: str, prefix: str) -> None:
        self.__dict__.update({entry.name.removeprefix(prefix): value for value, entry in dialect.enums[enum].items()})

    def __getattr__(self, name: str) -> int:
        raise AttributeError(f"pymavlink has no entry {name} in this enum")


Cmd = Numbers("MAV_CMD", "MAV_CMD_")
Result = Numbers("MAV_RESULT", "MAV_RESULT_")
MissionResult = Numbers("MAV_MISSION_RESULT", "MAV_MISSION_")
MissionState = Numbers("MISSION_STATE", "MISSION_STATE_")  # of MISSION_CURRENT
Severity = Numbers("MAV_SEVERITY", "MAV_SEVERITY_")
BaseMode = Numbers("MAV_MODE_FLAG", "MAV_MODE_FLAG_")
SystemState = Numbers("MAV_STATE", "MAV_STATE_")
LandedState = Numbers("MAV_LANDED_STATE", "MAV_LANDED_STATE_")
Sensor = Numbers("MAV_SYS_STATUS_SENSOR", "MAV_SYS_STATUS_")
Capability = Numbers("MAV_PROTOCOL_CAPABILITY", "MAV_PROTOCOL_CAPABILITY_")

AUTOPILOT_PX4 = 12
COMPONENT_AUTOPILOT = 1
MISSION_TYPE_MISSION, MISSION_TYPE_FENCE, MISSION_TYPE_RALLY, MISSION_TYPE_ALL = 0, 1, 2, 255
