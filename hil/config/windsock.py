"""Windsocks of a generated map show the steady wind of the bench, unless the scene's file says what they show."""

from __future__ import annotations

from signals._kernel import det_atan2
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.map_section import GeneratedMap
from sim.scene.scene import Scene

_KEYS = {"wind_from_deg", "wind_mps"}
_MOST_MPS = 20.0  # of the parameter; a sock is stretched from 8 m/s on


def with_windsock(scene: Scene, steady_W_mps: Vec3) -> Scene:
    """Return the scene with its windsock in this wind. Turbulence, gusts and a wind set in flight do not move it."""
    section = scene.map
    if not isinstance(section, GeneratedMap):
        return scene
    from sim.scene.maps.catalog import GENERATORS  # slow to load

    if section.generator not in GENERATORS:
        return scene
    if not GENERATORS[section.generator].parameters.model_fields.keys() >= _KEYS or _KEYS & section.parameters.keys():
        return scene
    x, y, _ = steady_W_mps
    shown = {
        "wind_from_deg": det_atan2(-x, -y) / TURN_RAD * 360.0 % 360.0,  # clockwise from north
        "wind_mps": min((x * x + y * y) ** 0.5, _MOST_MPS),
    }
    return scene.model_copy(update={"map": GeneratedMap.model_validate({**section.model_dump(), **shown})})
