"""The standard atmosphere against the tables of ISO 2533:1975."""

from __future__ import annotations

import pytest

from sim.scene.atmosphere import geopotential_m, pressure_altitude_m, pressure_pa

# Geopotential height [m], pressure [Pa].
TABLE = [(0, 101_325.0), (1000, 89_874.6), (5000, 54_019.9), (11_000, 22_632.1)]
TABLE += [(15_000, 12_044.6), (20_000, 5474.9)]


@pytest.mark.parametrize(("height_m", "tabulated_pa"), TABLE)
def test_pressure_is_that_of_the_table(height_m: float, tabulated_pa: float) -> None:
    assert pressure_pa(height_m) == pytest.approx(tabulated_pa, abs=0.06)  # the last digit printed
    assert pressure_altitude_m(pressure_pa(height_m)) == pytest.approx(height_m, abs=1e-6)


def test_geopotential_height_is_that_of_the_table() -> None:
    assert geopotential_m(5000.0) == pytest.approx(4996.07, abs=0.01)
    assert geopotential_m(20_000.0) == pytest.approx(19_937.27, abs=0.01)
