"""Conversion between local ENU and WGS-84 geodetic coordinates, through earth-centred coordinates (ECEF).

Exact ellipsoidal maps, no flat-Earth approximation:

    N(phi) = a / sqrt(1 - e2 sin^2 phi)
    ECEF   = ((N + h) cos phi cos lam, (N + h) cos phi sin lam, (N (1 - e2) + h) sin phi)
    ENU    = R(phi0, lam0) (ECEF - ECEF0)

The inverse starts with Bowring's latitude (Survey Review 23, 1976) and refines it by a fixed number of iterations; the
error is below 1e-11 rad for heights within 50 km. The elementary functions are those of `signals._kernel`, which give
the same bits on every machine.
"""

from __future__ import annotations

import math
from typing import Protocol

from signals._kernel import det_atan2, det_cos, det_sin
from signals.samples import Vec3
from signals.units import DEG_PER_RAD, RAD_PER_DEG

# WGS-84 (NGA.STND.0036): semi-major axis and flattening define it; the rest follows.
SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1.0 - FLATTENING)
E2 = FLATTENING * (2.0 - FLATTENING)
EP2 = E2 / (1.0 - E2)

_BOWRING_STEPS = 3


def ecef_from_geodetic(latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vec3:
    """Return the ECEF position [m] of a geodetic position; the altitude is above the ellipsoid."""
    phi, lam = latitude_deg * RAD_PER_DEG, longitude_deg * RAD_PER_DEG
    sin_phi, cos_phi = det_sin(phi), det_cos(phi)
    normal = SEMI_MAJOR_M / math.sqrt(1.0 - E2 * sin_phi * sin_phi)
    out = (normal + altitude_m) * cos_phi
    return (out * det_cos(lam), out * det_sin(lam), (normal * (1.0 - E2) + altitude_m) * sin_phi)


def geodetic_from_ecef(p: Vec3) -> tuple[float, float, float]:
    """Return (latitude_deg, longitude_deg, altitude_m above the ellipsoid) of an ECEF position [m], not at a pole."""
    x, y, z = p
    r = math.sqrt(x * x + y * y)
    # Iterates the tangent of the parametric latitude, so that no step needs an arc tangent.
    tan_beta = z * SEMI_MAJOR_M / (r * SEMI_MINOR_M)
    sin_phi = cos_phi = 0.0
    for _ in range(_BOWRING_STEPS):
        cos_beta = 1.0 / math.sqrt(1.0 + tan_beta * tan_beta)
        sin_beta = tan_beta * cos_beta
        up = z + EP2 * SEMI_MINOR_M * sin_beta * sin_beta * sin_beta
        out = r - E2 * SEMI_MAJOR_M * cos_beta * cos_beta * cos_beta
        length = math.sqrt(up * up + out * out)
        sin_phi, cos_phi = up / length, out / length
        tan_beta = (1.0 - FLATTENING) * up / out
    root = math.sqrt(1.0 - E2 * sin_phi * sin_phi)
    # This form of the height has no division by a cosine or sine, which may be 0.
    altitude_m = r * cos_phi + z * sin_phi - SEMI_MAJOR_M * root
    return (det_atan2(sin_phi, cos_phi) * DEG_PER_RAD, det_atan2(y, x) * DEG_PER_RAD, altitude_m)


class Site(Protocol):
    """A position on Earth; the altitude is above the ellipsoid."""

    @property
    def latitude_deg(self) -> float: ...
    @property
    def longitude_deg(self) -> float: ...
    @property
    def altitude_m(self) -> float: ...


class LocalFrame:
    """The tangent frame W at a site: x east, y north, z up, origin at the site."""

    def __init__(self, site: Site) -> None:
        phi, lam = site.latitude_deg * RAD_PER_DEG, site.longitude_deg * RAD_PER_DEG
        self._sin_phi, self._cos_phi = det_sin(phi), det_cos(phi)
        self._sin_lam, self._cos_lam = det_sin(lam), det_cos(lam)
        self._origin = ecef_from_geodetic(site.latitude_deg, site.longitude_deg, site.altitude_m)

    def geodetic_from_enu(self, p_W: Vec3) -> tuple[float, float, float]:
        """Return (latitude_deg, longitude_deg, altitude_m) of a point in W [m]."""
        e, n, u = p_W
        sp, cp, sl, cl = self._sin_phi, self._cos_phi, self._sin_lam, self._cos_lam
        x0, y0, z0 = self._origin
        inward = cp * u - sp * n
        return geodetic_from_ecef((x0 + (cl * inward - sl * e), y0 + (sl * inward + cl * e), z0 + (cp * n + sp * u)))

    def enu_from_geodetic(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vec3:
        """Return the point in W [m] of a geodetic position."""
        x, y, z = ecef_from_geodetic(latitude_deg, longitude_deg, altitude_m)
        dx, dy, dz = x - self._origin[0], y - self._origin[1], z - self._origin[2]
        sp, cp, sl, cl = self._sin_phi, self._cos_phi, self._sin_lam, self._cos_lam
        out = cl * dx + sl * dy
        return (cl * dy - sl * dx, cp * dz - sp * out, cp * out + sp * dz)

    def enu_at(self, latitude_deg: float, longitude_deg: float, v_W: Vec3) -> Vec3:
        """Return a vector of W in east, north, up of another place: R(phi, lam) R(phi0, lam0)^T v."""
        e, n, u = v_W
        sp, cp, sl, cl = self._sin_phi, self._cos_phi, self._sin_lam, self._cos_lam
        inward = cp * u - sp * n
        x, y, z = cl * inward - sl * e, sl * inward + cl * e, cp * n + sp * u
        phi, lam = latitude_deg * RAD_PER_DEG, longitude_deg * RAD_PER_DEG
        sp, cp, sl, cl = det_sin(phi), det_cos(phi), det_sin(lam), det_cos(lam)
        out = cl * x + sl * y
        return (cl * y - sl * x, cp * z - sp * out, cp * out + sp * z)
