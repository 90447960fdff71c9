"""Nominal constellations by their published elements, at the start of a run's GPS week.

    GPS      24 slots of six planes, a = 26 559.7 km, i = 55 deg, right ascensions and arguments of latitude of the
             baseline constellation (GPS Standard Positioning Service Performance Standard, table of reference orbit
             slots). `gps_satellites: 32` puts eight more satellites into the middle of the widest gaps of the planes:
             the standard states no places for them
    Galileo  Walker 24/3/1, a = 29 600.318 km, i = 56 deg, plane A at 317.632 deg, slot A1 at 180.153 deg, 45 deg along
             a plane, 15 deg from plane to plane (European GNSS Service Centre, reference constellation)
    GLONASS  Walker 24/3/1, a = 25 508 km, i = 64.8 deg (GLONASS ICD, edition 5.1: 19 100 km of altitude, three planes)
    BeiDou   the 24 satellites in medium orbits of BDS-3, Walker 24/3/1, a = 27 906.1 km, i = 55 deg (BDS-OS-PS:
             21 528 km of altitude); those in geosynchronous orbits are left out

A Walker constellation i: t/p/f has t / p satellites in each of p planes that are 360 / p degrees apart; a satellite
leads its neighbour in the plane to the west by 360 f / t. Orbits are circles. The right ascensions are those of the
tables at the start of the week: what is nominal is the pattern, not the sky of a certain hour, for which there are
almanacs. GLONASS and BeiDou state no right ascension of a first plane: 0 deg. `seed` other than 0 turns each system by
a right ascension and an argument of latitude of its own.

    longitude of the node = right ascension - GMST
    GMST = 280.46061837 + 360.98564736629 d  [deg],   d: days since J2000
    dO/dt = -3/2 J2 (R / a)^2 n cos i                 (Kaula, Theory of Satellite Geodesy, 1966)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import pairwise

from signals._kernel import det_cos
from signals.units import RAD_PER_DEG
from sim.gnss.gps_time import WEEK_S, gps_seconds, week_start_s
from sim.gnss.orbit import Orbit
from sim.gnss.systems import SYSTEMS, SystemName
from sim.scene.random_generator import feature_rng

_GPS_PLANES: dict[float, tuple[float, ...]] = {  # right ascension of the plane: arguments of latitude [deg]
    272.847: (268.126, 161.786, 11.676, 41.806),
    332.847: (80.956, 173.336, 309.976, 204.376),
    32.847: (111.876, 11.796, 339.666, 241.556),
    92.847: (135.226, 265.446, 35.156, 167.356),
    152.847: (197.046, 302.596, 66.066, 333.686),
    212.847: (238.886, 345.226, 105.206, 135.346),
}
_J2000_GPS_S = gps_seconds(datetime(2000, 1, 1, 12, tzinfo=UTC))
_J2, _EARTH_RADIUS_M = 1.08262668e-3, 6378137.0

_Slot = tuple[float, float]  # right ascension and argument of latitude [deg]


def _gps_slots(count: int) -> Iterator[_Slot]:
    slots = [(node, u) for node, plane in _GPS_PLANES.items() for u in plane]
    yield from slots
    gaps = []
    for node, plane in _GPS_PLANES.items():
        around = sorted(plane)
        for low, high in pairwise((*around, around[0] + 360.0)):
            gaps.append((high - low, node, (0.5 * (low + high)) % 360.0))
    gaps.sort(key=lambda gap: (-gap[0], gap[1], gap[2]))
    yield from ((node, u) for _, node, u in gaps[: count - len(slots)])


def _walker(node_deg: float, first_deg: float) -> Iterator[_Slot]:
    """Yield the slots of a Walker constellation 24/3/1."""
    for plane in range(3):
        for place in range(8):
            yield node_deg + 120.0 * plane, first_deg + 45.0 * place + 15.0 * plane


_SHAPES: dict[str, tuple[float, float]] = {  # semi-major axis [m], inclination [deg]
    "gps": (26_559.7e3, 55.0),
    "galileo": (29_600.318e3, 56.0),
    "glonass": (25_508.0e3, 64.8),
    "beidou": (27_906.1e3, 55.0),
}


def nominal_orbits(
    systems: Sequence[SystemName], *, start_s: float, gps_satellites: int = 32, seed: int = 0
) -> tuple[Orbit, ...]:
    """Return the satellites of these systems in a run that begins at GPS time `start_s`."""
    begin_s = week_start_s(start_s)
    days = (begin_s - _J2000_GPS_S) / 86_400.0
    sidereal_deg = (280.46061837 + 360.98564736629 * days) % 360.0
    orbits = []
    for system in systems:
        slots = {
            "gps": lambda: _gps_slots(gps_satellites),
            "galileo": lambda: _walker(317.632, 180.153),
            "glonass": lambda: _walker(0.0, 0.0),
            "beidou": lambda: _walker(0.0, 0.0),
        }[system]()
        semi_major_m, inclination_deg = _SHAPES[system]
        turn_deg = ahead_deg = 0.0
        if seed:
            rng = feature_rng(seed, "gnss", system)
            turn_deg, ahead_deg = rng.between(0.0, 360.0), rng.between(0.0, 360.0)
        motion = math.sqrt(SYSTEMS[system].mu_m3ps2 / (semi_major_m * semi_major_m * semi_major_m))
        shrunk = _EARTH_RADIUS_M / semi_major_m
        inclination_rad = inclination_deg * RAD_PER_DEG
        for number, (node_deg, latitude_deg) in enumerate(slots, 1):
            orbits.append(
                Orbit(
                    system=system,
                    number=number,
                    week=int(begin_s) // WEEK_S,
                    toa_s=0.0,
                    sqrt_semi_major_rtm=math.sqrt(semi_major_m),
                    eccentricity=0.0,
                    inclination_rad=inclination_rad,
                    node_rad=((node_deg + turn_deg - sidereal_deg) % 360.0) * RAD_PER_DEG,
                    node_rate_radps=-1.5 * _J2 * shrunk * shrunk * motion * det_cos(inclination_rad),
                    perigee_rad=0.0,
                    anomaly_rad=((latitude_deg + ahead_deg) % 360.0) * RAD_PER_DEG,
                )
            )
    return tuple(orbits)
