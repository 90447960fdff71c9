"""Pictures with detected boxes: a sequence of JPEGs, and a contact sheet of the pictures with the most boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Sequence

import cv2
import numpy as np

from hil_companion.contact_sheet import sheet_of, spread, write_picture
from hil_companion.errors import file_errors

SHEET_NAME = "report.png"  # the bench shows the contact sheet on its report page
_SHEET_COLUMNS, _SHEET_PICTURES, _MAX_CANDIDATES = 3, 9, 60
_SIDE_PX = 426  # width of a picture in the contact sheet
_JPEG_QUALITY = 88
_COLOURS = (
    (40, 220, 255),
    (90, 230, 90),
    (255, 160, 60),
    (220, 110, 255),
    (120, 120, 255),
    (230, 230, 60),
)  # BGR


class BoxPictures:
    """Writes a picture every `every_s` of simulated time. Raises CutError if it cannot be written."""

    def __init__(self, folder: Path, *, every_s: float) -> None:
        self._folder, self._every_ns = folder, round(every_s * 1e9)
        self._next_ns = 0
        self._count = 0
        self._candidates: list[tuple[int, int, np.ndarray]] = []  # number of boxes, number of the picture, picture
        with file_errors(f"detect: {folder} cannot be made"):
            folder.mkdir(parents=True, exist_ok=True)

    def add(self, rgb: np.ndarray, found: Sequence[Any], t_ns: int) -> None:
        """Draw and write the picture if the period has passed; call for every picture, in order."""
        if t_ns < self._next_ns:
            return
        self._next_ns = t_ns + self._every_ns
        self._count += 1
        picture = with_boxes(rgb, found, f"{t_ns * 1e-9:.1f} s")
        file = self._folder / f"{self._count:04d}.jpg"
        write_picture("detect", file, picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        height = round(_SIDE_PX * picture.shape[0] / picture.shape[1])
        small = cv2.resize(picture, (_SIDE_PX, height), interpolation=cv2.INTER_AREA)
        self._candidates.append((len(found), self._count, small))
        if len(self._candidates) > _MAX_CANDIDATES:
            self._candidates.remove(min(self._candidates, key=lambda candidate: (candidate[0], candidate[1])))

    def close(self) -> None:
        """Write the contact sheet: pictures with the most boxes, in the order of time."""
        if not self._candidates:
            return
        best = sorted(self._candidates, key=lambda candidate: (-candidate[0], candidate[1]))[: 3 * _SHEET_PICTURES]
        best.sort(key=lambda candidate: candidate[1])
        chosen = [best[i][2] for i in spread(len(best), _SHEET_PICTURES)]
        write_picture("detect", self._folder / SHEET_NAME, sheet_of(chosen, _SHEET_COLUMNS))
        self._candidates = []


def with_boxes(rgb: np.ndarray, found: Sequence[Any], words: str = "") -> np.ndarray:
    """Return a copy in BGR order with boxes and labels; a small picture is doubled so that the labels can be read."""
    scale = 2 if rgb.shape[1] <= 400 else 1
    picture = cv2.resize(rgb[..., ::-1], None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    labels = sorted({d.label for d in found})
    for one in found:
        colour = _COLOURS[labels.index(one.label) % len(_COLOURS)] if one.label != "person" else _COLOURS[0]
        x0, y0, x1, y1 = (round(scale * v) for v in one.box_px)
        cv2.rectangle(picture, (x0, y0), (x1, y1), colour, 1, cv2.LINE_AA)
        label = f"{one.label} {one.score:.2f}"
        if one.range_m is not None:
            label += f" {one.range_m:.0f} m"
        if one.radial_speed_mps is not None:
            label += f" {one.radial_speed_mps:+.1f} m/s"
        at = (max(0, x0), max(10, y0 - 3))
        cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 3, cv2.LINE_AA)
        cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)
    if words:
        at = (6, picture.shape[0] - 8)
        cv2.putText(picture, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3, cv2.LINE_AA)
        cv2.putText(picture, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return picture
