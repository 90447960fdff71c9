"""Compares the home of an ArduPilot SITL that the user started with the place where the bench's vehicle starts.

SITL adds the bench's positions to the place of its own `--home`, so a wrong one moves the whole flight: the mission's
waypoints are then as far away as the two places are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, unpack
from signals.units import RAD_PER_DEG

Home = tuple[float, float, float, float]
"""Latitude and longitude [deg], altitude [m MSL], heading [deg from north]."""

APART_M = 10.0  # more than the noise of SITL's GPS and the rounding of a home typed by hand
_M_PER_DEG = 111_320.0
_PLACES = frozenset({MSGID["HOME_POSITION"], MSGID["GPS_GLOBAL_ORIGIN"]})  # sent unasked once home is set


def home_text(home: Home) -> str:
    """Format a place for `--home`."""
    latitude, longitude, altitude, heading = home
    return f"{latitude:.9f},{longitude:.9f},{altitude:.4f},{heading:.4f}"


class HomeCheck:
    """Waits for the first message with SITL's home. `problem` describes a home that is not `expected`."""

    def __init__(self, expected: Home) -> None:
        self._expected = expected
        self.done = False

    def problem(self, frames: Iterable[Frame]) -> str | None:
        """Return what is wrong with the home in `frames` and what to do; None if it is right, or not among them."""
        for frame in frames:
            if frame.msgid in _PLACES:
                self.done = True
                message = unpack(frame)
                place = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
                return self._compare(place)
        return None

    def _compare(self, place: tuple[float, float, float]) -> str | None:
        latitude, longitude, altitude, _ = self._expected
        north_m = (place[0] - latitude) * _M_PER_DEG
        east_deg = (place[1] - longitude + 180.0) % 360.0 - 180.0
        apart_m = math.hypot(north_m, east_deg * _M_PER_DEG * math.cos(latitude * RAD_PER_DEG))
        up_m = place[2] - altitude
        if apart_m <= APART_M and abs(up_m) <= APART_M:
            return None
        apart = f"{apart_m:.0f} m" if apart_m < 10_000.0 else f"{apart_m / 1000.0:.0f} km"
        return (
            f"ArduPilot's home is {place[0]:.6f}, {place[1]:.6f}, {place[2]:.1f} m, and the vehicle of this bench "
            f"stands at {latitude:.6f}, {longitude:.6f}, {altitude:.1f} m: {apart} away and {up_m:+.1f} m in height. "
            f"Start SITL again with --home {home_text(self._expected)} (`hil run ... --print-command` prints the "
            "whole command)"
        )
