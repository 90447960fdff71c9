"""Calibration of a radar's impairments from a recording of an empty, still scene. Offline.

    x[f,k,m,n] = p_k[n] + e^{-m T_c / decay} q_k[n] + dc wander + noise + rounding

x is sample n of chirp m of receiver k in frame f. p and q are fitted by least squares over the chirps of the mean
frame, for the decay with the smallest residual. Noise is the power away from zero Doppler (sim/radar/spectra.py) minus
the white power of the converter's rounding, which follows from its share of odd codes (`Adc.noise_power`). The DC
wander is the excess of bin 0 over bin 1:

    sigma_k^2 = (S_k0 - S_k1) / N

Reflectors (sim/radar/static_echoes.py) are part of p but not a property of the sensor, so they are removed unless
`keep_echoes` is set. Uncertainties (one sigma) come from the spread between frames, or between four parts of the
recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # loads its packages when they are first used
from numpy.typing import NDArray

from signals.errors import ConfigError, Problem
from sim.radar.comparison import odd_code_share
from sim.radar.impairments import Adc, DcWander, FrameStart, Impairments, Leakage, ReceiverNoise
from sim.radar.recording import ADC_BITS, Recording
from sim.radar.spectra import noise_power, range_doppler, range_doppler_noise
from sim.radar.static_echoes import StaticEcho, echo_pattern, find_static_echoes
from sim.radar.swept_pattern import SweptPattern

Float64 = NDArray[np.float64]

MIN_FRAMES = 8
MIN_CHIRPS = 16
DEFAULT_HP_CUTOFF_HZ = 80e3
_PARTS = 4  # parts of a recording, for uncertainties
_MIN_START_POWER = 2.0  # of the frame's start, relative to the power that noise alone would give
_ENVELOPE_PARTS = 8  # parts of a chirp
_DIGITS = 3  # decimals of counts in a preset
_MAX_CLIPPED_SHARE = 1e-4  # without a warning
_MOST_CLIPPED_SHARE = 0.01  # with one; beyond, the figures are those of the converter's ends
_MIN_MOTION = 100.0  # change of a bin between frames, relative to the median bin, that shows motion in the scene


@dataclass(frozen=True)
class Fitted:
    """Row of the table of results: one value for each receiver, or one for all."""

    name: str
    unit: str
    value: tuple[float, ...]
    sigma: tuple[float, ...]


@dataclass(frozen=True)
class Calibration:
    impairments: Impairments
    rows: tuple[Fitted, ...]
    echoes: tuple[StaticEcho, ...]
    keeps_echoes: bool
    warnings: tuple[str, ...]
    frames: tuple[int, int]  # [from, to) of the recording
    measured_power: Float64  # (K, N / 2 + 1), including rounding and wander
    pattern: Float64  # (K, N), including the echoes, without DC


@dataclass(frozen=True)
class _Start:
    pattern: Float64  # p (K, N)
    start: Float64  # q (K, N)
    decay_s: float | None  # None: no decay


def calibrate(
    recording: Recording, *, frames: tuple[int, int] | None = None, keep_echoes: bool = False, where: str = "recording"
) -> Calibration:
    """Fit all impairments. Raises ConfigError, in which `where` names the recording."""
    first, last = frames or (0, recording.frames)
    _check(recording, first, last, where)
    adc, chirp = recording.adc[first:last], recording.chirp
    x_mean = _mean_frames(adc)
    start = _frame_start(x_mean.mean(axis=0), chirp.repetition_s, _mean_noise(adc))
    power = noise_power(adc)
    share = odd_code_share(adc)
    image_noise = range_doppler_noise(range_doppler(adc))
    dc = start.pattern.mean(axis=1)
    varying = start.pattern - dc[:, None]
    echoes = find_static_echoes(varying, np.maximum(image_noise, 1e-6), chirp)
    fixed = varying if keep_echoes else varying - echo_pattern(echoes, *varying.shape)

    adc_model = Adc(odd_code_share=round(min(share, 0.5), 4))
    mean_power = power.mean(axis=0)
    sigma = _wander(mean_power, chirp.samples)
    impairments = Impairments(
        leakage=Leakage(dc=_rounded(dc), sweep=_sweep(fixed, recording)),
        frame_start=FrameStart(decay_s=float(f"{start.decay_s:.3g}"), sweep=_sweep(start.start, recording))
        if start.decay_s is not None
        else None,
        dc_wander=DcWander(sigma=_rounded(sigma)),
        noise=ReceiverNoise(
            bin_hz=chirp.sample_rate_hz / chirp.samples,
            power=_rows(_receiver_noise(mean_power, adc_model)),
            envelope=_rows(_envelope(adc, adc_model)),
        ),
        adc=adc_model,
    )
    return Calibration(
        impairments=impairments,
        rows=tuple(_table(adc, x_mean, power, start, image_noise, chirp.repetition_s)),
        echoes=tuple(echoes),
        keeps_echoes=keep_echoes,
        warnings=tuple(_warnings(adc, echoes, keep_echoes, share, recording)),
        frames=(first, last),
        measured_power=mean_power,
        pattern=varying,
    )


def _check(recording: Recording, first: int, last: int, where: str) -> None:
    problems = []
    if not 0 <= first < last <= recording.frames:
        message = f"frames {first}:{last} are requested, but the recording has {recording.frames}"
        problems.append(Problem(where, message, f"the whole recording is 0:{recording.frames}"))
    elif last - first < MIN_FRAMES:
        message = f"{last - first} frames are too few: noise needs {MIN_FRAMES} or more"
        problems.append(Problem(where, message, "record for several seconds"))
    if recording.chirp.chirps < MIN_CHIRPS:
        message = f"{recording.chirp.chirps} chirps per frame are too few: noise needs {MIN_CHIRPS} or more"
        problems.append(Problem(where, message))
    if not problems:
        adc = recording.adc[first:last]
        constant = [k + 1 for k in range(recording.receivers) if int(adc[:, k].max()) == int(adc[:, k].min())]
        problems += [Problem(where, f"receiver {k} shows one code only: it is not connected") for k in constant]
        problems += [] if constant else _unusable(adc, first, where)
    if problems:
        raise ConfigError(problems)


def _unusable(adc: NDArray[Any], first: int, where: str) -> list[Problem]:
    """Return why these frames, of which the first has this number, show no noise."""
    problems = []
    repeats = [first + i for i in range(1, len(adc)) if np.array_equal(adc[i], adc[i - 1])]
    if repeats:
        more = f", as {len(repeats) - 1} more do" if len(repeats) > 1 else ""
        message = f"frame {repeats[0]} repeats the one before it to the last code{more}: noise never does"
        problems.append(Problem(where, message, "record again, or choose others: --frames"))
    if (clipped := _clipped_share(adc)) > _MOST_CLIPPED_SHARE:
        message = f"{100.0 * clipped:.3g} % of the samples are clipped, which hides leakage and noise"
        problems.append(Problem(where, message, "record with less gain, or nothing near"))
    return problems


def _mean_frames(adc: NDArray[Any]) -> Float64:
    """Return the mean frame of each part of the recording, (parts, K, M, N)."""
    return np.stack([part.mean(axis=0) for part in np.array_split(adc, _PARTS)])


def _mean_noise(adc: NDArray[Any]) -> Float64:
    """Return the variance of a sample of the mean frame by noise alone, (K,)."""
    frames = len(adc)
    within = np.mean([frame.var(axis=1).mean(axis=-1) for frame in adc], axis=0)
    return within / frames


def _frame_start(mean: Float64, repetition_s: float, noise: Float64) -> _Start:
    """Fit p, q and the decay to the mean frame (K, M, N)."""
    chirps = mean.shape[1]
    frame_s = chirps * repetition_s
    weight = 1.0 / np.maximum(noise, 1e-12)

    def cost(decay_s: float) -> float:
        p, q, e = _decompose(mean, decay_s, repetition_s)
        residual = mean - p[:, None] - e[:, None] * q[:, None]
        return float((weight * (residual**2).sum(axis=(1, 2))).sum())

    grid = np.geomspace(2.0 * repetition_s, frame_s, 40)
    costs = [cost(float(decay_s)) for decay_s in grid]
    best = int(np.argmin(costs))
    if best in (0, len(grid) - 1):
        return _Start(mean.mean(axis=1), np.zeros_like(mean[:, 0]), None)
    low, high = float(grid[best - 1]), float(grid[best + 1])
    decay_s = float(
        scipy.optimize.minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * low}).x
    )
    p, q, e = _decompose(mean, decay_s, repetition_s)
    # Variance of q by noise alone, that is of the coefficient of e in a fit of a constant and e.
    expected = noise / ((e - e.mean()) ** 2).sum()
    if float(((q**2).mean(axis=1) / expected).mean()) < _MIN_START_POWER:
        return _Start(mean.mean(axis=1), np.zeros_like(q), None)
    return _Start(p, q, decay_s)


def _decompose(mean: Float64, decay_s: float, repetition_s: float) -> tuple[Float64, Float64, Float64]:
    """Return p (K, N), q (K, N) and e (M,) by least squares."""
    e = np.exp(-np.arange(mean.shape[1]) * repetition_s / decay_s)
    inverse = np.linalg.pinv(np.column_stack([np.ones_like(e), e]))
    p, q = (np.einsum("m,kmn->kn", row, mean) for row in inverse)
    return p, q, e


def _wander(power: Float64, samples: int) -> Float64:
    sigma: Float64 = np.sqrt(np.maximum(power[:, 0] - power[:, 1], 0.0) / samples)
    return sigma


def _receiver_noise(power: Float64, adc: Adc) -> Float64:
    """Return the noise of the receiver alone: without rounding, and without wander, which is only in bin 0."""
    receiver_power = np.maximum(power - adc.noise_power, 0.0)
    receiver_power[:, 0] = np.minimum(receiver_power[:, 0], receiver_power[:, 1])
    return receiver_power


def _envelope(adc: NDArray[Any], model: Adc) -> Float64:
    """Return the rms of the noise over the chirp, normalised to a mean square of 1, (K, parts).

    Only the upper two thirds of the bins are used, because wander and leakage do not reach them.
    """
    samples = adc.shape[3]
    kept = np.arange(samples // 2 + 1) >= samples // 6
    change = np.diff(adc.astype(np.float64), axis=2)
    high = np.fft.irfft(np.fft.rfft(change, axis=-1) * kept, samples, axis=-1)
    # A difference of two chirps has twice the noise power of one. The rounding's power in the used bins is subtracted.
    power = 0.5 * (high**2).mean(axis=(0, 2)) - model.noise_power * (1.0 - 2.0 * (samples // 6) / samples)
    parts = np.stack([part.mean(axis=-1) for part in np.array_split(np.maximum(power, 0.0), _ENVELOPE_PARTS, axis=-1)])
    total = np.maximum(parts.mean(axis=0), 1e-12)
    return np.asarray(np.sqrt(parts / total).T)


def _sweep(pattern: Float64, recording: Recording) -> SweptPattern:
    chirp = recording.chirp
    return SweptPattern(
        start_frequency_hz=chirp.start_frequency_hz,
        bandwidth_hz=chirp.bandwidth_hz,
        sample_rate_hz=chirp.sample_rate_hz,
        hp_cutoff_hz=recording.hp_cutoff_hz or DEFAULT_HP_CUTOFF_HZ,
        counts=_rows(pattern),
    )


def _rounded(row: Float64) -> tuple[float, ...]:
    return tuple(round(float(v), _DIGITS) for v in row)


def _rows(rows: Float64) -> tuple[tuple[float, ...], ...]:
    return tuple(_rounded(row) for row in rows)


def _table(
    adc: NDArray[Any], parts: Float64, power: Float64, start: _Start, image_noise: Float64, repetition_s: float
) -> list[Fitted]:
    frames, _, _, samples = adc.shape
    split = np.array_split(adc, _PARTS)

    def spread(values: Float64) -> Float64:
        """Return one sigma of the mean along axis 0."""
        return np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))

    def row(name: str, unit: str, value: Any, sigma: Any) -> Fitted:
        pair = (tuple(float(v) for v in np.atleast_1d(x)) for x in (value, sigma))
        return Fitted(name, unit, *pair)

    def varying(mean: Float64) -> Float64:
        return np.asarray(mean.mean(axis=1).std(axis=-1))

    frame_dc = adc.mean(axis=(2, 3))
    means = power.mean(axis=0)
    errors = power.std(axis=0, ddof=1) / np.sqrt(frames)
    wanders = np.stack([_wander(p.mean(axis=0), samples) for p in np.array_split(power, _PARTS)])
    rows = [
        row("DC", "counts", frame_dc.mean(axis=0), spread(frame_dc)),
        row("fixed pattern, rms", "counts", varying(parts.mean(axis=0)), spread(np.stack([varying(p) for p in parts]))),
    ]
    if start.decay_s is not None:
        rms = np.sqrt((start.start**2).mean(axis=1))
        part_starts = [_frame_start(p, repetition_s, _mean_noise(s)) for p, s in zip(parts, split, strict=True)]
        decays = np.array([part.decay_s for part in part_starts if part.decay_s is not None])
        starts = np.stack([_decompose(p, start.decay_s, repetition_s)[1] for p in parts])
        rows.append(row("frame start, rms", "counts", rms, np.sqrt((spread(starts) ** 2).mean(axis=1))))
        # Parts that are too short show no decay; a spread needs at least two parts.
        sigma = spread(decays) if len(decays) > 1 else np.nan
        rows.append(row("frame start, decay", "ms", 1e3 * start.decay_s, 1e3 * sigma))
    rows.append(row("DC wander", "counts", _wander(means, samples), spread(wanders)))
    bins = sorted({1, 2, 4, samples // 8, samples // 4, 3 * samples // 8, samples // 2})
    rows += [row(f"noise, bin {b}", "counts^2", means[:, b], errors[:, b]) for b in bins if b < means.shape[1]]
    images = np.stack([range_doppler_noise(range_doppler(s)) for s in split])
    rows.append(row("range-Doppler rms", "counts", image_noise, spread(images)))
    shares = np.array([odd_code_share(s) for s in split])
    rows.append(row("share of odd codes", "", odd_code_share(adc), spread(shares)))
    return rows


def _warnings(adc: NDArray[Any], echoes: list[StaticEcho], keep: bool, share: float, recording: Recording) -> list[str]:
    found = []
    if echoes:
        ranges = ", ".join(f"{echo.range_m:.2f}" for echo in echoes)
        action = "kept in" if keep else "removed from"
        found.append(
            f"reflectors at {ranges} m were {action} the pattern: calibrate in an empty scene for a preset that fits "
            "any scene"
        )
    clipped = _clipped_share(adc)
    if clipped > _MAX_CLIPPED_SHARE:
        found.append(f"{100.0 * clipped:.2g} % of the samples are clipped: leakage and noise are larger than fitted")
    if share > 0.5:
        found.append(
            f"odd codes are {100.0 * share:.1f} % of all, more than even ones, which is not modelled: 50 % is used"
        )
    if recording.hp_cutoff_hz is None:
        found.append(f"the settings have no hp_cutoff_Hz: {DEFAULT_HP_CUTOFF_HZ / 1e3:g} kHz is used")
    moved = _moved(adc)
    if moved:
        ranges = ", ".join(f"{b * recording.chirp.range_resolution_m:.2f}" for b in moved)
        found.append(
            f"something moved during the recording, about {ranges} m away: the fitted noise there may be too high"
        )
    return found


def _clipped_share(adc: NDArray[Any]) -> float:
    return float(((adc == 0) | (adc == 2**ADC_BITS - 1)).mean())


def _moved(adc: NDArray[Any]) -> list[int]:
    """Return the bins beyond leakage whose mean chirp changes between frames by more than noise explains."""
    spectra = np.fft.rfft(adc.mean(axis=2) * np.hanning(adc.shape[3]), axis=-1)
    change = (np.abs(spectra - spectra.mean(axis=0)) ** 2).mean(axis=(0, 1))
    middle = float(np.median(change[1:]))
    changed = np.flatnonzero(change > _MIN_MOTION * middle)
    return [int(b) for b in changed if b >= 1 and change[b] == change[max(b - 1, 0) : b + 2].max()]
