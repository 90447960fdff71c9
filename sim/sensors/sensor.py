"""What every sensor is to the scheduler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hil.signals.samples import Sample, TruthState
from sim.scene.scene import Scene


@dataclass(frozen=True)
class Installation:
    """How a sensor is built into a run."""

    name: str  # also keys its noise
    period_ns: int
    seed: int
    scene: Scene
    step_ns: int  # the physics tick


class Sensor(Protocol):
    """Turns truth into samples. Sample `seq` is a pure function of the truth given, the seed and the sensor's name."""

    name: str
    sample_type: type
    period_ns: int
    latency_ns: int

    def sample(self, truth: TruthState, seq: int) -> Sample:
        """Sample number `seq`, captured at `truth.t_ns`, available `latency_ns` later."""
        ...
