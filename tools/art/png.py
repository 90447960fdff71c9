"""Pixels of textures, and what their PNG files contain."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SIGNATURE_BYTES = 8


def quantised(image: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Return a picture (3 or 4, H, W) of 32-bit floats on [0, 1] as pixels (H, W, 3 or 4)."""
    scaled = image * np.float32(255.0)
    scaled += np.float32(0.5)
    return np.clip(scaled, 0.0, 255.0).astype(np.uint8).transpose(1, 2, 0)


def contents(data: bytes) -> tuple[bytes, bytes]:
    """Return header and rows of a PNG file: zlib's versions differ in how they compress these."""
    header, at, rows = b"", _SIGNATURE_BYTES, b""
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        header, rows = (body, rows) if kind == b"IHDR" else (header, rows + body if kind == b"IDAT" else rows)
        at += 12 + size
    return header, zlib.decompress(rows)
