"""Mission upload and start, whose steps differ between firmwares.

            PX4                            ArduPilot
items       unchanged                      after a place-holder for home, which is its item 0; NaN params become 0
start       mode AUTO.MISSION, arm         Copter: mode GUIDED, arm, MISSION_START (it does not arm in AUTO)
                                           Plane: mode AUTO, arm
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from firmware_bridge.ground_station.commands import FAILED, TEMPORARILY_REJECTED
from firmware_bridge.ground_station.modes import firmware_of, mode_params
from signals.mission import MissionItem

_DO_SET_MODE = 176
_DO_JUMP = 177
_COMPONENT_ARM_DISARM = 400
_MISSION_START = 300
_WAYPOINT = 16
_FRAME_GLOBAL, _FRAME_MISSION = 0, 2
# Commands without a place, whose frame has no meaning: planners write 0, 2 or 3, but PX4 accepts only 2.
# RTL; CONDITION_DELAY, _DISTANCE, _YAW; DO_JUMP, CHANGE_SPEED, relay, servo, actuator, mount, gripper, camera.
_PLACELESS = frozenset(
    (20, 93, 112, 114, 115, 177, 178, 181, 183, 187, 197, 205, 206, 211, 212, 214, 530, 2000, 2001, 2500, 2501, 3000)
)


class Step(NamedTuple):
    """One command of the start, with its description. `arms`: it is done when the heartbeat shows armed."""

    description: str
    command: int
    params: tuple[float, ...]
    arms: bool = False


def start_steps(autopilot: int, vehicle_type: int = 0) -> tuple[Step, ...]:
    """Return the steps, in order, with which `autopilot` (MAV_AUTOPILOT) flies the mission that it has stored.

    `vehicle_type`: MAV_TYPE.
    """
    arm = Step("arm", _COMPONENT_ARM_DISARM, (1.0,), arms=True)
    firmware = firmware_of(autopilot, vehicle_type)
    if firmware.arms_in_guided:
        return (
            Step("enter mode GUIDED", _DO_SET_MODE, mode_params(autopilot, "GUIDED")),
            arm,
            Step("start the mission", _MISSION_START, (0.0, 0.0)),
        )
    mission = mode_params(autopilot, "MISSION", vehicle_type)
    return (Step(f"enter mode {firmware.auto}MISSION", _DO_SET_MODE, mission), arm)


def declined_for_now(autopilot: int) -> tuple[int, ...]:
    """Return results that may change within seconds."""
    return (TEMPORARILY_REJECTED, FAILED) if firmware_of(autopilot).fails_until_ready else (TEMPORARILY_REJECTED,)


def items_for(autopilot: int, items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Return `items` in the form that `autopilot` accepts."""
    shift = firmware_of(autopilot).first_mission_item
    if not shift:
        return tuple(in_mission_frame(item) for item in items)
    home = MissionItem(0, _FRAME_GLOBAL, _WAYPOINT, 0, 1, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    return (home, *(_after_home(item, shift) for item in items))


def in_mission_frame(item: MissionItem) -> MissionItem:
    """Return an item without a place in the mission frame, where params 5 and 6 are plain numbers, not degrees."""
    if item.command not in _PLACELESS or item.frame == _FRAME_MISSION:
        return item
    x, y = round(item.lat_degE7 / 1e7), round(item.lon_degE7 / 1e7)
    return item._replace(frame=_FRAME_MISSION, lat_degE7=x, lon_degE7=y)


def _after_home(item: MissionItem, shift: int) -> MissionItem:
    params = [0.0 if math.isnan(p) else p for p in item[5:9]]
    if item.command == _DO_JUMP:
        params[0] += shift
    return item._replace(seq=item.seq + shift, param1=params[0], param2=params[1], param3=params[2], param4=params[3])
