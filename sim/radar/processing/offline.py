"""The chain over a recording: what a sensor does live, from an array of frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.signals.errors import ConfigError, Problem
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processed, Processor


def process_recording(
    adc: NDArray[np.uint16],
    chirp: Chirp,
    rx_positions_m: Sequence[Sequence[float]],
    processing: Processing | None = None,
    *,
    period_ns: int,
    isa: str = "",
) -> Iterator[Processed]:
    """Frame after frame of (frames, receivers, chirps, samples), taken every `period_ns`."""
    wanted = (len(rx_positions_m), chirp.chirps, chirp.samples)
    if adc.ndim != 4 or adc.shape[1:] != wanted:
        raise ConfigError(
            [
                Problem(
                    "recording",
                    f"its frames have shape {adc.shape[1:]}, the chirp and the array ask for {wanted} "
                    "(receivers, chirps, samples)",
                    "process it with the settings it was recorded with",
                )
            ]
        )
    if adc.dtype != np.uint16:
        raise ConfigError(
            [Problem("recording", f"its samples are {adc.dtype}, not uint16", "store what the ADC puts out")]
        )
    if period_ns <= 0:
        raise ConfigError([Problem("recording", f"period_ns {period_ns} is not positive")])
    return _frames(adc, Processor(chirp, rx_positions_m, processing or Processing(), isa), period_ns)


def _frames(adc: NDArray[np.uint16], processor: Processor, period_ns: int) -> Iterator[Processed]:
    for i, frame in enumerate(adc):
        yield processor.process(np.ascontiguousarray(frame), i * period_ns)
