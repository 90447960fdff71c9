"""What every sensor is to the scheduler."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Protocol

from pydantic import Field

from hil.signals.samples import Sample, TruthState
from hil.signals.time import NS_PER_S
from sim.frame.shared_picture import SharedPicture
from sim.frame.source import FrameSource
from sim.scene.scene import Scene

_Offset = Annotated[float, Field(ge=-10.0, le=10.0)]
Position = tuple[_Offset, _Offset, _Offset]  # where a sensor sits, from the body origin, in B [m]


@dataclass(frozen=True)
class Installation:
    """How a sensor is built into a run."""

    name: str  # also keys its noise
    period_ns: int
    seed: int
    scene: Scene
    step_ns: int  # the physics tick
    frames: FrameSource | None = None  # the world to look at, for cameras, LiDARs and radars
    shared: SharedPicture | None = None  # of a camera: its pictures that others read; of a reader: those of its camera


class InstalledSensor:
    """What every kind of sensor has of a `Sensor`."""

    def __init__(self, installation: Installation, latency_s: float, resolution: Mapping[str, float]) -> None:
        self.name = installation.name
        self.period_ns = installation.period_ns
        self.latency_ns = round(latency_s * NS_PER_S)
        self.resolution = resolution


def check_order(low: tuple[str, float], high: tuple[str, float]) -> None:
    """ValueError unless the second of two parameters (name, value) is above the first."""
    if not high[1] > low[1]:
        raise ValueError(f"{high[0]} {high[1]:g} must be above {low[0]} {low[1]:g}")


class Sensor(Protocol):
    """Turns truth into samples.

    Noise of sample `seq` is a function of the seed, the sensor's name and `seq` alone, whatever was sampled before.
    Sensors that integrate (vibration phases, optical flow) also depend on the truths they were shown before.
    """

    name: str
    sample_type: type
    period_ns: int
    latency_ns: int
    resolution: Mapping[str, float]  # step of the output word of each field that has one, in the field's unit

    def sample(self, truth: TruthState, seq: int) -> Sample:
        """Sample number `seq`, captured at `truth.t_ns`, available `latency_ns` later."""
        ...
