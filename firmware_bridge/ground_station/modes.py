"""Flight modes as words with the same meaning on every autopilot, and each autopilot's numbers for them.

    word        PX4                ArduPilot (Copter)   meaning
    MISSION     AUTO.MISSION       AUTO                 flies the uploaded mission
    HOLD        AUTO.LOITER        BRAKE                stops and holds the position
    RTL         AUTO.RTL           RTL                  returns home and lands
    LAND        AUTO.LAND          LAND                 lands where it is
    TAKEOFF     AUTO.TAKEOFF       -                    climbs to the take-off height (ArduPilot: NAV_TAKEOFF)
    OFFBOARD    OFFBOARD           GUIDED               flies a companion's set-points; GUIDED is the same word
    POSITION    POSCTL             POSHOLD              manual, position held
    ALTITUDE    ALTCTL             ALT_HOLD             manual, height held
    STABILIZED  STABILIZED         STABILIZE            manual, attitude held

HOLD is not ArduPilot's LOITER, which follows the throttle stick: without stick input it descends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from firmware_bridge.ground_station.vehicle_link import enum_name, refused

ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT, as in HEARTBEAT.autopilot

_CUSTOM_MODE_ENABLED = 1.0  # MAV_MODE_FLAG: the mode is the autopilot's own number
_SYNONYMS = {"GUIDED": "OFFBOARD", "AUTO": "MISSION"}


class ModeNumber(NamedTuple):
    """A mode in DO_SET_MODE, as param 2 and param 3, and in HEARTBEAT.custom_mode."""

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
"""Every word for a mode that a script may use."""


def plain_word(word: str) -> str:
    """Return the main word for a synonym: MISSION for AUTO, OFFBOARD for GUIDED."""
    return _SYNONYMS.get(word, word)


def mode_words(autopilot: int) -> tuple[str, ...]:
    """Return the words for the modes of `autopilot` (MAV_AUTOPILOT)."""
    return tuple(MODE_TABLE.get(autopilot, ()))


def has_mode(autopilot: int, word: str) -> bool:
    """Return True if `autopilot` (MAV_AUTOPILOT) has a mode for this word."""
    return plain_word(word) in mode_words(autopilot)


def mode_number(autopilot: int, word: str) -> ModeNumber:
    """Return the numbers of mode `word` on `autopilot` (MAV_AUTOPILOT). HandshakeError if it has no such mode."""
    modes = MODE_TABLE.get(autopilot)
    if modes is None:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"mode {word}: the modes of {name} are not known; use PX4 or ArduPilot")
    number = modes.get(plain_word(word))
    if number is None:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"{name} has no mode {word}; choose from: {', '.join(modes)}")
    return number


def mode_params(autopilot: int, word: str) -> tuple[float, float, float]:
    """Return params 1 to 3 of MAV_CMD_DO_SET_MODE. HandshakeError if the autopilot has no such mode."""
    number = mode_number(autopilot, word)
    return (_CUSTOM_MODE_ENABLED, float(number.main), float(number.sub))


def mode_word(autopilot: int, custom_mode: int) -> str:
    """Return the word for HEARTBEAT.custom_mode, or its number if there is none."""
    for word, number in MODE_TABLE.get(autopilot, {}).items():
        if number.custom_mode == custom_mode:
            return word
    return f"custom mode {custom_mode:#x}"
