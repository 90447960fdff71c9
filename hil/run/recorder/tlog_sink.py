"""Telemetry log in the format of QGroundControl and MAVProxy: every frame follows a timestamp.

An entry is the time (8 bytes, big-endian, microseconds since the Unix epoch) and one raw frame; frames of both
directions are in the order of transmission. The time is simulated time from a fixed epoch (2020-01-01T00:00:00Z), so
equal runs write equal files, byte for byte. MAVProxy stores a link number in the two lowest bits of the time; here
they are zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np

from firmware_bridge.codecs.mavlink_frame import NO_FRAME, Frame
from hil.run.recorder.mcap.mcap_file import SafeFile

EPOCH_US = 1_577_836_800_000_000


class TlogSink:
    """Writes the log; every write is a whole number of entries."""

    def __init__(self, file: SafeFile) -> None:
        self._file = file
        self._entries: list[tuple[int, bytes]] = []  # time [ns] and frame, since the last flush
        self._tick = 0

    def sent(self, t_ns: int, pieces: Iterable[tuple[int, bytes]]) -> None:
        """Log frames sent to the autopilot. Bytes outside frames are left out: the format has no place for them."""
        for msgid, raw in pieces:
            if msgid != NO_FRAME:
                self._entries.append((t_ns, raw))

    def received(self, t_ns: int, frames: Iterable[Frame]) -> None:
        """Log frames received from the autopilot."""
        for frame in frames:
            self._entries.append((t_ns, frame.raw))

    def flush(self, tick: int) -> None:
        """Write everything so far to disk. Raises RecordingError at the first failure only."""
        if not self._entries:
            return
        times_ns, frames = zip(*self._entries, strict=True)
        self._entries.clear()
        stamps = (EPOCH_US + np.array(times_ns) // 1000 & ~3).astype(">u8").view("V8").tolist()
        self._file.write(b"".join(chain.from_iterable(zip(stamps, frames, strict=True))), tick)

    def close(self, tick: int) -> None:
        """Flush and close."""
        try:
            self.flush(tick)
        finally:
            self._file.close()
