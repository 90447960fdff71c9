"""Pictures of a client as files, and a contact sheet of some of them."""

from __future__ import annotations

from pathlib import Path
from typing import Sequence

import cv2
import numpy as np

from hil_companion.errors import file_errors


def spread(count: int, most: int) -> list[int]:
    """Return the numbers of at most `most` of `count` things, evenly spread from the first to the last."""
    chosen = min(most, count)
    return [round(i * (count - 1) / max(chosen - 1, 1)) for i in range(chosen)]


def sheet_of(pictures: Sequence[np.ndarray], most_columns: int) -> np.ndarray:
    """Return pictures of one size in rows from left to right; white where the last row ends early."""
    chosen = list(pictures)
    while len(chosen) % most_columns and len(chosen) > most_columns:
        chosen.append(np.full_like(chosen[0], 255))
    columns = min(most_columns, len(chosen))
    return np.vstack([np.hstack(chosen[i : i + columns]) for i in range(0, len(chosen), columns)])


def write_picture(client: str, path: Path, picture: np.ndarray, options: Sequence[int] = ()) -> None:
    """Write a picture in the format of its ending. Raises CutError if the file cannot be written."""
    done, data = cv2.imencode(path.suffix, picture, list(options))
    with file_errors(f"{client}: {path} cannot be written"):
        if done:
            path.write_bytes(data.tobytes())
