"""Sensors by name: what kinds there are, which presets, and how to make one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hil.signals.time import period_ns_from_hz
from sim.frame.quality import QUALITIES, with_quality
from sim.frame.shared_picture import SharedPicture
from sim.frame.source import FrameSource
from sim.scene.scene import Scene
from sim.sensors.kinds import KINDS, Kind
from sim.sensors.presets import PRESETS, Preset
from sim.sensors.sensor import Installation, Sensor

__all__ = ["KINDS", "PRESETS", "Kind", "Preset", "make_sensor"]


def make_sensor(
    name: str,
    *,
    preset: str | None = None,
    kind: str | None = None,
    rate_hz: float,
    seed: int,
    scene: Scene,
    step_ns: int,
    overrides: Mapping[str, Any] | None = None,
    frames: FrameSource | None = None,
    shared: SharedPicture | None = None,
) -> Sensor:
    """A sensor from a preset, or from a kind with all its parameters in `overrides`.

    `overrides` replace single parameters. `step_ns` is the physics tick, `frames` what cameras, LiDARs and radars look
    at, `shared` the pictures of a camera that somebody else reads, or that this sensor reads. Raises KeyError for an
    unknown preset or kind (legal names: `sorted(PRESETS)`, `sorted(KINDS)`), ValueError for a preset of another kind,
    pydantic.ValidationError for wrong parameters.
    """
    values: dict[str, Any] = {}
    if preset is not None:
        chosen = PRESETS[preset]
        if kind is not None and kind != chosen.kind:
            raise ValueError(f"sensor '{name}': preset '{preset}' is a {chosen.kind}, not a {kind}")
        kind = chosen.kind
        values = chosen.parameters.model_dump()
    if kind is None:
        raise ValueError(f"sensor '{name}' needs a preset or a kind")
    entry = KINDS[kind]
    own = dict(overrides or {})
    if kind == "camera" and own.get("quality") in QUALITIES:
        values = with_quality(values, own["quality"])
    parameters = entry.parameters.model_validate(values | own)
    installation = Installation(name, period_ns_from_hz(rate_hz), seed, scene, step_ns, frames, shared)
    sensor: Sensor = entry.sensor(installation, parameters)
    return sensor
