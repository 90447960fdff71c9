"""A frame made ready for the wire: each array wrapped once, each header packed once per set of topics.

What a header says of a sample's arrays (names, types, shapes, places) seldom changes from frame to frame. It is packed
by itself, and kept: so both ends make and read it once, and know it again by its bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zmq

from firmware_bridge.codecs.companion import pack_arrays, pack_samples
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from firmware_bridge.companion.shared_ring import Block

_PLAIN = "?biufc"
_AS_THEY_ARE = frozenset(np.dtype(t) for t in ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"))
_KEPT = 4096  # descriptions; those of clouds, whose sizes differ from turn to turn, come and go

Described = tuple[tuple[str, np.dtype[Any], tuple[int, ...], int], ...]  # name, type, shape, place of each array


class Descriptions:
    """Packed descriptions of arrays, kept from frame to frame."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, Described], bytes] = {}

    def packed(self, place: str, described: Described) -> bytes:
        """`place`: what the last of each is called there."""
        found = self._kept.get((place, described))
        if found is None:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            arrays = [{"name": n, "dtype": t.str, "shape": list(s), place: at} for n, t, s, at in described]
            found = self._kept[place, described] = pack_arrays(arrays)
        return found


class Outgoing:
    """One frame. Parts are shared by all clients: ZeroMQ counts who still needs them, nothing is copied."""

    def __init__(self, frame: CompanionFrame, descriptions: Descriptions) -> None:
        self.frame = frame
        self._descriptions = descriptions
        self.topics = frozenset(s.topic for s in frame.samples)
        self._arrays = [
            [(name, _plain(sample.topic, name, a)) for name, a in sample.arrays.items()] for sample in frame.samples
        ]
        self._parts: dict[tuple[int, int], zmq.Frame] = {}
        self._packed: dict[frozenset[str], tuple[bytes, list[zmq.Frame], int]] = {}
        self._in_ring: dict[frozenset[str], tuple[int, int, int]] = {}

    def on_wire(self, topics: frozenset[str]) -> tuple[bytes, list[zmq.Frame], int]:
        """Packed samples of these topics, the parts behind the header, bytes of all parts."""
        ready = self._packed.get(topics)
        if ready is None:
            parts: list[zmq.Frame] = []
            samples = []
            for i, sample in enumerate(self.frame.samples):
                if sample.topic in topics:
                    named = self._arrays[i]
                    described = [(n, a.dtype, a.shape, len(parts) + j) for j, (n, a) in enumerate(named, start=1)]
                    parts += [self._part(i, j) for j in range(len(named))]
                    samples.append(_header(sample, self._descriptions.packed("part", tuple(described))))
            ready = pack_samples(samples), parts, sum(len(p) for p in parts)
            self._packed[topics] = ready
        return ready

    def for_ring(self, wanted: Sequence[frozenset[str]]) -> Block:
        """What the ring has to hold for clients of these topics: the arrays, and a header for each set of topics."""
        topics = wanted[0] if len(wanted) == 1 else frozenset().union(*wanted)
        block = Block()
        headers: dict[int, dict[str, Any]] = {}
        for i, sample in enumerate(self.frame.samples):
            if sample.topic in topics:
                described = tuple([(n, a.dtype, a.shape, block.add(a)) for n, a in self._arrays[i]])
                headers[i] = _header(sample, self._descriptions.packed("offset", described))
        for mine in wanted:
            if mine not in self._in_ring:
                chosen = [i for i in headers if self.frame.samples[i].topic in mine]
                size = sum([array.nbytes for i in chosen for _, array in self._arrays[i]])
                packed = np.frombuffer(pack_samples([headers[i] for i in chosen]), np.uint8)
                self._in_ring[mine] = (block.add(packed), packed.nbytes, size)
        return block

    def in_ring(self, topics: frozenset[str]) -> tuple[int, int, int]:
        """Of the header of these topics: where it lies, counted from the slot, its bytes, and those of its arrays."""
        return self._in_ring[topics]

    def _part(self, i: int, j: int) -> zmq.Frame:
        part = self._parts.get((i, j))
        if part is None:
            array = self._arrays[i][j][1]
            part = zmq.Frame(array.reshape(-1).view(np.uint8).data if array.nbytes else b"", copy=None)
            self._parts[i, j] = part
        return part


def _header(sample: CompanionSample, arrays: bytes) -> dict[str, Any]:
    return {
        "topic": sample.topic,
        "seq": sample.seq,
        "t_capture_ns": sample.t_capture_ns,
        "t_available_ns": sample.t_available_ns,
        "values": sample.values,
        "arrays": arrays,
    }


def _plain(topic: str, name: str, array: np.ndarray) -> np.ndarray:
    """In C order and little-endian; as it is if it is so already."""
    if array.dtype in _AS_THEY_ARE and array.flags.c_contiguous:
        return array
    if array.dtype.kind not in _PLAIN:
        raise CodecError(f"{topic}.{name}: {array.dtype} cannot be sent; make plain columns of it")
    if array.dtype.str[0] == ">":
        array = array.astype(array.dtype.newbyteorder("<"))
    return np.ascontiguousarray(array)
