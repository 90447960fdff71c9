"""What a radar's receivers add to the echoes, part by part; a part that is null is off.

    x[k,m,n] = echoes + dc[k] + leakage[k](f_n) + e^{-m T_c / decay} start[k](f_n) + sigma_k d[k,m] + noise[k,m,n]

leakage      TX to RX, DC and what stands still close to the sensor, over the sweep (sim/radar/swept_pattern.py)
frame_start  what differs while the chip warms up after the frame's first chirp
dc_wander    a DC of each chirp's own, white from chirp to chirp
noise        receiver noise by its power in each bin of beat frequency, independent from chirp to chirp
adc          unequal code widths: odd codes are `odd_code_share` of all (0.5: an even converter)

Power of a bin: |DFT|^2 / N of one chirp's N samples [counts^2], so that white noise of deviation sigma has sigma^2 in
every bin. It is held constant beyond the last bin that was measured, and applies to samples taken at any rate. The
`envelope` is how loud the noise is over the chirp, in equal parts of its samples, about a mean square of 1: close to a
chirp's start there is more of it.

Without leakage the DC is half of the converter's scale. Without `adc` the converter is an even one.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from hil.signals.documents.validate import StrictModel
from sim.radar.chirp import Chirp
from sim.radar.swept_pattern import SweptPattern

_Count = Annotated[float, Field(ge=0.0, le=65536.0)]
_Sigma = Annotated[float, Field(ge=0.0, le=1e4)]
_Share = Annotated[float, Field(ge=0.0, le=100.0)]
_Power = Annotated[float, Field(ge=0.0, le=1e8)]


class Leakage(StrictModel):
    dc: tuple[_Count, ...]  # of each receiver
    sweep: SweptPattern

    @model_validator(mode="after")
    def _alike(self) -> Leakage:
        if len(self.dc) != self.sweep.receivers:
            raise ValueError(f"dc has {len(self.dc)} receivers and sweep.counts {self.sweep.receivers}")
        return self


class FrameStart(StrictModel):
    decay_s: Annotated[float, Field(gt=0.0, le=10.0)]
    sweep: SweptPattern


class DcWander(StrictModel):
    sigma: tuple[_Sigma, ...]  # of each receiver [counts]


class ReceiverNoise(StrictModel):
    bin_hz: Annotated[float, Field(gt=0.0, le=1e9)]  # beat frequency from one power to the next; the first is at 0
    power: Annotated[tuple[Annotated[tuple[_Power, ...], Field(min_length=2)], ...], Field(min_length=1)]
    envelope: tuple[Annotated[tuple[_Share, ...], Field(min_length=1)], ...] | None = None  # null: 1 throughout

    @model_validator(mode="after")
    def _alike(self) -> ReceiverNoise:
        if self.envelope is not None and len(self.envelope) != len(self.power):
            raise ValueError(f"power has {len(self.power)} receivers and envelope {len(self.envelope)}")
        return self

    def envelope_at(self, receiver: int, part: float) -> float:
        """At this part (0 to 1) of the chirp: straight lines between the middles of its parts."""
        if self.envelope is None:
            return 1.0
        row = self.envelope[receiver]
        place = min(max(part * len(row) - 0.5, 0.0), len(row) - 1.0)
        i = min(int(place), max(len(row) - 2, 0))
        t = place - i
        return row[i] if t == 0.0 else row[i] + t * (row[i + 1] - row[i])

    def power_at(self, receiver: int, frequency_hz: float) -> float:
        """Counts^2, on straight lines between the bins."""
        row = self.power[receiver]
        place = frequency_hz / self.bin_hz
        i = min(int(place), len(row) - 2)
        t = min(place - i, 1.0)
        return row[i] + t * (row[i + 1] - row[i])


class Adc(StrictModel):
    odd_code_share: Annotated[float, Field(ge=0.0, le=0.5)]

    @property
    def noise_power(self) -> float:
        """Of the rounding alone, white, in counts^2: odd codes are o = 2 share wide, even ones 2 - o."""
        odd = 2.0 * self.odd_code_share
        return (odd**3 + (2.0 - odd) ** 3) / 24.0


class Impairments(StrictModel):
    leakage: Leakage | None = None
    frame_start: FrameStart | None = None
    dc_wander: DcWander | None = None
    noise: ReceiverNoise | None = None
    adc: Adc | None = None

    def problems_with(self, chirp: Chirp, receivers: int) -> list[str]:
        """Why these cannot be those of `receivers` receivers with this chirp; empty if they can."""
        told = {
            "leakage.sweep.counts": self.leakage and self.leakage.sweep.receivers,
            "frame_start.sweep.counts": self.frame_start and self.frame_start.sweep.receivers,
            "dc_wander.sigma": self.dc_wander and len(self.dc_wander.sigma),
            "noise.power": self.noise and len(self.noise.power),
        }
        problems = [
            f"{name} is of {count} receivers, and the antenna has {receivers}"
            for name, count in told.items()
            if count is not None and count != receivers
        ]
        for name, part in (("leakage", self.leakage), ("frame_start", self.frame_start)):
            problem = part.sweep.problem_with(chirp) if part is not None else ""
            if problem:
                problems.append(f"{name} {problem}: set it to null or calibrate with this chirp")
        return problems
