"""Collects released samples between two frames and makes frames of them.

A frame has the newest sample of each camera, LiDAR and radar, all samples of the other sensors, and the present true
state. If a client does not get a frame, the samples of the other sensors in it go into its next frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from hil.run.sensors.frame_stages import TRUTH
from signals.samples import FRAME_SAMPLES, ImageSample, RadarSample, Sample, TruthState

_MAX_ROWS = 4096  # per topic and frame, the newest: the header of a frame is limited in size
_STAMPS = ("seq", "t_capture_ns", "t_available_ns")


@dataclass
class Bundle:
    """Samples of one frame by topic: `newest` of cameras, LiDARs and radars, `all` of the other sensors in order."""

    number: int
    tick: int
    t_ns: int
    newest: dict[str, CompanionSample] = field(default_factory=dict)
    all: dict[str, list[Sample]] = field(default_factory=dict)
    dropped: int = 0  # number of earlier frames that this one replaces

    def replacing(self, earlier: Bundle | None) -> Bundle:
        """Return this bundle merged with `earlier`, for a client that did not get `earlier`."""
        if earlier is None:
            return self
        merged = {
            topic: [*earlier.all.get(topic, ()), *self.all.get(topic, ())][-_MAX_ROWS:]
            for topic in (earlier.all | self.all)
        }
        newest = earlier.newest | self.newest
        return Bundle(self.number, self.tick, self.t_ns, newest, merged, earlier.dropped + 1)

    def frame(self, topics: Iterable[str]) -> CompanionFrame:
        """Return the frame for a client with these topics, its samples in alphabetical order of topic."""
        samples = []
        for topic in sorted(topics):
            if topic in self.newest:
                samples.append(self.newest[topic])
            elif self.all.get(topic):
                samples.append(_merged(topic, self.all[topic]))
        return CompanionFrame(self.number, self.tick, self.t_ns, tuple(samples))


class Collector:
    """Collects samples between frames. `topics`: of all clients together."""

    def __init__(self, topics: Iterable[str]) -> None:
        self._topics = frozenset(topics)
        self._newest: dict[str, CompanionSample] = {}
        self._all: dict[str, list[Sample]] = {}

    def add(self, released: Iterable[tuple[str, Sample]]) -> None:
        """Add the samples released by a tick."""
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
        """Return the samples added since the last call."""
        newest, samples = self._newest, self._all
        if TRUTH in self._topics:
            newest[TRUTH] = _truth(truth)
        self._newest, self._all = {}, {}
        return Bundle(number, truth.tick, truth.t_ns, newest, samples)


def _array_sample(topic: str, sample: Any, arrays: Mapping[str, np.ndarray]) -> CompanionSample:
    """Return a sample with arrays; its pose goes into the values."""
    values = {
        name: list(value)
        for name, value in zip(sample._fields, sample, strict=True)
        if name not in _STAMPS and isinstance(value, tuple)
    }
    return CompanionSample(topic, sample.seq, sample.t_capture_ns, sample.t_available_ns, values, dict(arrays))


def _columns(channel: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of a channel; records (points and tracks of a radar) as one array per field."""
    return {channel: array} if array.dtype.names is None else {name: array[name] for name in array.dtype.names}


def _arrays(sample: Any) -> dict[str, np.ndarray]:
    return {name: value for name, value in zip(sample._fields, sample, strict=True) if isinstance(value, np.ndarray)}


def _merged(topic: str, samples: list[Sample]) -> CompanionSample:
    """Return samples as one sample whose values are lists; sequence number and times are those of the last."""
    last = samples[-1]
    values = {name: [getattr(sample, name) for sample in samples] for name in last._fields}
    return CompanionSample(topic, last.seq, last.t_capture_ns, last.t_available_ns, values)


def _truth(truth: TruthState) -> CompanionSample:
    values = {name: value for name, value in zip(truth._fields, truth, strict=True) if name not in ("tick", "t_ns")}
    values = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    return CompanionSample(TRUTH, truth.tick, truth.t_ns, truth.t_ns, values)
