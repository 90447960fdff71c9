"""FMCW radars on the vehicles. AirSim has none: they come from the bench file, not from settings.json."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hil.apps.airsim.world.frames import Frames
from hil.apps.airsim.world.past import Past
from hil.config import Bench
from hil.run.sensors.simulated_sensors import SimulatedSensors
from signals.samples import RadarSample
from signals.time import period_ns_from_hz
from sim.scene.scene import Scene

_OUTPUTS = ("raw", "points")


class Radars:
    """Radars of all vehicles: each vehicle has all radars of the bench."""

    def __init__(self, bench: Bench, frames: Frames, scene: Callable[[], Scene]) -> None:
        """`scene` returns the scene in the present weather."""
        self._bench, self._frames, self._scene = bench, frames, scene
        self.names = [name for name, sensor in bench.config.sensors.items() if sensor.kind == "radar"]
        self._made: dict[tuple[str, str], tuple[Any, float, Any]] = {}  # with source and rain that it was made for
        self._last: dict[tuple[str, str], RadarSample] = {}

    def forget(self, vehicle: str) -> None:
        """Forget the frames of a vehicle that was put elsewhere."""
        for name in self.names:
            self._last.pop((vehicle, name), None)

    def frame(self, vehicle: str, name: str, past: Past) -> RadarSample:
        """Return the frame that is valid now, of its own time. `past`: the states of the vehicle."""
        key, period_ns = (vehicle, name), period_ns_from_hz(self._bench.config.sensors[name].rate_hz)
        seq = past.now.t_ns // period_ns
        if key not in self._last or self._last[key].seq != seq:
            truth = past.at(seq * period_ns)
            source = self._frames.seen_by(vehicle, truth.t_ns)
            rain_mm_per_h = self._bench.config.sensors[name].parameters.rain_mm_per_h
            if rain_mm_per_h is None:
                rain_mm_per_h = self._scene().weather.rain_mm_per_h
            if key not in self._made or self._made[key][0] is not source or self._made[key][1] != rain_mm_per_h:
                parts = {"outputs": _OUTPUTS, "rain_mm_per_h": rain_mm_per_h}
                sensor = SimulatedSensors(self._bench, [name], source).make(name, parts)
                self._made[key] = (source, rain_mm_per_h, sensor)
            self._last[key] = self._made[key][2].sample(truth, seq)
        return self._last[key]
