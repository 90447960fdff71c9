"""Coupling between a radar's receivers: each also has a share of what others receive.

    y_k = x_k + sum over its rows of 10^(level / 20) e^(j phase) x_from

x are the echoes and the interference at the receivers, y what their amplifiers get. Real samples have no phase to turn,
so with them only 0 and 180 degrees are possible.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals._kernel import det_cos, det_pow, det_sin
from signals.documents.validate import StrictModel
from signals.units import RAD_PER_DEG
from sim.radar.chirp import Chirp

Float64 = NDArray[np.float64]

_Receiver = Annotated[int, Field(ge=1, le=16)]
_Level = Annotated[float, Field(ge=-100.0, le=0.0)]
_Phase = Annotated[float, Field(ge=-360.0, le=360.0)]
_TURNED = (0.0, 180.0, -180.0)


class Coupling(StrictModel):
    """Rows of a receiver, the one it has a share of, level [dB] and phase [degrees]; receivers from 1 on."""

    rows: Annotated[tuple[tuple[_Receiver, _Receiver, _Level, _Phase], ...], Field(min_length=1, max_length=240)]

    @model_validator(mode="after")
    def _pairs(self) -> Coupling:
        pairs = [row[:2] for row in self.rows]
        if len(set(pairs)) < len(pairs):
            raise ValueError("a pair of receivers has two rows")
        if any(to == source for to, source in pairs):
            raise ValueError("a receiver is coupled to itself")
        return self

    def problem_with(self, chirp: Chirp, channels: int) -> str:
        """Return why the rows do not fit the receivers or the samples; "" if they do."""
        greatest, receivers = max(max(row[:2]) for row in self.rows), channels // chirp.parts
        if greatest > receivers:
            return f"names receiver {greatest}, but the antenna has {receivers}"
        if chirp.parts == 1 and any(row[3] not in _TURNED for row in self.rows):
            return "has phases other than 0 and 180 degrees, which real samples cannot have"
        return ""


def couple(coupling: Coupling, parts: int, signal: Float64) -> None:
    """Add the shares to a frame (channels, chirps, samples), in place."""
    x = signal.copy()
    for to, source, level_db, phase_deg in coupling.rows:
        k, j = (to - 1) * parts, (source - 1) * parts
        level, phase = det_pow(10.0, level_db / 20.0), phase_deg * RAD_PER_DEG
        if parts == 1:
            signal[k] += (level if phase_deg == 0.0 else -level) * x[j]
            continue
        re, im = level * det_cos(phase), level * det_sin(phase)
        signal[k] += re * x[j] - im * x[j + 1]
        signal[k + 1] += im * x[j] + re * x[j + 1]
