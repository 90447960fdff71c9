"""A sensor as a run installs it: 10 Hz, seed 1, a tick of 4 ms."""

from __future__ import annotations

from typing import Any

from sim.scene.scene import Scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation


def installed(
    name: str, scene: Scene, *, preset: str | None = None, kind: str | None = None, overrides: Any = None, **more: Any
) -> Any:
    """Return the sensor. `more`: further fields of `Installation`, or others than those above."""
    installation = Installation(**{"rate_hz": 10.0, "seed": 1, "step_ns": 4_000_000} | more, name=name, scene=scene)
    return make_sensor(installation, preset=preset, kind=kind, overrides=overrides)
