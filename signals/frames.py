"""Coordinate frames and the exact maps between them.

W  world, ENU: x east, y north, z up; origin at the scene's geodetic origin.
B  body, FLU: x forward, y left, z up; origin at the centre of mass.
N  local NED and F body FRD exist only in protocols that demand them (`firmware_bridge.codecs`).
"""

from __future__ import annotations

from signals.samples import Quat, Vec3

_SQRT_HALF = 0.70710678118654752440


def frd_from_flu(v: Vec3) -> Vec3:
    """Return a body FLU vector in body FRD: (x, -y, -z). The map is its own inverse."""
    return (v[0], -v[1], -v[2])


def ned_from_enu(v: Vec3) -> Vec3:
    """Return a world ENU vector in NED: (y, x, -z). The map is its own inverse."""
    return (v[1], v[0], -v[2])


def q_NF_from_q_WB(q_WB: Quat) -> Quat:
    """Return the attitude FRD->NED of an attitude FLU->ENU.

    q_NF = q_NW * q_WB * q_BF with q_NW = (0, 1/sqrt2, 1/sqrt2, 0) and q_BF = (0, 1, 0, 0).
    """
    w, x, y, z = q_WB
    s = _SQRT_HALF
    return (s * (w + z), s * (x + y), s * (x - y), s * (w - z))
