"""How a picture of any size is put into a network's input, and boxes come back out of it.

One scale for both directions, so that nothing is stretched; what is left over is filled on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

_FILL = 114  # of 255: about the mean of what cameras see


@dataclass(frozen=True)
class Letterbox:
    """Input pixel = picture pixel * scale + shift."""

    scale: float
    shift_x_px: int
    shift_y_px: int
    placed_px: tuple[int, int]  # width, height that the picture takes in the input

    @classmethod
    def of(cls, picture_px: tuple[int, int], input_px: tuple[int, int]) -> Letterbox:
        """Both are width, height."""
        scale = min(input_px[0] / picture_px[0], input_px[1] / picture_px[1])
        width = max(1, min(input_px[0], round(picture_px[0] * scale)))
        height = max(1, min(input_px[1], round(picture_px[1] * scale)))
        return cls(scale, (input_px[0] - width) // 2, (input_px[1] - height) // 2, (width, height))

    def place(self, rgb: np.ndarray, out: np.ndarray) -> None:
        """The picture into `out` (height, width, 3) uint8."""
        width, height = self.placed_px
        if (width, height) != (out.shape[1], out.shape[0]):
            out[:] = _FILL
        shrinks = rgb.shape[1] > width
        part = out[self.shift_y_px : self.shift_y_px + height, self.shift_x_px : self.shift_x_px + width]
        if rgb.shape[:2] == (height, width):
            part[:] = rgb
        else:
            part[:] = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)

    def back(self, boxes_px: np.ndarray) -> np.ndarray:
        """Boxes (N, 4) of the input as boxes of the picture."""
        shift = np.array([self.shift_x_px, self.shift_y_px, self.shift_x_px, self.shift_y_px], np.float64)
        return (boxes_px - shift) / self.scale
