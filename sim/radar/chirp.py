"""FMCW frame of M chirps of N samples, with its resolutions and limits.

A chirp sweeps the bandwidth B in the time T = N / f_s of its samples; chirps repeat every T_c. With f_c the centre of
the sweep and lambda = c / f_c (Richards, Fundamentals of Radar Signal Processing, 2nd ed., ch. 5; paper, table 3):

    range resolution  d_res = c / (2 B)           unambiguous range  d_max = d_res N / 2 (complex samples: d_res N)
    speed resolution  v_res = lambda / (2 M T_c)  unambiguous speed  v_max = lambda / (4 T_c)

With transmitters in time division the frame's M chirps are those of all of them, and `of_one_transmitter` is the frame
that each sees.

Time runs from the middle of the frame: sample n of chirp m is taken at

    t(m, n) = (m - (M - 1) / 2) T_c + (n - (N - 1) / 2) / f_s
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from signals.units import LIGHT_MPS

SPEED_OF_LIGHT_MPS = LIGHT_MPS

_Frequency = Annotated[float, Field(gt=0.0, le=1e12)]
_MIN_HZ = 1e6  # a wavelength of 300 m; far longer wavelengths overflow a float


class Chirp(StrictModel):
    """Frame of an FMCW radar. `bandwidth_hz` is swept while the samples are taken."""

    center_frequency_hz: _Frequency
    bandwidth_hz: _Frequency
    samples: Annotated[int, Field(ge=8, le=1024)]
    sample_rate_hz: _Frequency
    chirps: Annotated[int, Field(ge=2, le=1024)]
    repetition_s: Annotated[float, Field(gt=0.0, le=1.0)]
    sampling: Literal["real", "complex"] = "real"  # complex: each receiver has an in-phase and a quadrature channel

    @model_validator(mode="after")
    def _possible(self) -> Chirp:
        if self.samples % 2:
            raise ValueError(f"samples must be even, not {self.samples}")
        if self.sampling_s > self.repetition_s:
            raise ValueError(
                f"{self.samples} samples at {self.sample_rate_hz:g} Hz take {self.sampling_s:.6g} s, longer than "
                f"repetition_s {self.repetition_s:g}"
            )
        if self.center_frequency_hz < _MIN_HZ:
            raise ValueError(f"center_frequency_hz must be at least 1 MHz, not {self.center_frequency_hz:g} Hz")
        if 0.5 * self.bandwidth_hz >= self.center_frequency_hz:
            raise ValueError(
                f"bandwidth_hz {self.bandwidth_hz:g} about a centre of {self.center_frequency_hz:g} Hz reaches 0 Hz"
            )
        return self

    @property
    def sampling_s(self) -> float:
        """Duration of the samples of one chirp."""
        return self.samples / self.sample_rate_hz

    @property
    def start_frequency_hz(self) -> float:
        return self.center_frequency_hz - 0.5 * self.bandwidth_hz

    @property
    def slope_hz_per_s(self) -> float:
        return self.bandwidth_hz / self.sampling_s

    @property
    def wavelength_m(self) -> float:
        return SPEED_OF_LIGHT_MPS / self.center_frequency_hz

    @property
    def frame_s(self) -> float:
        """Duration of the frame: all chirps with their repetition time."""
        return self.chirps * self.repetition_s

    @property
    def parts(self) -> int:
        """Channels of a receiver: 1 with real samples, 2 with complex ones."""
        return 2 if self.sampling == "complex" else 1

    def of_one_transmitter(self, turns: int) -> Chirp:
        """Return the frame of one of `turns` transmitters that take turns; `chirps` must be a multiple of it."""
        if turns == 1:
            return self
        shares = {"chirps": self.chirps // turns, "repetition_s": self.repetition_s * turns}
        return self.model_copy(update=shares)

    @property
    def range_resolution_m(self) -> float:
        return SPEED_OF_LIGHT_MPS / (2.0 * self.bandwidth_hz)

    @property
    def max_range_m(self) -> float:
        return 0.5 * self.parts * self.samples * self.range_resolution_m

    @property
    def speed_resolution_mps(self) -> float:
        return self.wavelength_m / (2.0 * self.frame_s)

    @property
    def max_speed_mps(self) -> float:
        return self.wavelength_m / (4.0 * self.repetition_s)

    def beat_frequency_hz(self, range_m: float) -> float:
        """Return the beat frequency of an echo at rest at `range_m`."""
        return self.slope_hz_per_s * 2.0 * range_m / SPEED_OF_LIGHT_MPS
