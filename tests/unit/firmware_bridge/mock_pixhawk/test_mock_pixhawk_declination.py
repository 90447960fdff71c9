"""The declination table against the World Magnetic Model."""

import pygeomag
import pytest

from firmware_bridge.mock_pixhawk.estimate.state import declination_deg
from tests.worlds.mock_pixhawk_world import World, messages


@pytest.mark.parametrize(("south", "north", "limit_deg"), [(-49, 55, 0.7), (-55, -50, 1.5)])
def test_it_follows_the_model_within_its_stated_error(south, north, limit_deg):
    model = pygeomag.GeoMag()
    worst = 0.0
    for lat in range(south, north + 1, 4):
        for lon in range(-180, 181, 9):
            error = declination_deg(lat, lon) - model.calculate(glat=lat, glon=lon, alt=0, time=2026.0).d
            worst = max(worst, abs(error))
    assert worst < limit_deg


@pytest.mark.parametrize(("lat", "lon"), [(-90, -180), (90, 180), (0, 0), (47.4, 8.5), (-60, 180)])
def test_every_place_has_a_declination(lat, lon):
    assert -180.0 <= declination_deg(lat, lon) <= 180.0


def test_the_vehicle_knows_true_north():
    world = World()
    frames = world.run(8.0)
    # It faces east; without declination its heading would be 3.5 degrees off.
    assert messages(frames, "ATTITUDE")[-1].yaw == pytest.approx(1.5708, abs=0.03)
