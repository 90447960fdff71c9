"""How a mission is given to an autopilot and started: the steps differ between firmwares, the mission does not.

            PX4                            ArduPilot
items       as they are                    behind a place-holder for home, which is its item 0; no open (NaN) params
start       mode AUTO.MISSION, arm         mode GUIDED, arm, MISSION_START (it does not arm in AUTO)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from firmware_bridge.ground_station.modes import ARDUPILOT, mode_params
from hil.signals.mission import MissionItem

_DO_SET_MODE = 176
_DO_JUMP = 177
_COMPONENT_ARM_DISARM = 400
_MISSION_START = 300
_WAYPOINT = 16
_FRAME_GLOBAL = 0


class Step(NamedTuple):
    """One command on the way into the air, and what it does in words. `arms`: done when the heartbeat says armed."""

    what: str
    command: int
    params: tuple[float, ...]
    arms: bool = False


def start_steps(autopilot: int) -> tuple[Step, ...]:
    """What to ask `autopilot` (MAV_AUTOPILOT) for, in order, to fly the mission that it holds."""
    arm = Step("arm", _COMPONENT_ARM_DISARM, (1.0,), arms=True)
    if autopilot == ARDUPILOT:
        return (
            Step("enter mode GUIDED", _DO_SET_MODE, mode_params(autopilot, "GUIDED")),
            arm,
            Step("start the mission", _MISSION_START, (0.0, 0.0)),
        )
    return (Step("enter mode AUTO.MISSION", _DO_SET_MODE, mode_params(autopilot, "MISSION")), arm)


def first_seq(autopilot: int) -> int:
    """The number that the autopilot gives to the mission's first item."""
    return 1 if autopilot == ARDUPILOT else 0


def items_for(autopilot: int, items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """`items` as `autopilot` wants them uploaded."""
    if autopilot != ARDUPILOT:
        return tuple(items)
    shift = first_seq(autopilot)
    home = MissionItem(0, _FRAME_GLOBAL, _WAYPOINT, 0, 1, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    return (home, *(_ardupilot_item(item, shift) for item in items))


def _ardupilot_item(item: MissionItem, shift: int) -> MissionItem:
    params = [0.0 if math.isnan(p) else p for p in item[5:9]]
    if item.command == _DO_JUMP:
        params[0] += shift
    return item._replace(seq=item.seq + shift, param1=params[0], param2=params[1], param3=params[2], param4=params[3])
