"""Recorder that keeps nothing, for flights without a result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from firmware_bridge.codecs.mavlink_frame import Frame
from hil.run.recorder.recorder import Recorder
from signals.samples import ActuatorFrame, Sample, TruthState


class NoRecorder(Recorder):
    """Recorder that discards every tick."""

    def __init__(self, tick_ns: int) -> None:
        super().__init__(Path(), mcap=False, tlog=False, tick_ns=tick_ns)

    def truth(self, truth: TruthState) -> None:
        """Discard a true state."""

    def sample(self, port: str, sample: Sample) -> None:
        """Discard a sample."""

    def sent(self, tick: int, t_ns: int, data: bytes) -> None:
        """Discard messages to the autopilot."""

    def received(self, tick: int, t_ns: int, frames: Sequence[Frame]) -> None:
        """Discard messages from the autopilot."""

    def actuators(self, frame: ActuatorFrame) -> None:
        """Discard actuator commands."""

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Discard an event."""
