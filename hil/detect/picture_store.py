"""Pictures in memory: decoded once, all the same size, so that training does not wait for PNG files.

What does not fit into the allowance is read again each time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence

import cv2
import numpy as np
from hil_companion.detect.decode import Letterbox
from numpy.typing import NDArray

from hil.detect.pictures import Picture
from hil.signals.errors import ConfigError, Problem

Rgb = NDArray[np.uint8]
_ALLOWANCE_BYTES = 4 << 30


class PictureStore:
    """Pictures put into the network's input, and their boxes with them."""

    def __init__(
        self, pictures: Sequence[Picture], input_px: tuple[int, int], *, allowance_bytes: int = _ALLOWANCE_BYTES
    ) -> None:
        self.pictures = pictures
        self.input_px = input_px
        each = input_px[0] * input_px[1] * 3
        self._kept: list[Rgb | None] = [None] * len(pictures)
        self._may_keep = max(0, allowance_bytes // each)

    def __len__(self) -> int:
        return len(self.pictures)

    def rgb(self, index: int) -> Rgb:
        """Not to be written to. ConfigError for a file that is no picture of the size that its labels say."""
        kept = self._kept[index]
        if kept is not None:
            return kept
        placed = self._read(self.pictures[index])
        if index < self._may_keep:
            self._kept[index] = placed
        return placed

    def boxes_px(self, index: int) -> NDArray[np.float32]:
        """In pixels of the input."""
        picture = self.pictures[index]
        fit = Letterbox.of((picture.width, picture.height), self.input_px)
        shift = (fit.shift_x_px, fit.shift_y_px) * 2
        boxes: NDArray[np.float32] = (picture.boxes_px * fit.scale + np.array(shift, np.float32)).astype(np.float32)
        return boxes

    def area_px(self, index: int) -> NDArray[np.float32]:
        """Visible, in pixels of the input."""
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
    """SHA-256 of what training sees, in order: pixels and labels. Names the data that a model was made from.

    Not of files: how well a PNG was packed, or where it lies, makes no other model. ConfigError as `read_rgb`.
    """
    whole = hashlib.sha256()
    for p in pictures:
        head = json.dumps([p.width, p.height, *zip(p.labels, p.boxes_px.tolist(), p.area_px.tolist(), strict=True)])
        whole.update(head.encode())
        whole.update(read_rgb(p).tobytes())
    return whole.hexdigest()


def read_rgb(picture: Picture) -> Rgb:
    """ConfigError for a file that is no picture of the size that its labels say."""
    bgr = cv2.imread(str(picture.path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ConfigError([Problem(str(picture.path), "cannot be read as a picture", "record the data set again")])
    if bgr.shape[:2] != (picture.height, picture.width):
        sizes = f"{bgr.shape[1]} x {bgr.shape[0]} pixels, its labels are of {picture.width} x {picture.height}"
        raise ConfigError([Problem(str(picture.path), f"is of {sizes}")])
    return np.ascontiguousarray(bgr[:, :, ::-1])
