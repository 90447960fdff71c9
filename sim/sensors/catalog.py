"""Sensors by name: their kinds and presets, and the function that makes one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim.frame.quality import QUALITIES, with_quality
from sim.sensors.kinds import KINDS, Kind
from sim.sensors.presets import PRESETS, Preset
from sim.sensors.sensor import Installation, Sensor

__all__ = ["KINDS", "PRESETS", "Kind", "Preset", "make_sensor"]


def make_sensor(
    installation: Installation,
    *,
    preset: str | None = None,
    kind: str | None = None,
    overrides: Mapping[str, Any] | None = None,
) -> Sensor:
    """Make a sensor from a preset, or from a kind with all its parameters in `overrides`.

    `overrides` replace single parameters. Raises KeyError for an unknown preset or kind (legal names:
    `sorted(PRESETS)`, `sorted(KINDS)`), ValueError for a preset of another kind, pydantic.ValidationError for wrong
    parameters.
    """
    name = installation.name
    values: dict[str, Any] = {}
    if preset is not None:
        preset_data = PRESETS[preset]
        if kind is not None and kind != preset_data.kind:
            raise ValueError(f"sensor '{name}': preset '{preset}' is a {preset_data.kind}, not a {kind}")
        kind = preset_data.kind
        values = preset_data.parameters.model_dump()
    if kind is None:
        raise ValueError(f"sensor '{name}' needs a preset or a kind")
    entry = KINDS[kind]
    given = dict(overrides or {})
    if kind == "camera" and given.get("quality") in QUALITIES:
        values = with_quality(values, given["quality"])
    parameters = entry.parameters.model_validate(values | given)
    sensor: Sensor = entry.sensor(installation, parameters)
    return sensor
