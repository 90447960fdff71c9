"""Raw codes of a recording that show nothing of the scene: of a receiver that is not connected, or clipped."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.parts.judges.echoes import clipping
from signals.words import counted


class RawCodes:
    """Counts of the codes of all frames."""

    def __init__(self, adc_bits: int) -> None:
        self._top = (1 << adc_bits) - 1
        self._frames = self._samples = self._clipped = 0
        self._least: NDArray[Any] | None = None  # by channel
        self._greatest: NDArray[Any] | None = None

    def add(self, raw: NDArray[np.uint16]) -> None:
        """Add a frame (channels, chirps, samples)."""
        least, greatest = raw.min(axis=(1, 2)), raw.max(axis=(1, 2))
        if self._least is not None and self._greatest is not None:
            least, greatest = np.minimum(self._least, least), np.maximum(self._greatest, greatest)
        self._least, self._greatest = least, greatest
        self._frames += 1
        self._samples += raw.size
        self._clipped += int(np.count_nonzero(raw == 0) + np.count_nonzero(raw == self._top))

    def warnings(self) -> list[str]:
        """Describe what makes the results false."""
        silent = [] if self._least is None else np.flatnonzero(self._least == self._greatest).tolist()
        told = [
            f"channel {channel + 1} has one code only in {counted(self._frames, 'frame')}: it is not connected"
            for channel in silent
        ]
        clipped = clipping(self._clipped, self._samples)
        return [*told, clipped] if clipped else told
