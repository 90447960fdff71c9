"""A frame made ready for the wire: arrays put together and headers packed, once per set of topics.

What a header says of a sample's arrays (names, types, shapes, places) seldom changes from frame to frame. It is packed
by itself, and kept: so both ends make and read it once, and know it again by its bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zmq

from firmware_bridge.codecs.companion_frame import pack_arrays, pack_samples
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.block import Block
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample

_PLAIN = "?biufc"
_AS_THEY_ARE = frozenset(np.dtype(t) for t in ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"))
_KEPT = 4096  # descriptions; those of clouds, whose sizes differ from turn to turn, come and go

Described = tuple[tuple[str, np.dtype[Any], tuple[int, ...], int], ...]  # name, type, shape, place of each array


class Packing:
    """What is kept from frame to frame: packed descriptions of arrays, and room to put arrays together."""

    def __init__(self) -> None:
        self._kept: dict[Described, bytes] = {}
        self._room = bytearray()

    def described(self, described: Described) -> bytes:
        """Packed."""
        found = self._kept.get(described)
        if found is None:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            arrays = [{"name": n, "dtype": t.str, "shape": list(s), "offset": at} for n, t, s, at in described]
            found = self._kept[described] = pack_arrays(arrays)
        return found

    def together(self, block: Block) -> zmq.Frame:
        """A block as one part of a message, with memory of its own.

        ZeroMQ sends a part of a megabyte in half the time of ten parts that make one, and tells by a thread of
        pyzmq's when it is done with memory that was lent to it, for each part, which costs more than copying.
        """
        if len(self._room) < block.size:
            self._room = bytearray(2 * block.size)
        view = memoryview(self._room)[: block.size]
        block.copy_to(view)
        return zmq.Frame(view, copy=True)


class Outgoing:
    """One frame. What goes to several clients is made once."""

    def __init__(self, frame: CompanionFrame, packing: Packing) -> None:
        self.frame = frame
        self._packing = packing
        self.topics = frozenset(s.topic for s in frame.samples)
        self._arrays = [
            [(name, _plain(sample.topic, name, a)) for name, a in sample.arrays.items()] for sample in frame.samples
        ]
        self._packed: dict[frozenset[str], tuple[bytes, Block]] = {}
        self._together: dict[frozenset[str], list[zmq.Frame]] = {}
        self._in_ring: dict[frozenset[str], tuple[int, int, int]] = {}

    def packed(self, topics: frozenset[str]) -> tuple[bytes, Block]:
        """Of these topics the samples, for the header, and the arrays behind it, good while the frame's are."""
        ready = self._packed.get(topics)
        if ready is None:
            block, headers = self._block(topics)
            ready = self._packed[topics] = pack_samples(list(headers.values())), block
        return ready

    def together(self, topics: frozenset[str]) -> list[zmq.Frame]:
        """The arrays of these topics as one part of a message, if there are any."""
        ready = self._together.get(topics)
        if ready is None:
            _, block = self.packed(topics)
            ready = self._together[topics] = [self._packing.together(block)] if block.size else []
        return ready

    def _block(self, topics: frozenset[str]) -> tuple[Block, dict[int, dict[str, Any]]]:
        """The arrays of these topics, and the headers of the samples by their index."""
        block = Block()
        headers: dict[int, dict[str, Any]] = {}
        for i, sample in enumerate(self.frame.samples):
            if sample.topic in topics:
                described = tuple([(n, a.dtype, a.shape, block.add(a)) for n, a in self._arrays[i]])
                headers[i] = _header(sample, self._packing.described(described))
        return block, headers

    def for_ring(self, wanted: Sequence[frozenset[str]]) -> Block:
        """What the ring has to hold for clients of these topics: the arrays, and a header for each set of topics."""
        topics = wanted[0] if len(wanted) == 1 else frozenset().union(*wanted)
        block, headers = self._block(topics)
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
