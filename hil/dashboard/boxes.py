"""Boxes of companions for the page: what they made out in the pictures that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from hil.signals.detections import Detections, words_of


def boxes_of(detected: Mapping[str, Detections], streams: Iterable[str]) -> dict[str, Any]:
    """Stream -> {t_ns, boxes: [[x0, y0, x1, y1, words], ...]}; places as shares of the picture's width and height."""
    shown = {}
    for stream in streams:
        seen = detected.get(stream)
        if seen is not None:
            width, height = seen.size_px
            rows = [
                [d.box_px[0] / width, d.box_px[1] / height, d.box_px[2] / width, d.box_px[3] / height, words_of(d)]
                for d in seen.boxes
            ]
            shown[stream] = {"t_ns": seen.t_capture_ns, "boxes": rows}
    return shown
