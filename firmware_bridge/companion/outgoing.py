"""A frame made ready for the wire: each array wrapped once, each header packed once per set of topics."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import zmq

from firmware_bridge.codecs.companion import pack_samples
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample

_PLAIN = "?biufc"


class Outgoing:
    """One frame. Parts are shared by all clients: ZeroMQ counts who still needs them, nothing is copied."""

    def __init__(self, frame: CompanionFrame) -> None:
        self.frame = frame
        self.topics = frozenset(s.topic for s in frame.samples)
        self._arrays = [
            [(name, _plain(sample.topic, name, a)) for name, a in sample.arrays.items()] for sample in frame.samples
        ]
        self._parts: dict[tuple[int, int], zmq.Frame] = {}
        self._packed: dict[frozenset[str], tuple[bytes, list[zmq.Frame], int]] = {}
        self._in_ring: dict[frozenset[str], tuple[bytes, int]] = {}
        self._offsets: dict[tuple[int, int], int] = {}

    def on_wire(self, topics: frozenset[str]) -> tuple[bytes, list[zmq.Frame], int]:
        """Packed samples of these topics, the parts behind the header, bytes of all parts."""
        ready = self._packed.get(topics)
        if ready is None:
            parts: list[zmq.Frame] = []
            samples = []
            for i, sample in enumerate(self.frame.samples):
                if sample.topic in topics:
                    described = []
                    for j, (name, array) in enumerate(self._arrays[i]):
                        parts.append(self._part(i, j))
                        described.append(_described(name, array) | {"part": len(parts)})
                    samples.append(_header(sample, described))
            ready = pack_samples(samples), parts, sum(len(p) for p in parts)
            self._packed[topics] = ready
        return ready

    def arrays_of(self, topics: Iterable[str]) -> list[np.ndarray]:
        """What the ring has to hold for clients of these topics; their places go to `placed`."""
        wanted = set(topics)
        self._order = [
            (i, j)
            for i, sample in enumerate(self.frame.samples)
            if sample.topic in wanted
            for j in range(len(self._arrays[i]))
        ]
        return [self._arrays[i][j][1] for i, j in self._order]

    def placed(self, offsets: list[int]) -> None:
        self._offsets = dict(zip(self._order, offsets, strict=True))
        self._in_ring.clear()

    def in_ring(self, topics: frozenset[str]) -> tuple[bytes, int]:
        """Packed samples of these topics with their places in the ring, bytes of the arrays."""
        ready = self._in_ring.get(topics)
        if ready is None:
            samples, size = [], 0
            for i, sample in enumerate(self.frame.samples):
                if sample.topic in topics:
                    described = []
                    for j, (name, array) in enumerate(self._arrays[i]):
                        described.append(_described(name, array) | {"slot_offset": self._offsets[i, j]})
                        size += array.nbytes
                    samples.append(_header(sample, described))
            ready = pack_samples(samples), size
            self._in_ring[topics] = ready
        return ready

    def _part(self, i: int, j: int) -> zmq.Frame:
        part = self._parts.get((i, j))
        if part is None:
            array = self._arrays[i][j][1]
            part = zmq.Frame(array.reshape(-1).view(np.uint8).data if array.nbytes else b"", copy=None)
            self._parts[i, j] = part
        return part


def _header(sample: CompanionSample, arrays: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "topic": sample.topic,
        "seq": sample.seq,
        "t_capture_ns": sample.t_capture_ns,
        "t_available_ns": sample.t_available_ns,
        "values": sample.values,
        "arrays": arrays,
    }


def _described(name: str, array: np.ndarray) -> dict[str, Any]:
    return {"name": name, "dtype": array.dtype.str, "shape": list(array.shape)}


def _plain(topic: str, name: str, array: np.ndarray) -> np.ndarray:
    """In C order and little-endian; as it is if it is so already."""
    if array.dtype.kind not in _PLAIN:
        raise CodecError(f"{topic}.{name}: {array.dtype} cannot be sent; make plain columns of it")
    if array.dtype.str[0] == ">":
        array = array.astype(array.dtype.newbyteorder("<"))
    return np.ascontiguousarray(array)
