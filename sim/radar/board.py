"""Limits of a radar chip, its ramp generator and its capture card, and the timing of its ramp.

A chirp of the device is an idle time, then a ramp; samples are taken from `adc_start_s` after the ramp's beginning, and
the ramp runs `excess_s` past the last one (TI's names: idleTime, adcStartTime, rampEndTime):

    repetition_s = idle + ramp        ramp = adc_start_s + samples / sample_rate_hz + excess_s
    f_ramp = start_frequency_hz - S adc_start_s ... start_frequency_hz - S adc_start_s + S ramp

So the ramp covers more of the band than `bandwidth_hz`, which is swept while samples are taken.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from sim.radar.chirp import Chirp

_Frequency = Annotated[float, Field(gt=0.0, le=1e12)]
_Seconds = Annotated[float, Field(ge=0.0, le=1e-3)]
_Number = Annotated[int, Field(ge=1, le=12)]
_SLACK = 1.0 + 1e-9


class Board(StrictModel):
    """Limits of a device; a chirp or a rate beyond them is an error."""

    band_hz: tuple[_Frequency, _Frequency]
    max_slope_hz_per_s: Annotated[float, Field(gt=0.0, le=1e18)]
    max_real_rate_hz: _Frequency
    max_complex_rate_hz: _Frequency
    adc_start_s: _Seconds
    excess_s: _Seconds = 1e-6
    min_idle_s: _Seconds
    min_repetition_s: _Seconds = 0.0  # of chirps
    # Bands of the oscillators, each of which covers a ramp alone; empty: all of `band_hz` is one.
    oscillator_bands_hz: tuple[tuple[_Frequency, _Frequency], ...] = ()
    max_chirps: Annotated[int, Field(ge=2, le=1 << 20)]  # of a frame
    max_capture_bps: Annotated[float, Field(gt=0.0, le=1e12)]  # samples of 16 bits from the capture card
    tx_numbers: Annotated[tuple[_Number, ...], Field(min_length=1)] = tuple(range(1, 13))  # as they transmit, by name
    lvds_lanes: Literal[2, 4] = 2  # to the capture card, which orders its samples by them (sim/radar/dca1000.py)

    def tx_mask(self, turn: int, transmitters: int, turns: int) -> int:
        """Return the transmitters of a chirp as bits, bit 0 for TX1. `turn`: of the `turns` chirps of a loop."""
        numbers = self.tx_numbers[:transmitters] if turns == 1 else self.tx_numbers[turn : turn + 1]
        return sum(1 << (number - 1) for number in numbers)

    @model_validator(mode="after")
    def _band_rises(self) -> Board:
        if not self.band_hz[0] < self.band_hz[1]:
            raise ValueError(f"band_hz [{self.band_hz[0]:g}, {self.band_hz[1]:g}] is empty")
        return self

    def ramp_s(self, chirp: Chirp) -> float:
        """Return the duration of the ramp."""
        return self.adc_start_s + chirp.sampling_s + self.excess_s

    def idle_s(self, chirp: Chirp) -> float:
        """Return the time from the end of a ramp to the beginning of the next."""
        return chirp.repetition_s - self.ramp_s(chirp)

    def ramp_start_hz(self, chirp: Chirp) -> float:
        """Return the frequency at which the ramp begins."""
        return chirp.start_frequency_hz - chirp.slope_hz_per_s * self.adc_start_s

    def problems_with(self, chirp: Chirp) -> list[str]:
        """Return what of a chirp the board cannot do, each with its limit; empty if it can do it."""
        problems = []
        first_hz = self.ramp_start_hz(chirp)
        last_hz = first_hz + chirp.slope_hz_per_s * self.ramp_s(chirp)
        if first_hz < self.band_hz[0] / _SLACK or last_hz > self.band_hz[1] * _SLACK:
            problems.append(
                f"bandwidth_hz: the ramp runs from {first_hz / 1e9:.6g} to {last_hz / 1e9:.6g} GHz, "
                f"{1e6 * self.adc_start_s:g} us before the first sample and {1e6 * self.excess_s:g} us after the last "
                f"included; the board's band is {self.band_hz[0] / 1e9:g} to {self.band_hz[1] / 1e9:g} GHz"
            )
        elif self.oscillator_bands_hz and not any(
            low / _SLACK <= first_hz and last_hz <= high * _SLACK for low, high in self.oscillator_bands_hz
        ):
            bands = " or ".join(f"{low / 1e9:g} to {high / 1e9:g}" for low, high in self.oscillator_bands_hz)
            problems.append(
                f"bandwidth_hz: the ramp runs from {first_hz / 1e9:.6g} to {last_hz / 1e9:.6g} GHz, and one oscillator "
                f"of the board covers {bands} GHz"
            )
        if chirp.slope_hz_per_s > self.max_slope_hz_per_s * _SLACK:
            problems.append(
                f"bandwidth_hz: a slope of {chirp.slope_hz_per_s * 1e-12:.4g} MHz/us; the board's limit is "
                f"{self.max_slope_hz_per_s * 1e-12:g} MHz/us"
            )
        limit_hz = self.max_complex_rate_hz if chirp.sampling == "complex" else self.max_real_rate_hz
        if chirp.sample_rate_hz > limit_hz * _SLACK:
            problems.append(
                f"sample_rate_hz: {chirp.sample_rate_hz * 1e-6:g} million {chirp.sampling} samples a second; the "
                f"board's limit is {limit_hz * 1e-6:g}"
            )
        if self.idle_s(chirp) < self.min_idle_s / _SLACK:
            problems.append(
                f"repetition_s: {1e6 * chirp.repetition_s:.6g} us leave {1e6 * self.idle_s(chirp):.4g} us between "
                f"ramps of {1e6 * self.ramp_s(chirp):.6g} us; the board needs {1e6 * self.min_idle_s:g} us"
            )
        if chirp.repetition_s < self.min_repetition_s / _SLACK:
            problems.append(
                f"repetition_s: {1e6 * chirp.repetition_s:.6g} us; the board's limit is "
                f"{1e6 * self.min_repetition_s:g} us"
            )
        if chirp.chirps > self.max_chirps:
            problems.append(f"chirps: {chirp.chirps} in a frame; the board's limit is {self.max_chirps}")
        return problems

    def capture_problem(self, chirp: Chirp, receivers: int, rate_hz: float) -> str:
        """Return why frames at `rate_hz` cannot be captured; "" if they can."""
        bps = 16.0 * receivers * chirp.parts * chirp.chirps * chirp.samples * rate_hz
        if bps <= self.max_capture_bps * _SLACK:
            return ""
        return f"makes {bps * 1e-6:.5g} Mbit/s of samples; the board's limit is {self.max_capture_bps * 1e-6:g} Mbit/s"
