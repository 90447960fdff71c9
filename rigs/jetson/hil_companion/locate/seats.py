"""Seats: which part of a box on a seat shows something other than the seat.

An empty bench resembles a person on a bench. The colours of all seats' boxes of the flight are counted by chroma, and
the pixels of a box that lies on a seat's are compared with the common ones: on an empty seat few pixels remain, on a
seat with a person about half.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from hil_companion.locate.looks import ObjectPixels, object_pixels

SEATS = ("bench",)  # labels of objects that people sit on
_COMMON = 0.08  # least share of the seats' pixels, as a mean over boxes, of a colour that is the seats'
_CHROMA, _DARK, _DARK_CELL = 0.12, 12.0, 100_000  # width of a cell of a / (L + 10) and b / (L + 10); dark pixels apart
_ON_SEAT, _LEAST_PIXELS = 0.2, 10
_SITS = 0.42  # a person's share of the own pixels of a box on a seat
SEATED_GAIN = 0.08  # the detector's scores of people on seats are about this much lower


def seated_gain(other_share: float | None) -> float:
    """Return what is added to the score of a box with this share of pixels unlike the seat's."""
    return SEATED_GAIN if other_share is not None and other_share > _SITS else 0.0


class Seats:
    """Colours of the seats seen so far."""

    def __init__(self) -> None:
        self._shares: dict[int, float] = {}  # sum over boxes, by cell
        self._boxes = 0

    def learn(self, rgb: np.ndarray, found: Sequence[Any]) -> None:
        """Count the colours of a picture's seats."""
        for seat in found:
            if seat.label not in SEATS:
                continue
            cells = _cells(object_pixels(rgb, seat.box_px))
            if len(cells) < _LEAST_PIXELS:
                continue
            values, counts = np.unique(cells, return_counts=True)
            for value, count in zip(values.tolist(), counts.tolist()):
                self._shares[value] = self._shares.get(value, 0.0) + count / len(cells)
            self._boxes += 1

    def other_share(self, box: Any, pixels: ObjectPixels, found: Sequence[Any]) -> float | None:
        """Return the share of a box's own pixels that are not coloured like seats; None if it is not on a seat."""
        on_seat = any(_covered(box.box_px, seat.box_px) > _ON_SEAT for seat in found if seat.label in SEATS)
        cells = _cells(pixels)
        if not on_seat or len(cells) < _LEAST_PIXELS:
            return None
        common = [cell for cell, share in self._shares.items() if share > _COMMON * self._boxes]
        return float(1.0 - np.isin(cells, common).mean())


def _cells(pixels: ObjectPixels) -> np.ndarray:
    lab = pixels.lab[pixels.shown]
    chroma = np.round(lab[:, 1:] / (lab[:, :1] + 10.0) / _CHROMA).astype(np.int64)
    return chroma @ np.array([100, 1]) + _DARK_CELL * (lab[:, 0] < _DARK)


def _covered(box_px: Sequence[float], by_px: Sequence[float]) -> float:
    """Return the share of a box that another one covers."""
    wide = min(box_px[2], by_px[2]) - max(box_px[0], by_px[0])
    high = min(box_px[3], by_px[3]) - max(box_px[1], by_px[1])
    area = (box_px[2] - box_px[0]) * (box_px[3] - box_px[1])
    return max(0.0, wide) * max(0.0, high) / area if area > 0.0 else 0.0
