"""Processing chain from the raw samples of a frame to its map, points and tracks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signals.errors import ConfigError
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.points import POINT_DTYPE, PointFinder
from sim.radar.processing.range_doppler import RangeDoppler
from sim.radar.processing.tracker import TRACK_DTYPE, Tracker
from sim.radar.virtual_array import VirtualArray, as_array

Step = Literal["range_doppler", "points", "tracks"]


@dataclass(frozen=True)
class Processed:
    """Results of one frame, in new arrays."""

    range_doppler: NDArray[np.float32]  # (M', N'/2) counts^2, mean over the virtual array; rows from -v_max to v_max
    points: NDArray[np.void]  # POINT_DTYPE, strongest first
    tracks: NDArray[np.void]  # TRACK_DTYPE, oldest first


class Processor:
    """Processing chain of one radar; frames come in order of time. Equal frames give equal bytes."""

    def __init__(self, chirp: Chirp, array: VirtualArray | Sequence[Sequence[float]], processing: Processing) -> None:
        """Raises ValueError for a chirp that does not fit the settings.

        `array`: the places of the receivers, or a `VirtualArray` with several transmitters.
        """
        array = as_array(array)
        of_one = chirp.of_one_transmitter(array.turns)
        problem = processing.problem_with(array.seen(chirp))
        if problem:
            raise ValueError(problem)
        self.chirp = chirp
        self.processing = processing
        self.maps = RangeDoppler(chirp, array, processing)
        self._points = PointFinder(of_one, array, processing, self.maps)
        self._tracker = Tracker(array.seen(chirp), processing)
        self._frames = 0
        self._last_ns = 0

    def process(self, raw: NDArray[np.uint16], t_ns: int, *, until: Step = "tracks") -> Processed:
        """Process a frame (channels, chirps, samples) with middle `t_ns`. Results after step `until` are empty."""
        gain = self._background_gain(t_ns)
        power = self.maps.compute(raw, gain)
        points = np.empty(0, POINT_DTYPE) if until == "range_doppler" else self._points.find(power)
        tracks = self._tracker.step(points, t_ns) if until == "tracks" else np.empty(0, TRACK_DTYPE)
        self._frames += 1
        self._last_ns = t_ns
        return Processed(power, points, tracks)

    def reset(self) -> None:
        """Reset to the state after construction."""
        self._frames = 0
        self.maps.reset()
        self._tracker.reset()

    def _background_gain(self, t_ns: int) -> float:
        """Return the weight of a frame in the background: of a plain mean at first, of an exponential mean later."""
        if self._frames == 0:
            return 0.0
        dt_s = (t_ns - self._last_ns) * 1e-9
        return min(1.0, max(dt_s / (self.processing.background_s + dt_s), 1.0 / (self._frames + 1)))


def process_recording(
    adc: NDArray[np.uint16],
    chirp: Chirp,
    array: VirtualArray | Sequence[Sequence[float]],
    processing: Processing | None = None,
    *,
    period_ns: int,
) -> Iterator[Processed]:
    """Process a recording (frames, channels, chirps, samples) with a frame every `period_ns`."""
    array = as_array(array)
    expected = (len(array.rx_positions_m) * chirp.parts, chirp.chirps, chirp.samples)
    if adc.ndim != 4 or adc.shape[1:] != expected:
        raise ConfigError.at(
            "recording",
            f"its frames have shape {adc.shape[1:]}, but the chirp and the array need {expected} "
            "(channels, chirps, samples)",
            "process it with the settings of the recording",
        )
    if adc.dtype != np.uint16:
        raise ConfigError.at("recording", f"its samples are {adc.dtype}, not uint16", "store the codes of the ADC")
    if period_ns <= 0:
        raise ConfigError.at("recording", f"period_ns {period_ns} is not positive")
    return _frames(adc, Processor(chirp, array, processing or Processing()), period_ns)


def _frames(adc: NDArray[np.uint16], processor: Processor, period_ns: int) -> Iterator[Processed]:
    for i, frame in enumerate(adc):
        yield processor.process(np.ascontiguousarray(frame), i * period_ns)
