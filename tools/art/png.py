"""Writer of textures: PNG without filters, which MuJoCo reads as fast compressed as not."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return pixels (H, W, 3 or 4), red first, as PNG."""
    height, width, channels = pixels.shape
    rows = np.zeros((height, 1 + width * channels), np.uint8)  # each begins with the number of its filter, 0: none
    rows[:, 1:] = pixels.reshape(height, -1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))

    header = struct.pack(">IIBBBBB", width, height, 8, 6 if channels == 4 else 2, 0, 0, 0)
    body = zlib.compress(rows.tobytes(), 9)
    return _SIGNATURE + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def quantised(image: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Return a picture (3 or 4, H, W) of 32-bit floats on [0, 1] as pixels (H, W, 3 or 4)."""
    scaled = image * np.float32(255.0)
    scaled += np.float32(0.5)
    return np.clip(scaled, 0.0, 255.0).astype(np.uint8).transpose(1, 2, 0)


def contents(data: bytes) -> tuple[bytes, bytes]:
    """Return header and rows of a file of `png`: zlib's versions differ in how they compress these."""
    header, at, rows = b"", len(_SIGNATURE), b""
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        header, rows = (body, rows) if kind == b"IHDR" else (header, rows + body if kind == b"IDAT" else rows)
        at += 12 + size
    return header, zlib.decompress(rows)
