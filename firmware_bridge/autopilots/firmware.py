"""Facts about a firmware that its messages do not tell by themselves."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from firmware_bridge.ground_station.projections import Projection


@dataclass(frozen=True)
class Firmware:
    """Facts about one firmware, whatever it runs on. Without `project` it flies no set-points of a companion."""

    name: str  # for messages to the user
    mav_autopilot: int = 0  # HEARTBEAT.autopilot (MAV_AUTOPILOT)
    failsafe_texts: Sequence[str] = ()  # regular expressions; a STATUSTEXT that one matches, in flight, is a failsafe
    bytewise_params: bool = False  # PARAM_VALUE carries an integer's bits, not its value as a float
    airframe_parameter: str = ""  # holds the number of the airframe; empty: the firmware has no such numbers
    first_mission_item: int = 0  # number of the plan's first item in a mission on the autopilot
    project: Projection | None = None  # its map projection
    # Modes for a person at the sticks, by name: parameters 2 and 3 of DO_SET_MODE.
    manual_modes: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def is_failsafe(self, text: str) -> bool:
        """Return True if a STATUSTEXT of an armed vehicle says that a failsafe has acted."""
        return any(re.search(pattern, text, re.IGNORECASE) for pattern in self.failsafe_texts)
