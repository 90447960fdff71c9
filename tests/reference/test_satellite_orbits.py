"""Satellites on Kepler orbits against the two-body equation, integrated in an inertial frame, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from signals.geodesy import LocalFrame, ecef_from_geodetic
from sim._kernels import satellite_positions
from sim.gnss.constellations import nominal_orbits
from sim.gnss.gps_time import gps_seconds
from sim.gnss.orbit import Orbit, orbit_table
from sim.gnss.systems import SYSTEMS
from sim.scene.light import time_of
from sim.scene.scene import load_scene
from tests.worlds.street_canyon import receiver_in

EARTH_RATE = 7.2921151467e-5
START_S = gps_seconds(time_of("2026-11-29T10:00:00Z"))


def positions(orbits: tuple[Orbit, ...], t_s: float) -> np.ndarray:
    out = np.empty((len(orbits), 3))
    satellite_positions(orbit_table(orbits, START_S), t_s, out)
    return out


def integrated(orbit: Orbit, after_s: list[float]) -> np.ndarray:
    """Positions by the two-body equation from the elements at toa, in the frame that turns with the Earth.

    The node's own rate, which the equation does not have, turns the plane.
    """
    mu, a, e = SYSTEMS[orbit.system].mu_m3ps2, orbit.sqrt_semi_major_rtm**2, orbit.eccentricity
    big = orbit.anomaly_rad
    for _ in range(60):
        big = orbit.anomaly_rad + e * math.sin(big)
    p = np.array([a * (math.cos(big) - e), a * math.sqrt(1.0 - e * e) * math.sin(big), 0.0])
    speed = math.sqrt(mu * a) / (a * (1.0 - e * math.cos(big)))
    v = speed * np.array([-math.sin(big), math.sqrt(1.0 - e * e) * math.cos(big), 0.0])
    solution = solve_ivp(
        lambda _, y: np.concatenate([y[3:], -mu * y[:3] / np.linalg.norm(y[:3]) ** 3]),
        (0.0, max(after_s)),
        np.concatenate([p, v]),
        method="DOP853",
        rtol=1e-13,
        atol=1e-6,
        t_eval=after_s,
    )

    def turn(axis: int, angle: float) -> np.ndarray:
        c, s = math.cos(angle), math.sin(angle)
        return np.array(
            [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]] if axis == 2 else [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
        )

    out = []
    for t, y in zip(after_s, solution.y.T, strict=True):
        node = orbit.node_rad + orbit.node_rate_radps * t - EARTH_RATE * (t + orbit.toa_s)
        out.append(turn(2, node) @ turn(0, orbit.inclination_rad) @ turn(2, orbit.perigee_rad) @ y[:3])
    return np.array(out)


ELLIPSE = Orbit(
    system="gps",
    number=7,
    week=2446,
    toa_s=405_504.0,
    sqrt_semi_major_rtm=5153.6,
    eccentricity=0.021,
    inclination_rad=0.97,
    node_rad=-1.1,
    node_rate_radps=-7.9e-9,
    perigee_rad=2.3,
    anomaly_rad=-0.6,
)


@pytest.mark.parametrize(
    "orbit",
    [ELLIPSE, *nominal_orbits(("gps", "galileo", "glonass", "beidou"), start_s=START_S)[::13]],
    ids=lambda orbit: orbit.name,
)
def test_positions_are_those_of_the_two_body_equation(orbit: Orbit) -> None:
    after_s = [0.0, 600.0, 7200.0, 43_000.0, 86_400.0]
    expected = integrated(orbit, after_s)
    begin = orbit.week * 604_800.0 + orbit.toa_s
    got = np.array([positions((orbit,), begin + t)[0] for t in after_s])
    assert np.abs(got - expected).max() < 0.1  # metres


def test_the_sky_of_a_receiver_is_made_of_these_positions() -> None:
    scene = load_scene("airfield")
    gps = receiver_in(scene, sky={"utc": "2026-11-29T10:00:00Z"})
    antenna = (30.0, -20.0, 12.0)
    got = gps.receiver.directions(5_000_000_000, antenna).copy()
    site = scene.site
    place = ecef_from_geodetic(*LocalFrame(site).geodetic_from_enu(antenna))
    away = positions(gps.receiver.orbits, START_S + 5.0) - np.array(place)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    phi, lam = math.radians(site.latitude_deg), math.radians(site.longitude_deg)
    up = np.array([math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)])
    east = np.array([-math.sin(lam), math.cos(lam), 0.0])
    expected = np.stack([away @ east, away @ np.cross(up, east), away @ up], axis=1)
    assert np.abs(got - expected).max() < 1e-9


def test_a_navigation_satellite_passes_the_same_ground_again() -> None:
    # GPS circles twice in a sidereal day: after it, each satellite is over the same place but for its node's drift.
    orbits = nominal_orbits(("gps",), start_s=START_S, gps_satellites=24)
    day_s = 86_164.0905
    a, b = positions(orbits, START_S), positions(orbits, START_S + day_s)
    assert np.linalg.norm(b - a, axis=1).max() < 60e3


def test_there_are_always_enough_satellites_in_the_open() -> None:
    up = np.array(ecef_from_geodetic(47.4, 8.5, 400.0))
    for hour in range(0, 24, 3):
        away = positions(nominal_orbits(("gps",), start_s=START_S, gps_satellites=24), START_S + 3600.0 * hour) - up
        sines = away @ (up / np.linalg.norm(up)) / np.linalg.norm(away, axis=1)
        assert (sines > math.sin(math.radians(5.0))).sum() >= 5
