"""How autopilots turn a place on Earth into metres about their local origin. Each has a map of its own.

The same place 1 km away differs by up to 3 m between them, so that a point given in metres must be computed with the
map of the autopilot that it is given to. All three take down as the difference of altitudes.

    PX4        azimuthal equidistant on a sphere of 6371 km (Snyder, Map Projections, USGS 1987, eq. 22-4, 22-5)
    ArduPilot  equirectangular at the mean latitude, on a sphere of 6378.1 km
    tangent    north and east of the exact difference on WGS-84: what the mock does (`hil.signals._kernel.tangent_ned`)

Own elementary functions: the same bits on every machine.

Autopilots put the origin of LOCAL_POSITION_NED where their estimator started, and tell it in GPS_GLOBAL_ORIGIN (to
1e-7 degrees: 6 mm). Where they do not, it follows from LOCAL_POSITION_NED and GLOBAL_POSITION_INT of a vehicle at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, NamedTuple

from firmware_bridge.ground_station.modes import ARDUPILOT
from hil.signals._kernel import det_atan2, det_cos, det_sin
from hil.signals.samples import Vec3
from hil.signals.units import RAD_PER_DEG

_PX4_RADIUS_M = 6371000.0
_ARDUPILOT_M_PER_DEG = 0.011131884502145034 * 1e7


class Place(NamedTuple):
    """A point on Earth."""

    lat_deg: float
    lon_deg: float
    alt_m: float


GeodeticFromW = Callable[[Vec3], tuple[float, float, float]]
"""A point in W [m] to latitude and longitude [deg] and altitude [m]."""

Projection = Callable[[Place, Place], Vec3]
"""(origin, place) to the place's NED about the origin [m]."""


def px4_ned(origin: Place, place: Place) -> Vec3:
    """As PX4's estimator and position controller have it."""
    lat0, lat = origin.lat_deg * RAD_PER_DEG, place.lat_deg * RAD_PER_DEG
    sin0, cos0, sin_lat, cos_lat = det_sin(lat0), det_cos(lat0), det_sin(lat), det_cos(lat)
    dlon = _turn_deg(place.lon_deg - origin.lon_deg) * RAD_PER_DEG
    north = cos0 * sin_lat - sin0 * cos_lat * det_cos(dlon)
    east = cos_lat * det_sin(dlon)
    sin_c = sqrt(north * north + east * east)
    k = _PX4_RADIUS_M
    if sin_c > 0.0:
        k *= det_atan2(sin_c, sin0 * sin_lat + cos0 * cos_lat * det_cos(dlon)) / sin_c
    return (k * north, k * east, origin.alt_m - place.alt_m)


def ardupilot_ned(origin: Place, place: Place) -> Vec3:
    """As ArduPilot's estimator has it."""
    scale = det_cos(0.5 * (origin.lat_deg + place.lat_deg) * RAD_PER_DEG)
    north_deg, east_deg = place.lat_deg - origin.lat_deg, _turn_deg(place.lon_deg - origin.lon_deg)
    return (
        north_deg * _ARDUPILOT_M_PER_DEG,
        east_deg * _ARDUPILOT_M_PER_DEG * scale,
        origin.alt_m - place.alt_m,
    )


def ardupilot_place(origin: Place, p_N: Vec3) -> Place:
    """Where `ardupilot_ned` has a point: the inverse."""
    north_deg = p_N[0] / _ARDUPILOT_M_PER_DEG
    scale = det_cos((origin.lat_deg + 0.5 * north_deg) * RAD_PER_DEG)
    east_deg = _turn_deg(p_N[1] / (_ARDUPILOT_M_PER_DEG * scale))
    return Place(origin.lat_deg + north_deg, _turn_deg(origin.lon_deg + east_deg), origin.alt_m - p_N[2])


def ardupilot_sitl_world(home: Place, home_W: Vec3) -> Callable[[Vec3], Place]:
    """A point of W to its place on Earth, as ArduPilot's SITL has it.

    SITL is told metres from home and lays them out on the Earth itself, by its own map: the place that it believes in
    is not the scene's, by 2 to 3 m per km, and a point has to be named as it would.
    """
    x0, y0, z0 = home_W
    return lambda p_W: ardupilot_place(home, (p_W[1] - y0, p_W[0] - x0, z0 - p_W[2]))


def origin_of(place: Place, p_N: Vec3, project: Projection) -> Place:
    """The origin about which `place` is at `p_N`: a fixed number of steps, each a factor of distance over radius."""
    per_deg = _ARDUPILOT_M_PER_DEG
    lat, lon = place.lat_deg, place.lon_deg
    for _ in range(6):
        north, east, _ = project(Place(lat, lon, place.alt_m), place)
        lat += (north - p_N[0]) / per_deg
        lon += (east - p_N[1]) / (per_deg * det_cos(lat * RAD_PER_DEG))
    return Place(lat, lon, place.alt_m + p_N[2])


def _turn_deg(angle_deg: float) -> float:
    """A difference of longitudes, the short way round."""
    if angle_deg > 180.0:
        return angle_deg - 360.0
    return angle_deg + 360.0 if angle_deg < -180.0 else angle_deg


class AutopilotFrame:
    """The autopilot's local frame: where its origin is, where the vehicle is in it, and how to get there from W.

    `project`: the autopilot's map; None: by the kind of autopilot, see `settle`.
    """

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
