"""Impairments of a radar's receivers, added to the echoes; an impairment that is null is off.

    x[k,m,n] = echoes + dc[k] + leakage[k](f_n) + e^{-m T_c / decay} start[k](f_n) + sigma_k d[k,m] + noise[k,m,n]

leakage      TX to RX, DC and static objects close to the sensor, over the sweep (sim/radar/swept_pattern.py)
frame_start  additional pattern while the chip warms up after the frame's first chirp
dc_wander    DC of each chirp, white from chirp to chirp
noise        receiver noise by its power in each bin of beat frequency, independent from chirp to chirp
compression  of the amplifiers before the converter: y = x / sqrt(1 + (x / limit)^2) of echoes and interference
coupling     between receivers (sim/radar/coupling.py)
sweep        phase noise and a sweep that is not linear (sim/radar/sweep_errors.py)
adc          unequal code widths: odd codes are `odd_code_share` of all (0.5: an even converter)

The power of a bin is |DFT|^2 / N of one chirp's N samples [counts^2], so that white noise of deviation sigma has
sigma^2 in every bin. It is constant beyond the last measured bin, and applies to samples at any rate. The `envelope` is
the rms of the noise over the chirp, in equal parts of its samples, normalised to a mean square of 1; the noise of real
receivers is larger near a chirp's start.

Without leakage the DC is half of the converter's scale. Without `adc` all codes are equally wide.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from sim.radar.chirp import Chirp
from sim.radar.coupling import Coupling
from sim.radar.sweep_errors import Sweep
from sim.radar.swept_pattern import SweptPattern

_Count = Annotated[float, Field(ge=0.0, le=65536.0)]
_Sigma = Annotated[float, Field(ge=0.0, le=1e4)]
_Share = Annotated[float, Field(ge=0.0, le=100.0)]
_Power = Annotated[float, Field(ge=0.0, le=1e8)]


class Leakage(StrictModel):
    """Constant pattern of each receiver over the sweep."""

    dc: tuple[_Count, ...]  # per receiver
    sweep: SweptPattern

    @model_validator(mode="after")
    def _alike(self) -> Leakage:
        if len(self.dc) != self.sweep.receivers:
            raise ValueError(f"dc has {len(self.dc)} receivers and sweep.counts {self.sweep.receivers}")
        return self


class FrameStart(StrictModel):
    """Pattern that decays from the first chirp of a frame."""

    decay_s: Annotated[float, Field(gt=0.0, le=10.0)]
    sweep: SweptPattern


class DcWander(StrictModel):
    """DC of each chirp."""

    sigma: tuple[_Sigma, ...]  # per receiver [counts]


class ReceiverNoise(StrictModel):
    """Power of the receiver noise by beat frequency, and its envelope over the chirp."""

    bin_hz: Annotated[float, Field(gt=0.0, le=1e9)]  # step of beat frequency between powers; the first is at 0
    power: Annotated[tuple[Annotated[tuple[_Power, ...], Field(min_length=2)], ...], Field(min_length=1)]
    envelope: tuple[Annotated[tuple[_Share, ...], Field(min_length=1)], ...] | None = None  # null: 1 throughout

    @model_validator(mode="after")
    def _alike(self) -> ReceiverNoise:
        if self.envelope is not None and len(self.envelope) != len(self.power):
            raise ValueError(f"power has {len(self.power)} receivers and envelope {len(self.envelope)}")
        return self

    def envelope_at(self, receiver: int, share: float) -> float:
        """Return the envelope at a share (0 to 1) of the chirp, linear between the middles of its parts."""
        if self.envelope is None:
            return 1.0
        row = self.envelope[receiver]
        position = min(max(share * len(row) - 0.5, 0.0), len(row) - 1.0)
        i = min(int(position), max(len(row) - 2, 0))
        t = position - i
        return row[i] if t == 0.0 else row[i] + t * (row[i + 1] - row[i])

    def power_at(self, receiver: int, frequency_hz: float) -> float:
        """Return the power [counts^2], linear between the bins."""
        row = self.power[receiver]
        position = frequency_hz / self.bin_hz
        i = min(int(position), len(row) - 2)
        t = min(position - i, 1.0)
        return row[i] + t * (row[i + 1] - row[i])


class Compression(StrictModel):
    """Soft limit of the amplifiers. The compression is 1 dB at 0.59 of the limit."""

    limit_counts: Annotated[float, Field(ge=1.0, le=1e9)]


class Adc(StrictModel):
    """Converter with code widths that differ between odd and even codes."""

    odd_code_share: Annotated[float, Field(ge=0.0, le=0.5)]

    @property
    def noise_power(self) -> float:
        """White power of the rounding alone [counts^2]. Odd codes are 2 share wide, even codes 2 - 2 share."""
        odd = 2.0 * self.odd_code_share
        return (odd**3 + (2.0 - odd) ** 3) / 24.0


class Impairments(StrictModel):
    """All impairments of a radar; null: off."""

    leakage: Leakage | None = None
    frame_start: FrameStart | None = None
    dc_wander: DcWander | None = None
    noise: ReceiverNoise | None = None
    adc: Adc | None = None
    compression: Compression | None = None
    sweep: Sweep | None = None
    coupling: Coupling | None = None

    def problems_with(self, chirp: Chirp, receivers: int) -> list[str]:
        """Return why these impairments do not fit the number of receivers or the chirp; empty if they do."""
        given = {
            "leakage.sweep.counts": self.leakage and self.leakage.sweep.receivers,
            "frame_start.sweep.counts": self.frame_start and self.frame_start.sweep.receivers,
            "dc_wander.sigma": self.dc_wander and len(self.dc_wander.sigma),
            "noise.power": self.noise and len(self.noise.power),
        }
        problems = [
            f"{name} has {count} receivers, but the antenna has {receivers}"
            for name, count in given.items()
            if count is not None and count != receivers
        ]
        wide = "" if self.sweep is None else self.sweep.problem_with(chirp)
        if wide:
            problems.append(f"sweep {wide}")
        unfit = "" if self.coupling is None else self.coupling.problem_with(chirp, receivers)
        if unfit:
            problems.append(f"coupling {unfit}")
        for name, part in (("leakage", self.leakage), ("frame_start", self.frame_start)):
            problem = part.sweep.problem_with(chirp) if part is not None else ""
            if problem:
                problems.append(f"{name} {problem}: set it to null or calibrate with this chirp")
        return problems
