"""Map projections with which autopilots convert a place on Earth to metres from their local origin.

At 1 km they differ by up to 3 m, so a point in metres must be computed with the projection of the autopilot that gets
it. All three use the difference of altitudes for down.

    PX4        azimuthal equidistant on a sphere of 6371 km (Snyder, Map Projections, USGS 1987, eq. 22-4, 22-5)
    ArduPilot  equirectangular at the mean latitude, on a sphere of 6378.1 km
    tangent    north and east of the exact difference on WGS-84, as in the mock (`signals._kernel.tangent_ned`)

The elementary functions are the project's own: the same bits on every machine.

The origin of LOCAL_POSITION_NED is where the estimator started; autopilots send it in GPS_GLOBAL_ORIGIN (to 1e-7
degrees: 6 mm). Without that message it follows from LOCAL_POSITION_NED and GLOBAL_POSITION_INT of a vehicle at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, NamedTuple

from signals._kernel import det_atan2, det_cos, det_sin
from signals.samples import Vec3
from signals.units import RAD_PER_DEG

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
    """Project as PX4's estimator and position controller do."""
    lat0, lat = origin.lat_deg * RAD_PER_DEG, place.lat_deg * RAD_PER_DEG
    sin0, cos0, sin_lat, cos_lat = det_sin(lat0), det_cos(lat0), det_sin(lat), det_cos(lat)
    dlon = _wrapped_deg(place.lon_deg - origin.lon_deg) * RAD_PER_DEG
    north = cos0 * sin_lat - sin0 * cos_lat * det_cos(dlon)
    east = cos_lat * det_sin(dlon)
    sin_c = sqrt(north * north + east * east)
    k = _PX4_RADIUS_M
    if sin_c > 0.0:
        k *= det_atan2(sin_c, sin0 * sin_lat + cos0 * cos_lat * det_cos(dlon)) / sin_c
    return (k * north, k * east, origin.alt_m - place.alt_m)


def ardupilot_ned(origin: Place, place: Place) -> Vec3:
    """Project as ArduPilot's estimator does."""
    scale = det_cos(0.5 * (origin.lat_deg + place.lat_deg) * RAD_PER_DEG)
    north_deg, east_deg = place.lat_deg - origin.lat_deg, _wrapped_deg(place.lon_deg - origin.lon_deg)
    return (
        north_deg * _ARDUPILOT_M_PER_DEG,
        east_deg * _ARDUPILOT_M_PER_DEG * scale,
        origin.alt_m - place.alt_m,
    )


def ardupilot_place(origin: Place, p_N: Vec3) -> Place:
    """Return the place of a point: the inverse of `ardupilot_ned`."""
    north_deg = p_N[0] / _ARDUPILOT_M_PER_DEG
    scale = det_cos((origin.lat_deg + 0.5 * north_deg) * RAD_PER_DEG)
    east_deg = _wrapped_deg(p_N[1] / (_ARDUPILOT_M_PER_DEG * scale))
    return Place(origin.lat_deg + north_deg, _wrapped_deg(origin.lon_deg + east_deg), origin.alt_m - p_N[2])


def ardupilot_sitl_world(home: Place, home_W: Vec3) -> Callable[[Vec3], Place]:
    """Return the map from W to the place on Earth that ArduPilot's SITL uses.

    SITL gets metres from home and converts them by its own projection. Its places differ from the scene's by 2 to 3 m
    per km, so points for it must be converted in the same way.
    """
    x0, y0, z0 = home_W
    return lambda p_W: ardupilot_place(home, (p_W[1] - y0, p_W[0] - x0, z0 - p_W[2]))


def origin_of(place: Place, p_N: Vec3, project: Projection) -> Place:
    """Return the origin from which `place` is at `p_N`. Each step reduces the error by distance / Earth radius."""
    per_deg = _ARDUPILOT_M_PER_DEG
    lat, lon = place.lat_deg, place.lon_deg
    for _ in range(6):
        north, east, _ = project(Place(lat, lon, place.alt_m), place)
        lat += (north - p_N[0]) / per_deg
        lon += (east - p_N[1]) / (per_deg * det_cos(lat * RAD_PER_DEG))
    return Place(lat, lon, place.alt_m + p_N[2])


def _wrapped_deg(angle_deg: float) -> float:
    """Return a difference of longitudes in [-180, 180]."""
    if angle_deg > 180.0:
        return angle_deg - 360.0
    return angle_deg + 360.0 if angle_deg < -180.0 else angle_deg


class AutopilotFrame:
    """The autopilot's local frame: its origin, the vehicle's position in it, and the conversion from W.

    `project`: the autopilot's projection; None: that of the connected firmware, see `project_as`.
    """

    def __init__(self, geodetic_from_W: GeodeticFromW, project: Projection | None) -> None:
        self._geodetic_from_W = geodetic_from_W
        self._project = project
        self.origin: Place | None = None
        self.p_N: Vec3 | None = None  # the vehicle's, as last reported
        self._place: Place | None = None

    def project_as(self, project: Projection | None) -> None:
        """Take the projection of the connected firmware, unless one was given."""
        if self._project is None:
            self._project = project

    @property
    def known(self) -> bool:
        """True once points can be converted and the vehicle's position is known."""
        return self.origin is not None and self.p_N is not None

    def infer_origin(self) -> bool:
        """Compute the origin from the vehicle's local and global position. Return False if one is missing."""
        if self._place is None or self.p_N is None or self._project is None:
            return False
        self.origin = origin_of(self._place, self.p_N, self._project)
        return True

    def ned_from_W(self, p_W: Vec3) -> Vec3:
        """Convert a point in W to the autopilot's NED. Only once `known`."""
        assert self.origin is not None
        assert self._project is not None
        return self._project(self.origin, Place(*self._geodetic_from_W(p_W)))

    def on_origin(self, message: Any) -> None:
        self.origin = Place(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    def on_local_position(self, message: Any) -> None:
        self.p_N = (message.x, message.y, message.z)

    def on_global_position(self, message: Any) -> None:
        self._place = Place(message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
