"""Writer of small GeoTIFF files of heights."""

from __future__ import annotations

import struct

import numpy as np


def geotiff(heights: np.ndarray, origin: tuple[float, float], step: tuple[float, float], epsg: int) -> bytes:
    """Return a GeoTIFF of 32-bit heights; `origin`: upper left corner, x and y."""
    rows, columns = heights.shape
    geographic = epsg in (4326, 4258)
    keys = (1, 1, 0, 3, 1024, 0, 1, 2 if geographic else 1, 1025, 0, 1, 1, 2048 if geographic else 3072, 0, 1, epsg)
    scale = struct.pack("<3d", *step, 0.0)
    tie = struct.pack("<6d", 0.0, 0.0, 0.0, *origin, 0.0)
    directory = struct.pack(f"<{len(keys)}H", *keys)
    pixels = heights.astype("<f4").tobytes()
    blocks, at = {}, 8
    for name, data in (("pixels", pixels), ("scale", scale), ("tie", tie), ("keys", directory)):
        blocks[name] = at
        at += len(data)
    entries = [
        (256, 4, 1, columns), (257, 4, 1, rows), (258, 3, 1, 32), (259, 3, 1, 1), (262, 3, 1, 1),
        (273, 4, 1, blocks["pixels"]), (277, 3, 1, 1), (278, 4, 1, rows), (279, 4, 1, len(pixels)), (339, 3, 1, 3),
        (33550, 12, 3, blocks["scale"]), (33922, 12, 6, blocks["tie"]), (34735, 3, len(keys), blocks["keys"]),
    ]  # fmt: skip
    table = struct.pack("<H", len(entries)) + b"".join(
        struct.pack("<HHI", tag, kind, n)
        + (struct.pack("<HH", value, 0) if kind == 3 and n == 1 else struct.pack("<I", value))
        for tag, kind, n, value in entries
    )
    return b"II" + struct.pack("<HI", 42, at) + pixels + scale + tie + directory + table + struct.pack("<I", 0)
