"""The autopilot's own local frame: where its origin is, where the vehicle is in it, and how to get there from W.

Autopilots put the origin of LOCAL_POSITION_NED where their estimator started, and tell it in GPS_GLOBAL_ORIGIN (to
1e-7 degrees: 6 mm). Where they do not, it follows from LOCAL_POSITION_NED and GLOBAL_POSITION_INT of a vehicle at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.ground_station.modes import ARDUPILOT
from firmware_bridge.ground_station.projections import Place, Projection, ardupilot_ned, origin_of, px4_ned
from hil.signals.samples import Vec3

GeodeticFromW = Callable[[Vec3], tuple[float, float, float]]
"""A point in W [m] to latitude and longitude [deg] and altitude [m]."""


class AutopilotFrame:
    """`project`: the autopilot's map; None: by the kind of autopilot, see `settle`."""

    def __init__(self, geodetic_from_W: GeodeticFromW, project: Projection | None) -> None:
        self._geodetic_from_W = geodetic_from_W
        self._project = project
        self.origin: Place | None = None
        self.p_N: Vec3 | None = None  # of the vehicle, as last told
        self._place: Place | None = None

    def settle(self, autopilot: int) -> None:
        """The autopilot (MAV_AUTOPILOT) is known now, and with it its map."""
        if self._project is None:
            self._project = ardupilot_ned if autopilot == ARDUPILOT else px4_ned

    @property
    def known(self) -> bool:
        """Points can be converted, and the vehicle has told where it is."""
        return self.origin is not None and self.p_N is not None

    def infer_origin(self) -> bool:
        """Without being told: from where the vehicle says that it is, both ways. False if it has not said so."""
        if self._place is None or self.p_N is None or self._project is None:
            return False
        self.origin = origin_of(self._place, self.p_N, self._project)
        return True

    def ned_from_W(self, p_W: Vec3) -> Vec3:
        """A point in W as the autopilot wants it. Only once `known`."""
        assert self.origin is not None
        assert self._project is not None
        return self._project(self.origin, Place(*self._geodetic_from_W(p_W)))

    def on_origin(self, message: Any) -> None:
        self.origin = Place(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    def on_local_position(self, message: Any) -> None:
        self.p_N = (message.x, message.y, message.z)

    def on_global_position(self, message: Any) -> None:
        self._place = Place(message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
