"""Direction of the sun by date and place, against published values and symmetry."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from signals.errors import ConfigError
from sim.scene.scene import load_scene
from sim.scene.sun_position import sun_position_deg

SCENE = """\
name: yard
description: a yard
site: {{latitude_deg: 39.742476, longitude_deg: -105.1786, altitude_m: 1830.0}}
ground_friction: 0.8
light: {{{light}}}
"""


def test_the_sun_is_where_the_solar_position_algorithm_of_nrel_has_it() -> None:
    # Reda and Andreas, NREL/TP-560-34302, table A5.1: azimuth 194.34024, zenith angle 50.11162; refraction 0.0163.
    azimuth, elevation = sun_position_deg(datetime(2003, 10, 17, 19, 30, 30, tzinfo=UTC), 39.742476, -105.1786)
    assert azimuth == pytest.approx(194.34024 - 360.0, abs=0.01)
    assert elevation == pytest.approx(90.0 - 50.11162 - 0.0163, abs=0.01)


def test_at_the_equinox_the_sun_is_overhead_at_the_equator() -> None:
    noon = datetime(2026, 3, 20, 12, 7, 30, tzinfo=UTC)  # the equation of time is -7.5 minutes
    assert sun_position_deg(noon, 0.0, 0.0)[1] > 89.5
    assert sun_position_deg(noon, 0.0, 180.0)[1] < -89.5


def scene_with(folder: Path, light: str) -> Path:
    path = folder / "yard.yaml"
    path.write_text(SCENE.format(light=light))
    return path


def test_a_scene_takes_its_sun_from_date_and_place(tmp_path: Path) -> None:
    light = load_scene(scene_with(tmp_path, 'utc: "2003-10-17T19:30:30Z", fog_per_m: 0.001')).light
    assert light.sun_elevation_deg == pytest.approx(39.872, abs=0.01)
    assert light.sun_azimuth_deg == pytest.approx(-165.66, abs=0.01)
    assert light.fog_per_m == 0.001


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ("utc: yesterday", "must be a time such as 2026-06-21T10:00:00Z"),
        ('utc: "2026-06-21T10:00:00"', "must be a time such as 2026-06-21T10:00:00Z"),
        ('utc: "2026-06-21T10:00:00Z", sun_elevation_deg: 20', "utc gives the sun's direction"),
    ],
)
def test_a_time_that_gives_no_sun_is_refused(tmp_path: Path, light: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_scene(scene_with(tmp_path, light))
