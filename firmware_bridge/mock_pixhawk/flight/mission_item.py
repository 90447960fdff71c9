"""Check of mission items: commands, frames and values that the mock accepts."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from firmware_bridge.mock_pixhawk.ids import Cmd, MissionResult
from signals.mission import MissionItem

FRAME_GLOBAL, FRAME_MISSION, FRAME_GLOBAL_RELATIVE_ALT, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE_ALT_INT = 0, 2, 3, 5, 6
GLOBAL_FRAMES = frozenset({FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE_ALT, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE_ALT_INT})
RELATIVE_FRAMES = frozenset({FRAME_GLOBAL_RELATIVE_ALT, FRAME_GLOBAL_RELATIVE_ALT_INT})

MAX_ALTITUDE_M = 10_000.0  # higher altitudes for a multicopter are a wrong unit
MIN_ALTITUDE_M = -500.0  # relative or below the Dead Sea
UNKNOWN_POSITION = 2**31 - 1  # INT32_MAX in MISSION_ITEM_INT: the current position

#: Items with a position. In the first group it is optional.
VTOL_ONLY = frozenset({Cmd.NAV_VTOL_TAKEOFF, Cmd.NAV_VTOL_LAND})
POSITION_OPTIONAL = VTOL_ONLY | {Cmd.NAV_TAKEOFF, Cmd.NAV_LAND, Cmd.NAV_LOITER_UNLIM, Cmd.NAV_LOITER_TIME}
NAVIGATION = (POSITION_OPTIONAL - VTOL_ONLY) | {Cmd.NAV_WAYPOINT}
PLANE_NAVIGATION = NAVIGATION | {Cmd.NAV_LOITER_TURNS, Cmd.NAV_LOITER_TO_ALT}  # those of a plane
VTOL_NAVIGATION = PLANE_NAVIGATION | VTOL_ONLY

#: Items for payloads: accepted and reported as reached, without effect.
PAYLOAD = frozenset(
    {
        Cmd.NAV_ROI,
        Cmd.DO_SET_ROI,
        Cmd.DO_SET_ROI_LOCATION,
        Cmd.DO_SET_ROI_NONE,
        Cmd.DO_DIGICAM_CONTROL,
        Cmd.DO_MOUNT_CONTROL,
        Cmd.DO_SET_CAM_TRIGG_DIST,
        Cmd.DO_SET_CAM_TRIGG_INTERVAL,
        Cmd.SET_CAMERA_MODE,
        Cmd.DO_GIMBAL_MANAGER_PITCHYAW,
        Cmd.IMAGE_START_CAPTURE,
        Cmd.IMAGE_STOP_CAPTURE,
        Cmd.VIDEO_START_CAPTURE,
        Cmd.VIDEO_STOP_CAPTURE,
    }
)
SUPPORTED = (
    NAVIGATION
    | PAYLOAD
    | {
        Cmd.NAV_RETURN_TO_LAUNCH,
        Cmd.NAV_DELAY,
        Cmd.CONDITION_DELAY,
        Cmd.CONDITION_YAW,
        Cmd.DO_JUMP,
        Cmd.DO_CHANGE_SPEED,
        Cmd.DO_SET_HOME,
    }
)
PLANE_SUPPORTED = SUPPORTED | PLANE_NAVIGATION | {Cmd.DO_LAND_START}
VTOL_SUPPORTED = PLANE_SUPPORTED | VTOL_ONLY | {Cmd.DO_VTOL_TRANSITION}


class Repertoire(NamedTuple):
    """Commands of mission items that a kind of vehicle takes, and those of them that are flown."""

    supported: frozenset[int]
    navigation: frozenset[int]


REPERTOIRES = {
    0: Repertoire(SUPPORTED, NAVIGATION),
    1: Repertoire(PLANE_SUPPORTED, PLANE_NAVIGATION),
    2: Repertoire(VTOL_SUPPORTED, VTOL_NAVIGATION),
}  # by CA_AIRFRAME

_OK = (MissionResult.ACCEPTED, "")


def has_no_position(item: MissionItem) -> bool:
    """Return True if latitude and longitude are not given (INT32_MAX, or 0, 0 as QGroundControl writes it)."""
    return (
        item.lat_degE7 == UNKNOWN_POSITION
        or item.lon_degE7 == UNKNOWN_POSITION
        or (item.lat_degE7 == 0 and item.lon_degE7 == 0)
    )


def value_or(value: float, default: float) -> float:
    """Return a parameter of an item, or `default` if it is not given (NaN)."""
    return default if value != value else value


def _bad_params(item: MissionItem, count: int) -> tuple[int, str]:
    params = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(params):
        if value in (float("inf"), float("-inf")):
            return MissionResult.INVALID_PARAM1 + number, f"param{number + 1} is infinite"
    if item.command == Cmd.DO_JUMP and not 0 <= item.param1 < count:
        return MissionResult.INVALID_PARAM1, f"jump to item {item.param1:g} of {count}"
    if item.command in (Cmd.NAV_WAYPOINT, Cmd.NAV_LOITER_TIME, Cmd.CONDITION_DELAY) and item.param1 < 0.0:
        return MissionResult.INVALID_PARAM1, f"negative time {item.param1:g} s"
    if item.command == Cmd.NAV_DELAY and not item.param1 >= 0.0:
        return MissionResult.INVALID_PARAM1, "delays until a time of day are not supported"
    if item.command == Cmd.DO_VTOL_TRANSITION and item.param1 not in (3.0, 4.0):
        return MissionResult.INVALID_PARAM1, f"transition to state {item.param1:g}, which is neither 3 nor 4"
    if item.command == Cmd.DO_CHANGE_SPEED and item.param2 != item.param2:
        return MissionResult.INVALID_PARAM2, "no speed"
    return _OK


def _bad_position(item: MissionItem) -> tuple[int, str]:
    if item.frame not in GLOBAL_FRAMES:
        return MissionResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported"
    if has_no_position(item):
        if item.command not in POSITION_OPTIONAL:
            return MissionResult.INVALID_PARAM5_X, "no latitude and longitude"
    elif not -900_000_000 <= item.lat_degE7 <= 900_000_000:
        return MissionResult.INVALID_PARAM5_X, f"latitude {item.lat_degE7 / 1e7:g}"
    elif not -1_800_000_000 <= item.lon_degE7 <= 1_800_000_000:
        return MissionResult.INVALID_PARAM6_Y, f"longitude {item.lon_degE7 / 1e7:g}"
    if not isfinite(item.alt_m) or not MIN_ALTITUDE_M <= item.alt_m <= MAX_ALTITUDE_M:
        return MissionResult.INVALID_PARAM7, f"altitude {item.alt_m:g} m"
    return _OK


def refusal(item: MissionItem, count: int, repertoire: Repertoire = REPERTOIRES[0]) -> tuple[int, str]:
    """Return (ACCEPTED, "") if the mock can fly `item` in a mission of `count` items, else result and reason."""
    if item.command not in repertoire.supported:
        return MissionResult.UNSUPPORTED, f"command {item.command} is not supported"
    result = _bad_params(item, count)
    if result is not _OK:
        return result
    if item.command in repertoire.navigation:
        return _bad_position(item)
    if item.frame not in GLOBAL_FRAMES and item.frame != FRAME_MISSION:
        return MissionResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported"
    return _OK
