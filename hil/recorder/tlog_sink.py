"""Telemetry log as QGroundControl and MAVProxy write it: every frame behind a timestamp.

Each entry is the time as 8 bytes, big-endian, microseconds since the Unix epoch, then one raw frame, both
directions in the order in which they crossed the wire. The time is simulated time on a fixed epoch
(2020-01-01T00:00:00Z), so that the same run gives the same file, byte for byte. MAVProxy keeps a link number in the
two lowest bits of the time; here they are zero.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

from firmware_bridge.codecs.mavlink_frame import NO_FRAME
from hil.recorder.digest import RawFrame
from hil.recorder.mcap_file import SafeFile

EPOCH_US = 1_577_836_800_000_000
_FLUSH_BYTES = 32 * 1024
_STAMP = struct.Struct(">Q")


class TlogSink:
    """Writes the log in pieces of some 32 KiB, each a whole number of entries, and at least once per `flush`."""

    def __init__(self, file: SafeFile) -> None:
        self._file = file
        self._entries: list[bytes] = []
        self._tick = 0

    def sent(self, t_ns: int, pieces: Iterable[tuple[int, bytes]]) -> None:
        """Log what went to the autopilot; pieces that are no frame are left out, as the format cannot hold them."""
        stamp = _STAMP.pack(EPOCH_US + t_ns // 1000 & ~3)
        for msgid, raw in pieces:
            if msgid != NO_FRAME:
                self._entries += (stamp, raw)

    def received(self, t_ns: int, frames: Iterable[RawFrame]) -> None:
        """Log what came from the autopilot."""
        stamp = _STAMP.pack(EPOCH_US + t_ns // 1000 & ~3)
        for frame in frames:
            self._entries += (stamp, frame.raw)

    def flush(self, tick: int) -> None:
        """Put everything so far on disk. Raises RecordingError where that fails, once."""
        data = b"".join(self._entries)
        self._entries.clear()
        if data:
            self._file.write(data, tick)

    def close(self, tick: int, result: Mapping[str, str]) -> None:  # noqa: ARG002
        """Flush and close; the format has no room for the result."""
        try:
            self.flush(tick)
        finally:
            self._file.close()
