"""File of a film, written by OpenCV as MPEG-4 (every build of OpenCV has its encoder)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from signals.errors import RecordingError, file_errors


class Movie:
    """An MP4 file that takes pictures one by one. A context that finishes it."""

    def __init__(self, path: Path, size: tuple[int, int], rate_hz: float) -> None:
        """`size`: width and height [px], both even. Raises RecordingError if the file cannot be written."""
        self.path, self.size, self.count = path, size, 0
        with file_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, size)
        if not self._writer.isOpened():
            raise RecordingError(f"{path}: OpenCV cannot write a film of {size[0]} x {size[1]} pixels there")

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture, (height, width, 3) RGB."""
        height, width = picture.shape[:2]
        if (width, height) != self.size:
            raise ValueError(f"a picture of {width} x {height} pixels in a film of {self.size[0]} x {self.size[1]}")
        self._writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        self.count += 1

    def close(self) -> None:
        """Finish the file. Raises RecordingError if nothing of it can be read back."""
        self._writer.release()
        if self.count and self.path.stat().st_size == 0:
            raise RecordingError(f"{self.path}: OpenCV wrote nothing; is there room on the disk?")

    def __enter__(self) -> Movie:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
