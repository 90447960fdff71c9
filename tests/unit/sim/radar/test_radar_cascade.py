"""The preset of TI's four chips in cascade: its virtual array, and a point target through twelve transmitters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.radar.echoes import Echoes
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from sim.radar.synthesis import Synthesizer
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters
from tests.worlds.radar_point_targets import direction

PRESET = PRESETS["awr2243cascade"].parameters
assert isinstance(PRESET, RadarParameters)
HALF_M = 299_792_458.0 / 76.8e9 / 2.0


def test_the_virtual_array_is_tis() -> None:
    """86 places half a wavelength apart across, in the plane of the receivers; elevations at 1, 4 and 6 of them."""
    array = PRESET.antenna.array
    assert (array.transmitters, len(array.rx_positions_m)) == (12, 16)
    places = np.array(array.positions_m)[:, 1:] / HALF_M
    assert np.allclose(places, np.rint(places), atol=1e-4)
    level = {round(y) for y, z in places.tolist() if abs(z) < 0.5}
    assert level == set(range(86))
    assert {round(z) for z in places[:, 1].tolist()} == {0, 1, 4, 6}


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(21.0, 9.0), (-47.0, -22.0)])
def test_a_target_is_where_it_is(azimuth_deg: float, elevation_deg: float) -> None:
    chirp = PRESET.chirp.model_copy(update={"chirps": 384, "samples": 64, "bandwidth_hz": 0.632e9})
    range_m, speed_mps = 7.3 * chirp.range_resolution_m, 0.6
    target = Echoes(
        np.array([range_m]), np.array([speed_mps]), direction(azimuth_deg, elevation_deg)[None], np.array([8000.0])
    )
    synthesizer = Synthesizer(chirp, PRESET.antenna.array, hp_cutoff_hz=None, aaf_cutoff_hz=None)
    signal = np.empty(synthesizer.shape)
    synthesizer.synthesize(target, signal)
    codes = np.floor(signal + 32768.5).astype(np.uint16)
    processor = Processor(chirp, PRESET.antenna.array, Processing(clutter="none"))
    point = processor.process(codes, 0, until="points").points[0]
    assert point["range_m"] == pytest.approx(range_m, abs=0.01)
    assert point["speed_mps"] == pytest.approx(speed_mps, abs=0.01)
    assert math.degrees(point["azimuth_rad"]) == pytest.approx(azimuth_deg, abs=0.05)
    assert math.degrees(point["elevation_rad"]) == pytest.approx(elevation_deg, abs=0.05)
