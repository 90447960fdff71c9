"""What was released since the last frame, and the frame that is made of it.

Of cameras, LiDARs and radars a frame holds the newest sample, of the other sensors all of them, of the true state the
present one. A frame that a client never got leaves it the other sensors' samples: those go with the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from hil.frame_stages import TRUTH
from hil.signals.samples import FRAME_SAMPLES, ImageSample, RadarSample, Sample, TruthState

_MOST_ROWS = 4096  # of a topic in one frame, the newest: what goes with a frame's header has a limit
_STAMPS = ("seq", "t_capture_ns", "t_available_ns")


@dataclass
class Bundle:
    """Samples by topic, those of slow data in their order."""

    number: int
    tick: int
    t_ns: int
    newest: dict[str, CompanionSample] = field(default_factory=dict)
    all: dict[str, list[Sample]] = field(default_factory=dict)
    dropped: int = 0  # frames that this one stands for besides its own

    def over(self, earlier: Bundle | None) -> Bundle:
        """This one for somebody who did not get `earlier`."""
        if earlier is None:
            return self
        merged = {
            topic: [*earlier.all.get(topic, ()), *self.all.get(topic, ())][-_MOST_ROWS:]
            for topic in (earlier.all | self.all)
        }
        newest = earlier.newest | self.newest
        return Bundle(self.number, self.tick, self.t_ns, newest, merged, earlier.dropped + 1)

    def frame(self, topics: Iterable[str]) -> CompanionFrame:
        """For a client of these topics, in their order."""
        samples = []
        for topic in sorted(topics):
            if topic in self.newest:
                samples.append(self.newest[topic])
            elif self.all.get(topic):
                samples.append(_stacked(topic, self.all[topic]))
        return CompanionFrame(self.number, self.tick, self.t_ns, tuple(samples))


class Collector:
    """Gathers samples between frames. `topics`: what anybody wants."""

    def __init__(self, topics: Iterable[str]) -> None:
        self._topics = frozenset(topics)
        self._newest: dict[str, CompanionSample] = {}
        self._all: dict[str, list[Sample]] = {}

    def add(self, released: Iterable[tuple[str, Sample]]) -> None:
        """What a tick released."""
        topics = self._topics
        for port, sample in released:
            if isinstance(sample, ImageSample | RadarSample):
                for channel, array in sample.channels.items():
                    if f"{port}/{channel}" in topics:
                        topic = f"{port}/{channel}"
                        self._newest[topic] = _array_sample(topic, sample, _columns(channel, array))
            elif port not in topics:
                continue
            elif isinstance(sample, FRAME_SAMPLES):
                self._newest[port] = _array_sample(port, sample, _arrays(sample))
            else:
                self._all.setdefault(port, []).append(sample)

    def take(self, number: int, truth: TruthState) -> Bundle:
        """Everything since the last call."""
        newest, samples = self._newest, self._all
        if TRUTH in self._topics:
            newest[TRUTH] = _truth(truth)
        self._newest, self._all = {}, {}
        return Bundle(number, truth.tick, truth.t_ns, newest, samples)


def _array_sample(topic: str, sample: Any, arrays: Mapping[str, np.ndarray]) -> CompanionSample:
    """A frame: its pose as values."""
    values = {
        name: list(value)
        for name, value in zip(sample._fields, sample, strict=True)
        if name not in _STAMPS and isinstance(value, tuple)
    }
    return CompanionSample(topic, sample.seq, sample.t_capture_ns, sample.t_available_ns, values, dict(arrays))


def _columns(channel: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """Points and tracks of a radar are records: on the wire a column each."""
    return {channel: array} if array.dtype.names is None else {name: array[name] for name in array.dtype.names}


def _arrays(sample: Any) -> dict[str, np.ndarray]:
    return {name: value for name, value in zip(sample._fields, sample, strict=True) if isinstance(value, np.ndarray)}


def _stacked(topic: str, samples: list[Sample]) -> CompanionSample:
    """Row by row; the stamps of the sample as a whole are the last row's."""
    last = samples[-1]
    values = {name: [getattr(sample, name) for sample in samples] for name in last._fields}
    return CompanionSample(topic, last.seq, last.t_capture_ns, last.t_available_ns, values)


def _truth(truth: TruthState) -> CompanionSample:
    values = {name: value for name, value in zip(truth._fields, truth, strict=True) if name not in ("tick", "t_ns")}
    values = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    return CompanionSample(TRUTH, truth.tick, truth.t_ns, truth.t_ns, values)
