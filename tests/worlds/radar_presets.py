"""Settings of the shipped radars."""

from __future__ import annotations

from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters


def preset(name: str) -> RadarParameters:
    """Return the settings of a radar by its preset's name."""
    p = PRESETS[name].parameters
    assert isinstance(p, RadarParameters)
    return p
