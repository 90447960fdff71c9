"""Local frames of autopilots: each projection against its own oracle, and the origin recovered."""

from __future__ import annotations

import math

import pytest

from firmware_bridge.ground_station.modes import ARDUPILOT, PX4, firmware_of
from firmware_bridge.ground_station.projections import (
    AutopilotFrame,
    Place,
    Projection,
    ardupilot_ned,
    ardupilot_sitl_world,
    origin_of,
    px4_ned,
)
from signals._kernel import tangent_ned
from signals.geodesy import LocalFrame
from sim.scene.scene import load_scene
from tests.worlds.mock_pixhawk_world import World

ORIGIN = Place(47.397742, 8.545594, 488.0)
NEAR_AND_FAR = [(0.0, 0.0), (3.0, -7.0), (1000.0, 0.0), (-6000.0, 8000.0), (7000.0, 7000.0)]


def place_at(north_m: float, east_m: float, up_m: float = 12.0) -> Place:
    """Return a random place near the origin."""
    lat = ORIGIN.lat_deg + north_m / 111_200.0
    return Place(lat, ORIGIN.lon_deg + east_m / 111_200.0 / math.cos(math.radians(lat)), ORIGIN.alt_m + up_m)


@pytest.mark.parametrize(("north_m", "east_m"), NEAR_AND_FAR[1:])
def test_px4_keeps_great_circle_distance_and_bearing(north_m: float, east_m: float) -> None:
    place = place_at(north_m, east_m)
    lat0, lat = math.radians(ORIGIN.lat_deg), math.radians(place.lat_deg)
    dlat, dlon = lat - lat0, math.radians(place.lon_deg - ORIGIN.lon_deg)
    a = math.sin(dlat / 2) ** 2 + math.cos(lat0) * math.cos(lat) * math.sin(dlon / 2) ** 2
    x = math.cos(lat0) * math.sin(lat) - math.sin(lat0) * math.cos(lat) * math.cos(dlon)
    bearing = math.atan2(math.sin(dlon) * math.cos(lat), x)
    north, east, down = px4_ned(ORIGIN, place)
    assert math.hypot(north, east) == pytest.approx(2 * 6371e3 * math.asin(math.sqrt(a)), abs=1e-6)
    assert math.atan2(east, north) == pytest.approx(bearing, abs=1e-9)
    assert down == pytest.approx(-12.0, abs=1e-9)


def test_ardupilot_scales_degrees() -> None:
    place = Place(ORIGIN.lat_deg + 0.05, ORIGIN.lon_deg - 0.05, 480.0)
    north, east, down = ardupilot_ned(ORIGIN, place)
    assert north == pytest.approx(0.05 * 111_318.84502145034, abs=1e-6)
    scale = math.cos(math.radians(ORIGIN.lat_deg + 0.025))
    assert east == pytest.approx(-0.05 * 111_318.84502145034 * scale, abs=1e-6)
    assert down == 8.0


@pytest.mark.parametrize(("north_m", "east_m"), NEAR_AND_FAR)
def test_tangent_plane_is_that_of_the_benchs_geodesy(north_m: float, east_m: float) -> None:
    site = load_scene("airfield").site
    origin = Place(site.latitude_deg, site.longitude_deg, site.altitude_m)
    lat, lon, alt = LocalFrame(site).geodetic_from_enu((east_m, north_m, 5.0))
    north, east, down = tangent_ned(origin, Place(lat, lon, alt))
    assert (north, east) == pytest.approx((north_m, east_m), abs=1e-6)
    assert down == pytest.approx(origin.alt_m - alt, abs=1e-9)


def test_points_ten_kilometres_off_reach_the_mock_within_a_millimetre() -> None:
    world = World()
    world.run(8.0)
    estimate = world.autopilot.firmware.estimate
    geodesy = LocalFrame(load_scene("airfield").site)
    frame = AutopilotFrame(geodesy.geodetic_from_enu, tangent_ned)
    frame.origin = Place(*estimate.geodetic(0.0, 0.0, 0.0))
    for north_m, east_m in NEAR_AND_FAR:
        p_W = (east_m, north_m, 30.0)
        assert frame.ned_from_W(p_W) == pytest.approx(estimate.ned(*geodesy.geodetic_from_enu(p_W)), abs=1e-3)


@pytest.mark.parametrize("project", [px4_ned, ardupilot_ned, tangent_ned])
@pytest.mark.parametrize(("north_m", "east_m"), NEAR_AND_FAR)
def test_the_origin_is_recovered(project: Projection, north_m: float, east_m: float) -> None:
    place = place_at(north_m, east_m)
    origin = origin_of(place, project(ORIGIN, place), project)
    assert project(ORIGIN, origin) == pytest.approx((0, 0, 0), abs=1e-3)


@pytest.mark.parametrize("project", [px4_ned, ardupilot_ned, tangent_ned])
def test_places_across_the_date_line_are_near(project: Projection) -> None:
    north, east, _ = project(Place(10.0, 179.9999, 0.0), Place(10.0, -179.9999, 0.0))
    assert east == pytest.approx(21.9, abs=0.2)
    assert abs(north) < 0.01


@pytest.mark.parametrize(("north_m", "east_m"), NEAR_AND_FAR)
def test_metres_from_home_stay_metres_in_ardupilots_sitl(north_m: float, east_m: float) -> None:
    place = ardupilot_sitl_world(ORIGIN, (1.0, 2.0, 3.0))((1.0 + east_m, 2.0 + north_m, 8.0))
    assert ardupilot_ned(ORIGIN, place) == pytest.approx((north_m, east_m, -5.0), abs=1e-6)


def test_the_projection_is_that_of_the_firmware_heard_unless_one_is_given() -> None:
    place = place_at(0.0, 1000.0)
    for autopilot, given, expected in (
        (PX4, None, px4_ned),
        (ARDUPILOT, None, ardupilot_ned),
        (PX4, tangent_ned, tangent_ned),
    ):
        frame = AutopilotFrame(lambda _p_W: tuple(place), given)
        frame.project_as(firmware_of(autopilot).project)
        frame.origin = ORIGIN
        assert frame.ned_from_W((0.0, 0.0, 0.0)) == expected(ORIGIN, place)
    # The projections differ by metres over a kilometre.
    assert abs(px4_ned(ORIGIN, place)[1] - tangent_ned(ORIGIN, place)[1]) > 1.0
