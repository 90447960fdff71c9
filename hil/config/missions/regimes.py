"""Items of a plan that a VTOL flies on its wings: after a VTOL take-off or a transition to the wings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hil.config.missions.mission import RETURN
from hil.config.missions.places import LAND_COMMANDS
from signals.mission import MissionItem

TRANSITION, TO_HOVER, TO_WINGS = 3000, 3.0, 4.0
_TAKEOFF, _VTOL_TAKEOFF = 22, 84
_FORCE = "NAV_FORCE_VT"  # PX4's: 1, its default, makes a NAV_TAKEOFF a NAV_VTOL_TAKEOFF


def leads_to_wings(item: MissionItem, params: Mapping[str, float]) -> bool:
    """Return True if an item ends in flight on the wings. `params`: those of the autopilot that the bench sets."""
    if item.command == _TAKEOFF:
        return params.get(_FORCE, 1) == 1
    return item.command == _VTOL_TAKEOFF or (item.command == TRANSITION and item.param1 == TO_WINGS)


def on_wings(items: Sequence[MissionItem], params: Mapping[str, float]) -> list[bool]:
    """Return for every item whether the vehicle comes to it on its wings; jumps are not followed."""
    out, wings = [], False
    for item in items:
        out.append(wings)
        if leads_to_wings(item, params):
            wings = True
        elif item.command in (_TAKEOFF, TRANSITION, RETURN) or item.command in LAND_COMMANDS:
            wings = False
    return out
