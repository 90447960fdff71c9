"""Items of a MAVLink mission, with integer coordinates."""

from __future__ import annotations

from typing import NamedTuple


class MissionItem(NamedTuple):
    """One item of a mission, in the units of MISSION_ITEM_INT.

    `command` and `frame` are MAV_CMD and MAV_FRAME numbers. `lat_degE7`, `lon_degE7` are degrees times 1e7.
    Parameters that are null in the file are NaN, as in QGroundControl.
    """

    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_degE7: int
    lon_degE7: int
    alt_m: float
