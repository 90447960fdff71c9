"""The declination table against the World Magnetic Model."""

import pygeomag
import pytest

from firmware_bridge.mock_pixhawk.estimate.state import declination_deg
from tests.worlds.mock_pixhawk_world import World, messages


def test_it_follows_the_model_within_its_stated_error_wherever_a_compass_works():
    model = pygeomag.GeoMag()
    worst = {10_000: 0.0, 6_000: 0.0, 2_000: 0.0}
    for lat in range(-89, 90, 2):
        for lon in range(-180, 181, 9):
            field = model.calculate(glat=lat, glon=lon, alt=0, time=2026.0)
            error = abs((declination_deg(lat, lon) - field.d + 180.0) % 360.0 - 180.0)
            for least_nt in worst:
                if field.h >= least_nt:
                    worst[least_nt] = max(worst[least_nt], error)
    assert worst[10_000] < 0.3
    assert worst[6_000] < 0.6
    assert worst[2_000] < 1.5


@pytest.mark.parametrize(("lat", "lon"), [(-90, -180), (90, 180), (0, 0), (47.4, 8.5), (-60, 180)])
def test_every_place_has_a_declination(lat, lon):
    assert -180.0 <= declination_deg(lat, lon) <= 180.0


def test_the_vehicle_knows_true_north():
    world = World()
    frames = world.run(8.0)
    # It faces east; without declination its heading would be 3.5 degrees off.
    assert messages(frames, "ATTITUDE")[-1].yaw == pytest.approx(1.5708, abs=0.03)
