"""Flight modes and their PX4 encoding.

custom_mode = main mode << 16 | sub mode << 24 (PX4 `px4_custom_mode.h`).
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from firmware_bridge.mock_pixhawk.ids import BaseMode

MAIN_AUTO = 4


class ModeTraits(NamedTuple):
    """Name, encoding and requirements of a mode."""

    label: str
    main: int
    sub: int
    needs_position: bool  # needs a valid global position and home
    needs_manual_control: bool
    can_arm: bool
    base_mode: int  # MAV_MODE_FLAG bits besides CUSTOM and ARMED


_MANUAL = BaseMode.MANUAL_INPUT_ENABLED | BaseMode.STABILIZE_ENABLED
_AUTO = BaseMode.AUTO_ENABLED | BaseMode.STABILIZE_ENABLED | BaseMode.GUIDED_ENABLED


class Mode(Enum):
    """Modes of the mock autopilot. `.value` has the traits."""

    MANUAL = ModeTraits("Manual", 1, 0, False, True, True, _MANUAL)
    ALTCTL = ModeTraits("Altitude", 2, 0, False, True, True, _MANUAL)
    POSCTL = ModeTraits("Position", 3, 0, True, True, True, _MANUAL | BaseMode.GUIDED_ENABLED)
    TAKEOFF = ModeTraits("Takeoff", MAIN_AUTO, 2, True, False, True, _AUTO)
    LOITER = ModeTraits("Hold", MAIN_AUTO, 3, True, False, True, _AUTO)
    MISSION = ModeTraits("Mission", MAIN_AUTO, 4, True, False, True, _AUTO)
    RTL = ModeTraits("Return", MAIN_AUTO, 5, True, False, False, _AUTO)
    LAND = ModeTraits("Land", MAIN_AUTO, 6, True, False, False, _AUTO)
    OFFBOARD = ModeTraits("Offboard", 6, 0, False, False, True, _AUTO)
    STABILIZED = ModeTraits("Stabilized", 7, 0, False, True, True, _MANUAL)

    @property
    def label(self) -> str:
        return self.value.label

    @property
    def custom_mode(self) -> int:
        return self.value.main << 16 | self.value.sub << 24


_BY_CUSTOM = {mode.custom_mode: mode for mode in Mode}


def mode_from_px4(main: int, sub: int) -> Mode | None:
    """Return the mode with PX4's numbers (main, sub), or None. Main mode AUTO without sub mode is Hold, as in PX4."""
    if main == MAIN_AUTO and sub == 0:
        return Mode.LOITER
    return _BY_CUSTOM.get(main << 16 | (sub if main == MAIN_AUTO else 0) << 24)


def mode_from_custom_mode(custom_mode: int) -> Mode | None:
    """Return the mode encoded in HEARTBEAT.custom_mode or SET_MODE.custom_mode, or None."""
    return mode_from_px4(custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)
