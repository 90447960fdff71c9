"""Antennas of a radar: positions of its receivers, and patterns of transmitter and receivers.

For a unit direction d = (x, y, z) in R (x forward, y left, z up), and the half-power beamwidths a of azimuth and e of
elevation:

    G(d) = G_0 (x / sqrt(x^2 + y^2))^p (x / sqrt(x^2 + z^2))^q    for x > 0, else 0
    p = ln(1/2) / ln(cos(a / 2)),   q = ln(1/2) / ln(cos(e / 2))

In either principal plane the gain is a power of the cosine, and half of G_0 at half the beamwidth off the axis. This is
the main lobe of a small patch antenna, without side lobes. All receivers have the same pattern.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from signals._kernel import det_cos, det_log, det_pow
from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import RAD_PER_DEG
from sim._kernels import cosine_pattern

Float64 = NDArray[np.float64]

MAX_RECEIVERS = 16  # limit of the kernels: sim/native/radar/echo_model.hpp
_HALF_RAD_PER_DEG = 0.5 * RAD_PER_DEG
_Beamwidth = Annotated[float, Field(ge=0.5, le=179.0)]


class Pattern(StrictModel):
    """Gain of one antenna as a function of direction."""

    gain_dbi: Annotated[float, Field(ge=-30.0, le=60.0)]  # on the axis
    azimuth_beamwidth_deg: _Beamwidth  # full width at half of the power
    elevation_beamwidth_deg: _Beamwidth

    @property
    def axis_gain(self) -> float:
        """Gain on the axis as a ratio of powers."""
        return det_pow(10.0, 0.1 * self.gain_dbi)

    def share(self, direction_R: Float64) -> Float64:
        """Return the gain in unit directions (n, 3), relative to the axis, (n,)."""
        share = np.empty(len(direction_R))
        p, q = _exponent(self.azimuth_beamwidth_deg), _exponent(self.elevation_beamwidth_deg)
        cosine_pattern(np.ascontiguousarray(direction_R, np.float64), p, q, share)
        return share

    def gain(self, direction_R: Float64) -> Float64:
        """Return the gain in unit directions (n, 3) as ratios of powers, (n,)."""
        return self.axis_gain * self.share(direction_R)


class Antenna(StrictModel):
    """One transmitter with the receivers."""

    rx_positions_m: tuple[Vec3, ...]  # in R, in the order of the channels
    tx: Pattern
    rx: Pattern

    @field_validator("rx_positions_m")
    @classmethod
    def _check_receivers(cls, value: tuple[Vec3, ...]) -> tuple[Vec3, ...]:
        if not 1 <= len(value) <= MAX_RECEIVERS:
            raise ValueError(f"holds {len(value)} receivers; a radar has 1 to {MAX_RECEIVERS}")
        if any(abs(v) > 1.0 for position in value for v in position):
            raise ValueError("holds a receiver more than 1 m away: positions are in metres from the radar's origin")
        return value

    def share(self, direction_R: Float64) -> Float64:
        """Return the two-way gain in unit directions (n, 3), relative to the axis, (n,)."""
        return self.tx.share(direction_R) * self.rx.share(direction_R)

    def gain(self, direction_R: Float64) -> Float64:
        """Return the two-way gain G_t G_r in unit directions (n, 3) as ratios of powers, (n,)."""
        return self.tx.gain(direction_R) * self.rx.gain(direction_R)


def _exponent(beamwidth_deg: float) -> float:
    return det_log(0.5) / det_log(det_cos(beamwidth_deg * _HALF_RAD_PER_DEG))
