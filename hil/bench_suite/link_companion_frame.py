"""The frame that `hil bench link` sends: RGB, depth and segmentation at 320x240, LiDAR 16x900, IMU, GPS, pose."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, RETURNS = 320, 240, 16 * 900
AHEAD = 4  # frames under way when they stream
ANSWER_BYTES = 20  # of the bare socket, to each frame

Arrays = dict[str, dict[str, NDArray[Any]]]  # topic -> name -> array


def frame_arrays(seed: int, *, scale: float = 1.0) -> Arrays:
    """Noise of the sizes and kinds that the sensors have, about 1 MB; `scale` times as many rows and returns."""
    rng = np.random.default_rng(seed)
    rows, n = max(1, round(HEIGHT * scale)), max(1, round(RETURNS * scale))
    return {
        "front/rgb": {"rgb": rng.integers(0, 256, (rows, WIDTH, 3), np.uint8)},
        "front/depth": {"depth": rng.random((rows, WIDTH), np.float32)},
        "front/segmentation": {"segmentation": rng.integers(0, 256, (rows, WIDTH), np.uint8)},
        "lidar": {
            "points_L": rng.random((n, 3), np.float32),
            "range_m": rng.random(n, np.float32),
            "intensity": rng.random(n, np.float32),
            "ring": rng.integers(0, 16, n, np.uint8),
            "time_offset_ns": rng.integers(-10_000_000, 0, n, np.int32),
            "segmentation": rng.integers(0, 256, n, np.uint8),
        },
    }


def size_of(arrays: Arrays) -> int:
    """Bytes of them all."""
    return sum(array.nbytes for named in arrays.values() for array in named.values())


def checksums(arrays: Arrays) -> dict[str, int]:
    """CRC-32 of each, by topic and name."""
    return {
        f"{topic}.{name}": zlib.crc32(array.tobytes())
        for topic, named in arrays.items()
        for name, array in named.items()
    }


def bytes_of(arrays: Arrays) -> bytes:
    """All in one piece, as a bare socket sends them."""
    return b"".join(array.tobytes() for named in arrays.values() for array in named.values())
