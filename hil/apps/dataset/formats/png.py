"""PNG encoder (W3C, Portable Network Graphics, third edition) that writes no time stamps and no text.

Data are compressed by ISA-L at level 1, the fastest of the libraries measured on this bench's pictures. A file's bytes
may change with the library's version and the processor; its pixels do not.
"""

from __future__ import annotations

import struct

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _RGB, _INDEXED = 0, 2, 3  # colour types
_MAX_BYTES = 1 << 27


def encode_png(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], *, sub: bool = False, palette: NDArray[np.uint8] | None = None
) -> bytes:
    """Return the PNG file of `pixels`, uint8 or uint16, (height, width) grey or (height, width, 3) RGB.

    `sub` applies the Sub filter (differences to the pixel on the left), which compresses noisy pictures better.
    `palette`, (1 to 256, 3) uint8 sRGB, makes an indexed picture of (height, width) uint8. Raises ValueError for any
    other type, shape or value.
    """
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a PNG holds uint8 or uint16, not {pixels.dtype}")
    if pixels.ndim != 2 and not (pixels.ndim == 3 and pixels.shape[2] == 3):
        raise ValueError(f"a PNG's pixels are (height, width) or (height, width, 3), not {pixels.shape}")
    if pixels.size == 0:
        raise ValueError("the picture is empty")
    if pixels.nbytes > _MAX_BYTES:
        raise ValueError("the picture is too large")
    height, width = pixels.shape[:2]
    colour, table = _RGB if pixels.ndim == 3 else _GREY, b""
    if palette is not None:
        colour, table = _INDEXED, _chunk(b"PLTE", _palette_bytes(pixels, palette))
    head = struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, colour, 0, 0, 0)
    data = isal_zlib.compress(_filtered(pixels, sub), 1)
    return b"".join((_SIGNATURE, _chunk(b"IHDR", head), table, _chunk(b"IDAT", data), _chunk(b"IEND", b"")))


def _filtered(pixels: NDArray[np.uint8] | NDArray[np.uint16], sub: bool) -> NDArray[np.uint8]:
    """Return the rows, most significant byte first, each preceded by its filter type."""
    height, width = pixels.shape[:2]
    raw = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    rows = np.empty((height, 1 + raw.shape[1]), np.uint8)
    rows[:, 0] = sub
    rows[:, 1:] = raw
    if sub:
        step = raw.shape[1] // width
        rows[:, 1 + step :] -= raw[:, :-step]
    return rows


def _palette_bytes(pixels: NDArray[np.uint8] | NDArray[np.uint16], palette: NDArray[np.uint8]) -> bytes:
    if pixels.ndim != 2 or pixels.dtype != np.uint8:
        raise ValueError("a palette is for (height, width) uint8")
    if palette.dtype != np.uint8 or palette.ndim != 2 or palette.shape[1] != 3 or not 1 <= len(palette) <= 256:
        raise ValueError(f"a palette is 1 to 256 colours of three bytes, not {palette.dtype} {palette.shape}")
    if pixels.max() >= len(palette):
        raise ValueError("a pixel is beyond the palette")
    return palette.tobytes()


def _chunk(kind: bytes, data: bytes) -> bytes:
    crc = isal_zlib.crc32(data, isal_zlib.crc32(kind))
    return b"".join((struct.pack(">I", len(data)), kind, data, struct.pack(">I", crc)))
