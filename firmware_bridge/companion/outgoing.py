"""A frame made ready for the wire: arrays put together and headers packed, once for each set of topics.

What a header says of a sample's arrays (names, types, shapes, places) seldom changes from frame to frame. It is packed
by itself, and kept: so both ends make and read it once, and know it again by its bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zmq

from firmware_bridge.codecs.companion import pack
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame, CompanionSample
from firmware_bridge.companion.shared_ring import Block

_PLAIN = "?biufc"
_AS_THEY_ARE = frozenset(np.dtype(t) for t in ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"))
_SAMPLES_KEY = pack("samples")
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
            found = self._kept[described] = pack(arrays)
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
        """CodecError for arrays that cannot be sent."""
        self.frame = frame
        self._packing = packing
        self.topics = frozenset(s.topic for s in frame.samples)
        self._arrays = [
            [(name, _plain(sample.topic, name, a)) for name, a in sample.arrays.items()] for sample in frame.samples
        ]
        self._blocks: dict[frozenset[str], tuple[Block, dict[int, dict[str, Any]]]] = {}
        self._samples: dict[tuple[frozenset[str], frozenset[str]], bytes] = {}
        self._bodies: dict[frozenset[str], list[zmq.Frame]] = {}

    def block(self, topics: frozenset[str]) -> Block:
        """The arrays of these topics, good while the frame's are."""
        return self._described(topics)[0]

    def body(self, topics: frozenset[str]) -> list[zmq.Frame]:
        """The same as one part of a message, if there are any."""
        ready = self._bodies.get(topics)
        if ready is None:
            block = self.block(topics)
            ready = self._bodies[topics] = [self._packing.together(block)] if block.size else []
        return ready

    def header(
        self,
        topics: frozenset[str],
        within: frozenset[str],
        *,
        t_sent_ns: int,
        dropped: int,
        release: int | None = None,
        ports_of_frame: Sequence[str] | None = None,
    ) -> bytes:
        """For a client of these topics, whose arrays lie in the block of `within`: that of several clients, from
        `release` on in the shared memory. A map is its entries one behind the other, so that what several clients
        share is packed once."""
        f = self.frame
        head: dict[str, Any] = {"k": "frame", "frame": f.frame, "tick": f.tick, "t_ns": f.t_ns}
        head |= {"t_sent_ns": t_sent_ns, "dropped": dropped}
        if release is not None:
            head["release"] = release
        if ports_of_frame is not None:
            head["ports_of_frame"] = ports_of_frame
        first = pack(head)
        # Fewer than 16 entries: the number of entries is the low half of the first byte.
        return bytes((first[0] + 1,)) + first[1:] + _SAMPLES_KEY + self._packed(topics, within)

    def array_bytes(self, topics: frozenset[str]) -> int:
        """Of the arrays of these topics."""
        return sum(a.nbytes for i, s in enumerate(self.frame.samples) if s.topic in topics for _, a in self._arrays[i])

    def _packed(self, topics: frozenset[str], within: frozenset[str]) -> bytes:
        """The samples of these topics."""
        packed = self._samples.get((topics, within))
        if packed is None:
            samples, headers = self.frame.samples, self._described(within)[1]
            packed = pack([header for i, header in headers.items() if samples[i].topic in topics])
            self._samples[topics, within] = packed
        return packed

    def _described(self, topics: frozenset[str]) -> tuple[Block, dict[int, dict[str, Any]]]:
        """The arrays of these topics, and the headers of the samples by their index."""
        ready = self._blocks.get(topics)
        if ready is None:
            block, headers = ready = self._blocks[topics] = Block(), {}
            for i, sample in enumerate(self.frame.samples):
                if sample.topic in topics:
                    described = tuple([(n, a.dtype, a.shape, block.add(a)) for n, a in self._arrays[i]])
                    headers[i] = _header(sample, self._packing.described(described))
        return ready


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
