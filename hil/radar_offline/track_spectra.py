"""Micro-Doppler: the speeds of what is near a track, frame by frame.

A person's limbs are within an arm's length of the trunk that the track follows, and nothing else should be: power is
summed over the range bins at most `NEAR_M` from the track's range, so that noise and things elsewhere stay out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import Chirp
from sim.radar.processing.processor import Processed

NEAR_M = 0.9


@dataclass
class TrackSpectra:
    """One track; lists have one value a frame in which it was there."""

    track: int
    frames: list[int] = field(default_factory=list)
    power: list[NDArray[np.float32]] = field(default_factory=list)  # over the speeds
    range_m: list[float] = field(default_factory=list)
    speed_mps: list[float] = field(default_factory=list)

    @property
    def way_m(self) -> float:
        """From its nearest to its farthest range."""
        return max(self.range_m) - min(self.range_m)


class SpectraOfTracks:
    """Collects the frames one by one."""

    def __init__(self, chirp: Chirp) -> None:
        self._chirp = chirp
        self._tracks: dict[int, TrackSpectra] = {}

    def add(self, frame: int, processed: Processed) -> None:
        """Take in one frame."""
        power = processed.range_doppler
        bin_m = self._chirp.max_range_m / power.shape[1]
        for track in processed.tracks:
            range_m = float(track["range_m"])
            near = np.abs(np.arange(power.shape[1]) * bin_m - range_m) <= max(NEAR_M, bin_m)
            found = self._tracks.setdefault(int(track["id"]), TrackSpectra(int(track["id"])))
            found.frames.append(frame)
            found.power.append(power[:, near].sum(axis=1))
            found.range_m.append(range_m)
            found.speed_mps.append(float(track["speed_mps"]))

    def farthest(self) -> TrackSpectra | None:
        """The track that came the farthest in range, of equals the first: one that stands shows no limbs."""
        return max(self._tracks.values(), key=lambda track: track.way_m, default=None)


def rows_over_frames(spectra: TrackSpectra) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """The frames from its first to its last, and the power of each: of none (NaN) where the track was not there."""
    first, last = spectra.frames[0], spectra.frames[-1]
    rows = np.full((last - first + 1, len(spectra.power[0])), np.nan, np.float32)
    rows[np.array(spectra.frames) - first] = spectra.power
    return np.arange(first, last + 1), rows
