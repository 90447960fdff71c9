"""Facts about a firmware that its messages do not tell by themselves."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from firmware_bridge.ground_station.projections import Projection


class ModeNumber(NamedTuple):
    """A mode in DO_SET_MODE, as param 2 and param 3, and in HEARTBEAT.custom_mode."""

    main: int
    sub: int
    custom_mode: int


@dataclass(frozen=True)
class Firmware:
    """Facts about one firmware, whatever it runs on. Without `project` it flies no set-points of a companion."""

    name: str  # for messages to the user
    mav_autopilot: int = 0  # HEARTBEAT.autopilot (MAV_AUTOPILOT)
    program: str = ""  # of this kind of vehicle, where the firmware has several
    failsafe_texts: Sequence[str] = ()  # regular expressions; a STATUSTEXT that one matches, in flight, is a failsafe
    # Names (regular expressions) that belong to one board, not to how it flies: calibration, outputs, ports, identity.
    board_params: Sequence[str] = ()
    bytewise_params: bool = False  # PARAM_VALUE carries an integer's bits, not its value as a float
    airframe_parameter: str = ""  # holds the number of the airframe; empty: the firmware has no such numbers
    project: Projection | None = None  # its map projection
    # Missions: number of the plan's first item on the autopilot; 1: item 0 is home, and parameters may not be NaN.
    first_mission_item: int = 0
    resumes_missions: bool = False  # goes on with a mission that it already holds where an earlier flight ended
    # It arms in GUIDED, then starts the mission or takes off by command; else in the mode that flies, which for
    # set-points needs them to arrive before.
    arms_in_guided: bool = False
    fails_until_ready: bool = False  # refuses commands and missions as FAILED while it is not yet ready
    plain_masks: bool = False  # set-points only with type masks that ignore whole groups
    auto: str = ""  # before the names of modes in which it flies by itself
    modes: Mapping[str, ModeNumber] = field(default_factory=dict)  # by the words of `ground_station.modes`
    other_modes: Mapping[int, str] = field(default_factory=dict)  # by HEARTBEAT.custom_mode, for messages to the user
    # Logs that it writes as a program, as a pattern in its working folder: what they are.
    flight_logs: Mapping[str, str] = field(default_factory=dict)
    # Modes for a person at the sticks, by name: parameters 2 and 3 of DO_SET_MODE.
    manual_modes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # Other facts for vehicles of these types (HEARTBEAT.type, MAV_TYPE): ArduPilot is a program for each.
    by_type: Mapping[int, Firmware] = field(default_factory=dict)

    def of_type(self, vehicle_type: int) -> Firmware:
        """Return the facts about this firmware on vehicles of a MAV_TYPE."""
        return self.by_type.get(vehicle_type, self)

    def is_of_board(self, parameter: str) -> bool:
        """Return True if a parameter of this name belongs to one board, and says nothing about how it flies."""
        return any(re.fullmatch(pattern, parameter) for pattern in self.board_params)

    def is_failsafe(self, text: str) -> bool:
        """Return True if a STATUSTEXT of an armed vehicle says that a failsafe has acted."""
        return any(re.search(pattern, text, re.IGNORECASE) for pattern in self.failsafe_texts)
