"""Headers of frames of the companion link, packed in pieces: what several clients share is packed once. No I/O."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgpack


def pack_samples(samples: Sequence[Mapping[str, Any]]) -> bytes:
    """The `samples` of a frame header, which several clients may share (see `encode_frame`)."""
    return _pack(samples)


def pack_arrays(arrays: Sequence[Mapping[str, Any]]) -> bytes:
    """What a sample says of its arrays: bytes in the header, known again as a whole."""
    return _pack(arrays)


def encode_frame_in_ring(
    frame: int,
    tick: int,
    t_ns: int,
    *,
    t_sent_ns: int,
    dropped: int,
    release: int,
    samples_at: tuple[int, int],
) -> bytes:
    """A frame in shared memory: from `release` on; `samples_at`: the samples, from there on, and their bytes."""
    head = _frame_head(frame, tick, t_ns, t_sent_ns, dropped)
    return _pack(head | {"release": release, "samples_at": samples_at})


def encode_frame(
    frame: int,
    tick: int,
    t_ns: int,
    *,
    t_sent_ns: int,
    dropped: int,
    samples: bytes,
    ports_of_frame: Sequence[str] | None = None,
) -> bytes:
    """The header of a frame, round `samples` packed before. A map is its entries one behind the other."""
    head = _frame_head(frame, tick, t_ns, t_sent_ns, dropped)
    if ports_of_frame is not None:
        head["ports_of_frame"] = list(ports_of_frame)
    body = _pack(head)
    # Fewer than 16 entries: the number of entries is the low half of the first byte.
    return bytes((body[0] + 1,)) + body[1:] + _SAMPLES_KEY + samples


def _frame_head(frame: int, tick: int, t_ns: int, t_sent_ns: int, dropped: int) -> dict[str, Any]:
    """What every frame says of itself, on whichever way it goes."""
    return {"k": "frame", "frame": frame, "tick": tick, "t_ns": t_ns, "t_sent_ns": t_sent_ns, "dropped": dropped}


def _pack(message: object) -> bytes:
    return msgpack.packb(message, use_bin_type=True)


_SAMPLES_KEY = _pack("samples")
