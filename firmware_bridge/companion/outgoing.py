"""Prepares a frame for sending: lays its arrays out in one block and packs the headers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import zmq

from firmware_bridge.codecs.companion import pack
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame
from firmware_bridge.companion.shared_ring import Block

_KINDS = "?biufc"
_SENT_UNCHANGED = frozenset(np.dtype(t) for t in ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8"))


class Outgoing:
    """One frame. Parts of it that several clients get are made once."""

    def __init__(self, frame: CompanionFrame) -> None:
        """Raise CodecError for arrays that cannot be sent."""
        self.frame = frame
        self.topics = frozenset(s.topic for s in frame.samples)
        self._arrays = [
            [(name, _plain(sample.topic, name, a)) for name, a in sample.arrays.items()] for sample in frame.samples
        ]
        self._blocks: dict[frozenset[str], tuple[Block, dict[str, dict[str, Any]]]] = {}
        self._bodies: dict[frozenset[str], list[zmq.Frame]] = {}

    def block(self, topics: frozenset[str]) -> Block:
        """Return the arrays of these topics; they are views of the frame's arrays."""
        return self._laid_out(topics)[0]

    def body(self, topics: frozenset[str]) -> list[zmq.Frame]:
        """Return the arrays of these topics as one part of a message; an empty list if there are none.

        ZeroMQ sends a part of one megabyte in half the time of ten parts of a tenth. Sending without a copy is slower:
        pyzmq learns through a thread when ZeroMQ has finished with the memory.
        """
        body = self._bodies.get(topics)
        if body is None:
            block = self.block(topics)
            data = np.empty(block.size, np.uint8)
            block.copy_to(data.data)
            body = self._bodies[topics] = [zmq.Frame(data, copy=True)] if block.size else []
        return body

    def header(
        self,
        topics: frozenset[str],
        block_topics: frozenset[str],
        *,
        t_sent_ns: int,
        dropped: int,
        release: int | None = None,
        ports_of_frame: Sequence[str] | None = None,
    ) -> bytes:
        """Return the header for a client of these topics.

        The arrays lie in the block of `block_topics`, which several clients share. `release`: offset of that block in
        the shared memory.
        """
        f, samples = self.frame, self._laid_out(block_topics)[1]
        head: dict[str, Any] = {"k": "frame", "frame": f.frame, "tick": f.tick, "t_ns": f.t_ns}
        head |= {"t_sent_ns": t_sent_ns, "dropped": dropped}
        head["samples"] = [sample for topic, sample in samples.items() if topic in topics]
        if release is not None:
            head["release"] = release
        if ports_of_frame is not None:
            head["ports_of_frame"] = ports_of_frame
        return pack(head)

    def array_bytes(self, topics: frozenset[str]) -> int:
        """Return the size of the arrays of these topics [bytes]."""
        return sum(a.nbytes for i, s in enumerate(self.frame.samples) if s.topic in topics for _, a in self._arrays[i])

    def _laid_out(self, topics: frozenset[str]) -> tuple[Block, dict[str, dict[str, Any]]]:
        """Return the arrays of these topics, and the header's entry for each sample."""
        ready = self._blocks.get(topics)
        if ready is None:
            block, samples = ready = self._blocks[topics] = Block(), {}
            for sample, arrays in zip(self.frame.samples, self._arrays, strict=True):
                if sample.topic in topics:
                    samples[sample.topic] = {
                        "topic": sample.topic,
                        "seq": sample.seq,
                        "t_capture_ns": sample.t_capture_ns,
                        "t_available_ns": sample.t_available_ns,
                        "values": sample.values,
                        "arrays": [
                            {"name": name, "dtype": a.dtype.str, "shape": a.shape, "offset": block.add(a)}
                            for name, a in arrays
                        ],
                    }
        return ready


def _plain(topic: str, name: str, array: np.ndarray) -> np.ndarray:
    """Return the array in C order and little-endian, without a copy if it is so already."""
    if array.dtype in _SENT_UNCHANGED and array.flags.c_contiguous:
        return array
    if array.dtype.kind not in _KINDS:
        raise CodecError(f"{topic}.{name}: {array.dtype} cannot be sent; send each field as a plain numeric array")
    if array.dtype.str[0] == ">":
        array = array.astype(array.dtype.newbyteorder("<"))
    return np.ascontiguousarray(array)
