"""Magnetic declination by place, from a coarse table, as PX4's `geo_mag_declination` has one.

Within 0.7 degrees of the World Magnetic Model from 49 degrees south to 55 north, 1.5 degrees down to 55 south
(`tests/unit`); towards the poles the table's edge is used.
"""

from __future__ import annotations

from math import floor
from pathlib import Path

_STEP_DEG, _SOUTH_DEG, _WEST_DEG = 5, -60, -180


def _table() -> list[list[int]]:
    text = Path(__file__).with_name("declination.txt").read_text(encoding="utf-8")
    return [[int(word) for word in line.split()] for line in text.splitlines() if not line.startswith("#")]


def declination_deg(lat_deg: float, lon_deg: float) -> float:
    """Angle from true to magnetic north, east positive. Bilinear between the table's entries."""
    table = _table()
    y = min(max((lat_deg - _SOUTH_DEG) / _STEP_DEG, 0.0), len(table) - 1.0)
    x = min(max((lon_deg - _WEST_DEG) / _STEP_DEG, 0.0), len(table[0]) - 1.0)
    row, column = min(floor(y), len(table) - 2), min(floor(x), len(table[0]) - 2)
    v, u = y - row, x - column
    south = table[row][column] * (1.0 - u) + table[row][column + 1] * u
    north = table[row + 1][column] * (1.0 - u) + table[row + 1][column + 1] * u
    return (south * (1.0 - v) + north * v) / 10.0
