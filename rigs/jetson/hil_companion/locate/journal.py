"""Detections as files: a JSON line for each picture, and at the end all tracked objects."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import IO, Any, Sequence

from hil_companion.detections import Found
from hil_companion.errors import file_errors

LINES_NAME, FOUND_NAME = "detections.jsonl", "found.json"


def _rounded(look: Any) -> list[float | None] | None:
    return None if look is None else [round(v, 1) if math.isfinite(v) else None for v in look.tolist()]


class Journal:
    """Writes both files into an existing folder. Raises CutError if they cannot be written."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with file_errors(f"detect: {folder / LINES_NAME} cannot be written"):
            self._lines: IO[str] = (folder / LINES_NAME).open("w", encoding="utf-8")

    def picture(self, frame: int, t_capture_ns: int, boxes: Sequence[Any], looks: Sequence[Any]) -> None:
        """Append one picture's boxes. `looks`: of each box, six CIE L*a*b* numbers, NaN if unknown, or None."""
        rows = [
            {
                "label": d.label,
                "score": round(float(d.score), 4),
                "box_px": [round(float(v), 2) for v in d.box_px],
                "range_m": d.range_m,
                "radial_speed_mps": d.radial_speed_mps,
                "p_W": d.p_W,
                "look_lab": None
                if look is None
                else [round(v, 1) if math.isfinite(v) else None for v in look.tolist()],
            }
            for d, look in zip(boxes, looks)
        ]
        with file_errors(f"detect: {self._folder} cannot be written"):
            self._lines.write(json.dumps({"frame": frame, "t_capture_ns": t_capture_ns, "boxes": rows}) + "\n")

    def close(self, found: Sequence[Found]) -> None:
        with file_errors(f"detect: {self._folder} cannot be written"):
            self._lines.close()
            text = json.dumps([vars(obj) for obj in found], indent=2)
            (self._folder / FOUND_NAME).write_text(text + "\n", encoding="utf-8")
