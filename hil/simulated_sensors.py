"""The simulated sensors of a bench, made one by one; a camera's pictures are shared with the radars that read them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any

from hil.config import Bench, SensorConfig
from hil.config.radar_checks import radars, view_of
from hil.signals.time import is_due
from sim.frame.source import FrameSource
from sim.sensors.catalog import make_sensor
from sim.sensors.radar import Radar


class SimulatedSensors:
    """Makes sensors of one bench, all of them looking at the same `frames`."""

    def __init__(self, bench: Bench, names: Collection[str], frames: FrameSource | None) -> None:
        """`names`: the sensors that will be made. `frames`: None where none of them looks at the world."""
        self._bench, self._frames = bench, frames
        sensors = bench.config.sensors
        wanted = {name: sensors[name] for name in sensors if name in names}
        read = {p.frame for p in radars(wanted).values() if p.frame is not None}
        self._shared = {name: view_of(sensors[name]) for name in sorted(read)}

    def make(self, name: str, parts: Mapping[str, Any] | None = None) -> Any:
        """The sensor of that name. `parts`: parameters in place of the bench's own, such as fewer channels.

        Raises what `sim.sensors.catalog.make_sensor` does.
        """
        config = self._bench.config
        sensor = config.sensors[name]
        made = make_sensor(
            name,
            kind=sensor.kind,
            rate_hz=sensor.rate_hz,
            seed=config.seed,
            scene=self._bench.scene,
            step_ns=config.tick_ns,
            overrides=self._bench.sensor_parameters(name).model_dump() | dict(parts or {}),
            frames=self._frames,
            shared=self._shared.get(getattr(sensor.parameters, "frame", None) or name),
        )
        if isinstance(made, Radar):
            made.view.add_reader(made.channels, partial(is_due, **tick_rates(sensor, config.tick_hz)))
        return made


def tick_rates(sensor: SensorConfig, tick_hz: int) -> dict[str, int]:
    """How often a sensor is due and how often there are ticks [mHz], as `is_due` and `RateAccumulator` take them."""
    return {"event_mhz": round(sensor.rate_hz * 1000), "tick_mhz": tick_hz * 1000}
