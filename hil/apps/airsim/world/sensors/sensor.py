"""Interface of one sensor, and what all sensors of a vehicle measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from signals.samples import TruthState, Vec3
from sim.frame.source import SharedFrames
from sim.scene.scene import Scene, Site
from sim.sensors.ground_range import Rays


@dataclass(frozen=True)
class Measured:
    """All that the sensors of one vehicle measure."""

    vehicle: str
    scene: Callable[[], Scene]  # in the present weather: another object after it changed
    site: Site  # of the origin of the vehicle's positions
    rays: Rays  # into the scene without vehicles
    altitude_m: Callable[[Vec3], float]  # of a point of W
    seen_at: Callable[[int], SharedFrames]  # by the vehicle at a time [ns]
    tick_ns: int

    def stream(self, sensor: str) -> str:
        """Return the name of a sensor's noise."""
        return f"{self.vehicle}.{sensor}"


class Sensor(Protocol):
    """One sensor of a vehicle."""

    rate_hz: float
    latency_s: float

    def sample(self, seq: int, truth: TruthState) -> Any:
        """Return the value of sample `seq`, from the state that it measures."""
        ...
