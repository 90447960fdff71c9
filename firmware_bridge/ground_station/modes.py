"""Flight modes as words that mean the same on every autopilot, and the numbers that each one wants for them.

    word        PX4                ArduPilot (Copter)   what it is
    MISSION     AUTO.MISSION       AUTO                 flies the uploaded mission
    HOLD        AUTO.LOITER        BRAKE                stops and stays, without a pilot
    RTL         AUTO.RTL           RTL                  returns home and lands
    LAND        AUTO.LAND          LAND                 lands where it is
    TAKEOFF     AUTO.TAKEOFF       -                    climbs to the take-off height (ArduPilot: NAV_TAKEOFF)
    OFFBOARD    OFFBOARD           GUIDED               flies what a companion commands; GUIDED is the same word
    POSITION    POSCTL             POSHOLD              by hand, position held
    ALTITUDE    ALTCTL             ALT_HOLD             by hand, height held
    STABILIZED  STABILIZED         STABILIZE            by hand, attitude held

HOLD is not ArduPilot's LOITER, which follows the throttle stick: with nobody at the sticks it descends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from firmware_bridge.ground_station.wire import enum_name, refused

ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT, as in HEARTBEAT.autopilot

_CUSTOM_MODE_ENABLED = 1.0  # MAV_MODE_FLAG: the mode is the autopilot's own number
_SYNONYMS = {"GUIDED": "OFFBOARD", "AUTO": "MISSION"}


class ModeNumber(NamedTuple):
    """A mode as DO_SET_MODE carries it: param 2 and param 3, and as HEARTBEAT.custom_mode shows it."""

    main: int
    sub: int
    custom_mode: int


def _px4(main: int, sub: int = 0) -> ModeNumber:
    return ModeNumber(main, sub, main << 16 | sub << 24)  # px4_custom_mode.h


def _ardupilot(number: int) -> ModeNumber:
    return ModeNumber(number, 0, number)


MODE_TABLE: Mapping[int, Mapping[str, ModeNumber]] = {
    PX4: {
        "MISSION": _px4(4, 4),
        "HOLD": _px4(4, 3),
        "RTL": _px4(4, 5),
        "LAND": _px4(4, 6),
        "TAKEOFF": _px4(4, 2),
        "OFFBOARD": _px4(6),
        "POSITION": _px4(3),
        "ALTITUDE": _px4(2),
        "STABILIZED": _px4(7),
    },
    ARDUPILOT: {
        "MISSION": _ardupilot(3),
        "HOLD": _ardupilot(17),
        "RTL": _ardupilot(6),
        "LAND": _ardupilot(9),
        "OFFBOARD": _ardupilot(4),
        "POSITION": _ardupilot(16),
        "ALTITUDE": _ardupilot(2),
        "STABILIZED": _ardupilot(0),
    },
}

WORDS: tuple[str, ...] = (*MODE_TABLE[PX4], *_SYNONYMS)
"""Every word that a script or a ground station may say."""


def plain_word(word: str) -> str:
    """The one word of those that mean the same: AUTO is MISSION, GUIDED is OFFBOARD."""
    return _SYNONYMS.get(word, word)


def mode_number(autopilot: int, word: str) -> ModeNumber:
    """The mode that `autopilot` (MAV_AUTOPILOT) calls `word`. HandshakeError where it has none."""
    modes = MODE_TABLE.get(autopilot)
    if modes is None:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"mode {word} was wanted of {name}, whose modes are not known; known: PX4 and ArduPilot")
    number = modes.get(plain_word(word))
    if number is None:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"{name} has no mode {word}; it has: {', '.join(modes)}")
    return number


def mode_params(autopilot: int, word: str) -> tuple[float, float, float]:
    """Params 1 to 3 of MAV_CMD_DO_SET_MODE. HandshakeError where the autopilot has no such mode."""
    number = mode_number(autopilot, word)
    return (_CUSTOM_MODE_ENABLED, float(number.main), float(number.sub))


def mode_word(autopilot: int, custom_mode: int) -> str:
    """The word for HEARTBEAT.custom_mode; the number in words where there is none."""
    for word, number in MODE_TABLE.get(autopilot, {}).items():
        if number.custom_mode == custom_mode:
            return word
    return f"custom mode {custom_mode:#x}"
