"""Flight modes as words with the same meaning on every autopilot; their numbers are in `Firmware.modes`.

    word        PX4                ArduCopter   ArduPlane   meaning
    MISSION     AUTO.MISSION       AUTO         AUTO        flies the uploaded mission
    HOLD        AUTO.LOITER        BRAKE        LOITER      stops and holds the position; a plane circles
    RTL         AUTO.RTL           RTL          RTL         returns home and lands; ArduPlane circles there
    LAND        AUTO.LAND          LAND         AUTOLAND    lands where it is; ArduPlane where it took off
    TAKEOFF     AUTO.TAKEOFF       -            TAKEOFF     climbs to the take-off height (ArduCopter: NAV_TAKEOFF)
    OFFBOARD    OFFBOARD           GUIDED       GUIDED      flies a companion's set-points; GUIDED is the same word
    POSITION    POSCTL             POSHOLD      CRUISE      manual, position held; a plane's course
    ALTITUDE    ALTCTL             ALT_HOLD     FBWB        manual, height held
    STABILIZED  STABILIZED         STABILIZE    FBWA        manual, attitude held

HOLD is not ArduCopter's LOITER, which follows the throttle stick: without stick input it descends. HEARTBEAT.type
(MAV_TYPE) tells which of the two programs it is.
"""

from __future__ import annotations

from functools import cache

from firmware_bridge.autopilots.firmware import Firmware, ModeNumber
from firmware_bridge.ground_station.vehicle_link import enum_name, refused

ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT, as in HEARTBEAT.autopilot
_CUSTOM_MODE_ENABLED = 1.0  # MAV_MODE_FLAG: the mode is the autopilot's own number
_SYNONYMS = {"GUIDED": "OFFBOARD", "AUTO": "MISSION"}


_MAIN_WORDS = ("MISSION", "HOLD", "RTL", "LAND", "TAKEOFF", "OFFBOARD", "POSITION", "ALTITUDE", "STABILIZED")
WORDS: tuple[str, ...] = (*_MAIN_WORDS, *_SYNONYMS)
"""Every word for a mode that a script may use."""


def plain_word(word: str) -> str:
    """Return the main word for a synonym: MISSION for AUTO, OFFBOARD for GUIDED."""
    return _SYNONYMS.get(word, word)


@cache
def firmware_of(autopilot: int, vehicle_type: int = 0) -> Firmware:
    """Return the facts about the firmware with this MAV_AUTOPILOT on a vehicle of a MAV_TYPE.

    Those of an unknown one are empty.
    """
    from firmware_bridge.autopilots.catalog import PROFILES  # whose links and firmwares import this package

    known = {profile.firmware.mav_autopilot: profile.firmware for profile in PROFILES.values() if profile.mavlink}
    if autopilot in known:
        return known[autopilot].of_type(vehicle_type)
    return Firmware(name=enum_name("MAV_AUTOPILOT", autopilot), mav_autopilot=autopilot)  # loads the dialect: 0.2 s


def mode_number(autopilot: int, word: str, vehicle_type: int = 0) -> ModeNumber:
    """Return the numbers of mode `word` on `autopilot` (MAV_AUTOPILOT). HandshakeError if it has no such mode."""
    modes = firmware_of(autopilot, vehicle_type).modes
    if not modes:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"mode {word}: the modes of {name} are not known; use PX4 or ArduPilot")
    number = modes.get(plain_word(word))
    if number is None:
        name = enum_name("MAV_AUTOPILOT", autopilot)
        raise refused(f"{name} has no mode {word}; choose from: {', '.join(modes)}")
    return number


def mode_params(autopilot: int, word: str, vehicle_type: int = 0) -> tuple[float, float, float]:
    """Return params 1 to 3 of MAV_CMD_DO_SET_MODE. HandshakeError if the autopilot has no such mode."""
    number = mode_number(autopilot, word, vehicle_type)
    return (_CUSTOM_MODE_ENABLED, float(number.main), float(number.sub))


def mode_word(autopilot: int, custom_mode: int, vehicle_type: int = 0) -> str:
    """Return the word for HEARTBEAT.custom_mode, else the firmware's own name for it, or its number."""
    firmware = firmware_of(autopilot, vehicle_type)
    for word, number in firmware.modes.items():
        if number.custom_mode == custom_mode:
            return word
    return firmware.other_modes.get(custom_mode, f"custom mode {custom_mode:#x}")
