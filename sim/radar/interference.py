"""Chirps of other radars in a radar's samples.

A victim v mixes what it receives with its own chirp. With f_c, S and the time t' from the middle of a chirp's samples,
the other radar's chirp has the beat frequency and phase

    f_b(t) = f_v(t'_v) - f_i(t'_i),   phi(t) = Phi_v(t'_v) - Phi_i(t'_i),   Phi(t') = f_c t' + S t'^2 / 2  [cycles]
    t'_i is the other radar's time at t - R / c, by its own clock

and the amplitude of one way (Friis), at the victim's output

    A = counts_per_sqrt_watt lambda_i sqrt(P_i G_i(d_i) G_v(d_v)) / (4 pi R)

times the filters |H(f_b)| where f_b is in the band of the samples, |f_b| <= f_s / 2 for real and 0 <= f_b < f_s for
complex ones; out of it the decimation filter leaves nothing. So chirps that cross, with the slopes S_v and S_i, give a
pulse of B / |S_v - S_i| with the band B (2 B_IF / |S_v - S_i| for real samples with B_IF = f_s / 2), and chirps of one
slope a steady line at S (R / c + the lag of the other chirp), a ghost at half the way that belongs to this delay
(Brooker, IEEE Trans. Electromagn. Compat. 49, 2007, p. 170; Goppelt, Bloecher and Menzel, Adv. Radio Sci. 8, 2010,
p. 55). Averaged over a frame, pulses raise the power of each sample by

    A^2 / 2 (duration of pulses in the samples of a chirp) / (duration of the samples)

Clocks: ramps are triggered by each radar's own clock, with its rate error in parts per million and its offset at the
start of the run, and each ramp begins with the same phase of its clock. A radar transmits during its samples alone.
Phases between receivers are those of plane waves; of several transmitters all have the place and power of the first.
Steps are + - * / of single elements, and cosines of detmath.hpp: the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim._kernels import cosines_and_sines
from sim.radar.antenna import Antenna
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.receiver import Receiver

Float64 = NDArray[np.float64]

_FOUR_PI = 12.566370614359172
LEAST_COUNTS = 1e-3  # a weaker one is left out: a thousandth of a count is below every noise and rounding


class Interference(StrictModel):
    """Clock of a radar that disturbs others and is disturbed by them; null: it does neither."""

    clock_ppm: Annotated[float, Field(ge=-1000.0, le=1000.0)] = 0.0  # rate error; above 0: fast
    clock_offset_s: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0  # at the start of the run


@dataclass(frozen=True)
class Transmission:
    """Chirps of another radar, with the antenna and the clock that send them."""

    chirp: Chirp
    antenna: Antenna
    receiver: Receiver  # its transmitter's power
    clock: Interference
    period_s: float  # from frame to frame


@dataclass(frozen=True)
class Path:
    """Straight way from the other radar to the victim."""

    range_m: float
    speed_mps: float  # + receding
    direction_R: Vec3  # from the victim, in its R
    direction_other_R: Vec3  # from the other radar, in its R


class Interfered:
    """Adds transmissions to frames of one radar."""

    def __init__(self, chirp: Chirp, antenna: Antenna, receiver: Receiver, clock: Interference) -> None:
        self._chirp, self._antenna, self._receiver, self._clock = chirp, antenna, receiver, clock
        m = np.arange(chirp.chirps) - 0.5 * (chirp.chirps - 1)
        n = np.arange(chirp.samples) - 0.5 * (chirp.samples - 1)
        self._in_chirp_s = n / chirp.sample_rate_hz
        self._chirp_at_s = m * chirp.repetition_s

    def amplitude(self, other: Transmission, path: Path) -> float:
        """Return A [counts]."""
        gain_in = float(self._antenna.rx.gain(np.array([path.direction_R]))[0])
        gain_out = float(other.antenna.tx.gain(np.array([path.direction_other_R]))[0])
        watts = other.receiver.tx_power_w * gain_in * gain_out
        way = other.chirp.wavelength_m / (_FOUR_PI * path.range_m)
        return self._receiver.counts_per_sqrt_watt * sqrt(watts) * way

    def add(self, other: Transmission, path: Path, t_s: float, signal: Float64) -> None:
        """Add to a frame whose middle is at `t_s`."""
        amplitude = self.amplitude(other, path)
        if amplitude < LEAST_COUNTS:
            return
        v, w = self._chirp, other.chirp
        # Seconds of the world in a second of each clock.
        rate, rate_other = 1.0 / (1.0 + 1e-6 * self._clock.clock_ppm), 1.0 / (1.0 + 1e-6 * other.clock.clock_ppm)
        # From the middle of the other's frame nearest to this one, so that differences keep their digits.
        lag_s = t_s * rate + self._clock.clock_offset_s - other.clock.clock_offset_s
        middle_s = floor(lag_s / (other.period_s * rate_other) + 0.5) * other.period_s * rate_other
        local_s = self._chirp_at_s[:, None] + self._in_chirp_s[None, :]
        delay_s = (path.range_m + path.speed_mps * local_s) / SPEED_OF_LIGHT_MPS
        frame_s = (lag_s - middle_s + rate * local_s - delay_s) / rate_other
        number = np.floor(frame_s / w.repetition_s + 0.5 * w.chirps)
        in_chirp_s = frame_s - (number - 0.5 * (w.chirps - 1)) * w.repetition_s
        sends = (number >= 0.0) & (number < w.chirps) & (np.abs(in_chirp_s) <= 0.5 * w.sampling_s)
        own_s = np.broadcast_to(self._in_chirp_s, sends.shape)
        beat_hz = (v.center_frequency_hz - w.center_frequency_hz) + (
            v.slope_hz_per_s * own_s - w.slope_hz_per_s * in_chirp_s
        )
        if v.parts == 2:
            band = (beat_hz >= 0.0) & (beat_hz < v.sample_rate_hz)
        else:
            band = np.abs(beat_hz) <= 0.5 * v.sample_rate_hz
        at = np.flatnonzero(sends & band)
        if not len(at):
            return
        x, y, f = own_s.reshape(-1)[at], in_chirp_s.reshape(-1)[at], beat_hz.reshape(-1)[at]
        cycles = v.center_frequency_hz * x - w.center_frequency_hz * y
        cycles += 0.5 * v.slope_hz_per_s * x * x - 0.5 * w.slope_hz_per_s * y * y
        re, im = self._filtered(f, amplitude)
        d = path.direction_R
        for k, r in enumerate(self._antenna.rx_positions_m):
            turned = (r[0] * d[0] + r[1] * d[1] + r[2] * d[2]) / w.wavelength_m
            phase = cycles - turned
            phase = (phase - np.rint(phase)) * TURN_RAD
            c, s = np.empty(len(at)), np.empty(len(at))
            cosines_and_sines(phase, c, s)
            signal[k * v.parts].reshape(-1)[at] += re * c - im * s
            if v.parts == 2:
                signal[2 * k + 1].reshape(-1)[at] += re * s + im * c

    def _filtered(self, beat_hz: Float64, amplitude: float) -> tuple[Float64, Float64]:
        """Return the amplitude times H of the receiver's filters (synthesis.py)."""
        re, im = np.full(len(beat_hz), amplitude), np.zeros(len(beat_hz))
        hp_hz, aaf_hz = self._receiver.hp_cutoff_hz, self._receiver.aaf_cutoff_hz
        if hp_hz is not None:
            scale = beat_hz / (beat_hz * beat_hz + hp_hz * hp_hz) * amplitude
            re, im = scale * beat_hz, scale * hp_hz
        if aaf_hz is not None:
            q = beat_hz / aaf_hz
            scale = 1.0 / (q * q + 1.0)
            re, im = (re + im * q) * scale, (im - re * q) * scale
        return re, im
