"""Memory cache of decoded pictures at the network's input size, so that training does not wait for PNG files.

Pictures beyond the cache's size are read again each time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence

import cv2
import numpy as np
from hil_companion.detect.decode import Letterbox
from numpy.typing import NDArray

from hil.apps.detect.pictures import Picture
from signals.errors import ConfigError

Rgb = NDArray[np.uint8]
_CACHE_BYTES = 4 << 30


class PictureStore:
    """Pictures letterboxed to the network's input (width, height), with their boxes and areas."""

    def __init__(
        self, pictures: Sequence[Picture], input_px: tuple[int, int], *, cache_bytes: int = _CACHE_BYTES
    ) -> None:
        self.pictures = pictures
        self.input_px = input_px
        picture_bytes = input_px[0] * input_px[1] * 3
        self._cache: list[Rgb | None] = [None] * len(pictures)
        self._max_cached = max(0, cache_bytes // picture_bytes)

    def __len__(self) -> int:
        return len(self.pictures)

    def rgb(self, index: int) -> Rgb:
        """Return a picture, (height, width, 3), which must not be modified.

        Raises ConfigError if the file cannot be read or its size differs from that of its labels.
        """
        cached = self._cache[index]
        if cached is not None:
            return cached
        rgb = self._read(self.pictures[index])
        if index < self._max_cached:
            self._cache[index] = rgb
        return rgb

    def boxes_px(self, index: int) -> NDArray[np.float32]:
        """Return the boxes of a picture, (n, 4) x0, y0, x1, y1 in pixels of the input."""
        picture = self.pictures[index]
        letterbox = Letterbox.of((picture.width, picture.height), self.input_px)
        shift = (letterbox.shift_x_px, letterbox.shift_y_px) * 2
        boxes: NDArray[np.float32] = (picture.boxes_px * letterbox.scale + np.array(shift, np.float32)).astype(
            np.float32
        )
        return boxes

    def area_px(self, index: int) -> NDArray[np.float32]:
        """Return the visible areas of a picture's objects, (n,) in pixels of the input."""
        picture = self.pictures[index]
        scale = Letterbox.of((picture.width, picture.height), self.input_px).scale
        areas: NDArray[np.float32] = (picture.area_px * np.float32(scale * scale)).astype(np.float32)
        return areas

    def _read(self, picture: Picture) -> Rgb:
        rgb = read_rgb(picture)
        width, height = self.input_px
        out = np.empty((height, width, 3), np.uint8)
        Letterbox.of((picture.width, picture.height), self.input_px).place(rgb, out)
        return out


def digest(pictures: Sequence[Picture]) -> str:
    """Return the SHA-256 of all pixels and labels in order, which identifies the data that a model was trained on.

    File names and PNG compression do not count, because they do not change the model. Raises ConfigError like
    `read_rgb`.
    """
    checksum = hashlib.sha256()
    for p in pictures:
        head = json.dumps([p.width, p.height, *zip(p.labels, p.boxes_px.tolist(), p.area_px.tolist(), strict=True)])
        checksum.update(head.encode())
        checksum.update(read_rgb(p).tobytes())
    return checksum.hexdigest()


def read_rgb(picture: Picture) -> Rgb:
    """Read a picture's file, (height, width, 3).

    Raises ConfigError if it cannot be read or its size differs from that of its labels.
    """
    bgr = cv2.imread(str(picture.path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ConfigError.at(str(picture.path), "cannot be read as a picture", "record the data set again")
    if bgr.shape[:2] != (picture.height, picture.width):
        sizes = f"{bgr.shape[1]} x {bgr.shape[0]} pixels, its labels are of {picture.width} x {picture.height}"
        raise ConfigError.at(str(picture.path), f"has {sizes}")
    return np.ascontiguousarray(bgr[:, :, ::-1])
