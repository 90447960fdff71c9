"""Direction of the sun at a place and time, by the low-precision formulas of the Astronomical Almanac.

With n the days since noon of 1 January 2000 (UTC), L the mean longitude, g the mean anomaly, lambda the ecliptic
longitude and epsilon the obliquity, in degrees:

    L = 280.460 + 0.9856474 n,  g = 357.528 + 0.9856003 n,  epsilon = 23.439 - 0.0000004 n
    lambda = L + 1.915 sin g + 0.020 sin 2g
    right ascension = atan2(cos epsilon sin lambda, cos lambda),  declination = asin(sin epsilon sin lambda)
    hour angle = 280.46062 + 360.98564737 n + longitude - right ascension

(Michalsky, Solar Energy 40, 1988.) Good to 0.01 degrees from 1950 to 2050; refraction is left out.
"""

from __future__ import annotations

from datetime import UTC, datetime

from signals._kernel import det_asin, det_atan2, det_cos, det_sin
from signals.units import RAD_PER_DEG

_NOON_2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_DAY_S = 86_400.0


def sun_position_deg(utc: datetime, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return azimuth (clockwise from north, -180 to 180) and elevation of the sun. `utc` has a time zone."""
    n = (utc - _NOON_2000).total_seconds() / _DAY_S
    anomaly = _rad(357.528 + 0.9856003 * n)
    longitude = _rad(280.460 + 0.9856474 * n + 1.915 * det_sin(anomaly) + 0.020 * det_sin(2.0 * anomaly))
    obliquity = _rad(23.439 - 0.0000004 * n)
    ascension = det_atan2(det_cos(obliquity) * det_sin(longitude), det_cos(longitude))
    declination = det_asin(det_sin(obliquity) * det_sin(longitude))
    hour = _rad(280.46062 + 360.98564737 * n + longitude_deg) - ascension
    latitude = latitude_deg * RAD_PER_DEG
    east = -det_cos(declination) * det_sin(hour)
    north = det_sin(declination) * det_cos(latitude) - det_cos(declination) * det_sin(latitude) * det_cos(hour)
    up = det_sin(declination) * det_sin(latitude) + det_cos(declination) * det_cos(latitude) * det_cos(hour)
    return det_atan2(east, north) / RAD_PER_DEG, det_asin(min(max(up, -1.0), 1.0)) / RAD_PER_DEG


def _rad(degrees: float) -> float:
    return (degrees % 360.0) * RAD_PER_DEG
