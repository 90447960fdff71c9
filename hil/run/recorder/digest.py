"""The digest of a run: one BLAKE2b hash over the true states and all messages, in order.

Every item is hashed as tag (one byte), length (uint32, little-endian) and bytes:

    "T"  truth, `TruthState` packed little-endian without padding: tick uint64, time int64 [ns], then doubles p_WB,
         q_WB (w-x-y-z), v_WB_W, w_WB_B, a_WB_W, alpha_WB_B, number of rotors as uint32, rotor speeds as doubles,
         contact as uint8, and the deflections of control surfaces as doubles, if there are any
    "S"  the bytes sent to the autopilot in one tick
    "R"  one frame received from the autopilot
    "F"  one picture or point cloud released: port, sequence, times [ns] as int64, pose as seven doubles (position,
         w-x-y-z), then each array (channels sorted by name): name, element type, shape, bytes. Texts end with a zero
         byte, a shape is the number of dimensions and the lengths as uint32

Frames are in the digest if they were computed, that is, if they had a consumer. Nothing else is hashed: neither the
choice of sinks, nor the wall clock, nor file names. Two runs with the same digest had the same true states, the same
sensor messages and the same answers of the autopilot, bit for bit.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable

import numpy as np

from firmware_bridge.codecs.mavlink_frame import Frame
from signals.samples import FrameSample, TruthState, arrays_of

_HEAD = struct.Struct("<cI")
_FRAME = struct.Struct("<3q7d")
_HASH_BYTES = 32


class Digest:
    """Computes the digest while the run goes on."""

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=_HASH_BYTES)
        self._pending: list[bytes] = []
        self._layout = self._layout_for(0, 0)
        self._counts = (0, 0)

    @staticmethod
    def _layout_for(rotors: int, surfaces: int) -> struct.Struct:
        body = f"Qq19dI{rotors}dB"
        return struct.Struct("<cI" + body + (f"{surfaces}d" if surfaces else ""))

    def truth(self, truth: TruthState) -> None:
        """Hash the true state, which begins a tick."""
        tick, t_ns, p_WB, q_WB, v_WB_W, w_WB_B, a_WB_W, alpha_WB_B, rotors, in_contact, surfaces = truth
        n = len(rotors)
        counts = (n, len(surfaces))
        if counts != self._counts:
            self._counts, self._layout = counts, self._layout_for(*counts)
        layout = self._layout
        self._pending.append(
            layout.pack(
                b"T",
                layout.size - 5,
                tick,
                t_ns,
                *p_WB,
                *q_WB,
                *v_WB_W,
                *w_WB_B,
                *a_WB_W,
                *alpha_WB_B,
                n,
                *rotors,
                in_contact,
                *surfaces,
            )
        )

    def sent(self, data: bytes) -> None:
        """Hash the bytes sent in one tick."""
        self._pending += (_HEAD.pack(b"S", len(data)), data)

    def received(self, frames: Iterable[Frame]) -> None:
        """Hash the frames received in one tick."""
        parts = self._pending
        for frame in frames:
            raw = frame.raw
            parts += (_HEAD.pack(b"R", len(raw)), raw)

    def frame(self, port: str, sample: FrameSample) -> None:
        """Hash one released picture, point cloud or radar frame."""
        seq, t_capture_ns, t_available_ns, p, q = sample[:5]
        heads = [port.encode() + b"\0" + _FRAME.pack(seq, t_capture_ns, t_available_ns, *p, *q)]
        arrays = []
        for name, array in arrays_of(sample):
            shape = struct.pack(f"<{1 + array.ndim}I", array.ndim, *array.shape)
            heads.append(f"{name}\0{array.dtype.str}\0".encode() + shape)
            arrays.append(array)
        self._pending += (_HEAD.pack(b"F", sum(map(len, heads)) + sum(a.nbytes for a in arrays)), heads[0])
        self.update()
        for head, array in zip(heads[1:], arrays, strict=True):
            self._hash.update(head)
            self._hash.update(np.ascontiguousarray(array).data)

    def hexdigest(self) -> str:
        """Return the digest of everything so far, 64 hexadecimal digits."""
        self.update()
        return self._hash.hexdigest()

    def update(self) -> None:
        """Hash what waits in memory; call it now and then."""
        if self._pending:
            self._hash.update(b"".join(self._pending))
            self._pending.clear()
