"""Errors of the ranges to the satellites that a receiver tracks, and the fix from them.

    direct      the errors of the loops by its reflections (multipath.py), added
    reflected   the whole extra path, in the code; its rate in the Doppler, 2 (s . n) (n . v)

    w = sin^2(elevation) 10^(min(C/N0 - C/N0_open, 0) / 10)

Satellites whose residual exceeds the limit are left out one by one, the worst first, while six remain, of six in all;
for the velocity likewise beyond 2 m/s. Sums run in the order of the satellites (sim/native/gnss_fix.hpp).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.rotation import dot
from signals.samples import Vec3
from sim._kernels import solve_gnss
from sim.gnss.decibel import power
from sim.gnss.multipath import LoopErrors, loop_errors
from sim.gnss.parameters import ReceiverParameters
from sim.gnss.signals import Image, Signal

Float64 = NDArray[np.float64]

_LEAST_LEFT = 6
_MOST_REJECTED = 6
_RATE_LIMIT_MPS = 2.0  # of a residual of the Doppler
_TWO_PI = 2.0 * math.pi


class Ranges(NamedTuple):
    """Errors of the ranges of some signals, in their order."""

    code_m: list[float]
    rate_mps: list[float]
    carrier_m: list[float]
    weights: list[float]


class Position(NamedTuple):
    """Solution of one sample."""

    solved: bool
    used: list[int]  # of the signals given
    shift_m: tuple[float, float, float]
    speed_shift_mps: tuple[float, float, float]
    carrier_shift_m: tuple[float, float, float]
    variance: tuple[float, float, float]  # of a range of weight 1
    dilution: tuple[float, float, float, float]  # squares: east, north, up, time
    residual_m: float  # RMS with the weights, over what the solution leaves free


def ranges_of(signals: list[Signal], v_W: Vec3, receiver: ReceiverParameters) -> Ranges:
    """Return the errors of the ranges of tracked signals."""
    ranges = Ranges([], [], [], [])
    for signal in signals:
        code_m = rate_mps = carrier_m = 0.0
        if signal.image is not None:
            code_m = signal.image.reflection.extra_m
            rate_mps = _rate_mps(signal.image, v_W)
        else:
            for image in signal.images:
                errors = _beside(image, signal, v_W, receiver.correlator_spacing_chips)
                code_m += errors.code_chips * signal.system.chip_m
                carrier_m += errors.phase_rad / _TWO_PI * signal.system.wavelength_m
        sine = signal.direction[2]
        ranges.code_m.append(code_m)
        ranges.rate_mps.append(rate_mps)
        ranges.carrier_m.append(carrier_m)
        ranges.weights.append(sine * sine * power(signal.below_db))
    return ranges


def _rate_mps(image: Image, v_W: Vec3) -> float:
    return image.reflection.extra_rate * dot(image.reflection.rate_direction, v_W)


def _beside(image: Image, signal: Signal, v_W: Vec3, spacing_chips: float) -> LoopErrors:
    """Return the errors by a reflection beside the direct signal."""
    system, extra_m = signal.system, image.reflection.extra_m
    turns = extra_m / system.wavelength_m
    return loop_errors(
        math.sqrt(power(image.level_db - signal.level_db)),
        extra_m / system.chip_m,
        # A reflection turns the phase by half a turn.
        _TWO_PI * (turns - math.floor(turns) + 0.5),
        spacing_chips=spacing_chips,
        fading_hz=abs(_rate_mps(image, v_W)) / system.wavelength_m,
    )


class _Solution(NamedTuple):
    solved: bool
    kept: list[int]
    shift: tuple[float, float, float, float]
    variance: tuple[float, float, float, float]
    dilution: tuple[float, float, float, float]
    residuals: Float64


def _solve_without_outliers(
    directions: Float64, weights: Float64, errors: Float64, limit: float, height_error_m: float
) -> _Solution:
    kept = list(range(len(errors)))
    held = len(kept) == 3
    for left in range(_MOST_REJECTED, -1, -1):
        residuals = np.empty(len(kept))
        solved, shift, variance, dilution = solve_gnss(
            directions, weights, errors, residuals, held=held, height_error=height_error_m
        )
        if not solved or len(kept) <= _LEAST_LEFT or left == 0:
            break
        off = np.abs(residuals)
        worst = int(np.argmax(off))
        if off[worst] <= limit:
            break
        others = np.arange(len(kept)) != worst
        del kept[worst]
        directions, weights, errors = directions[others], weights[others], errors[others]
    return _Solution(solved, kept, shift, variance, dilution, residuals)


def solve(signals: list[Signal], ranges: Ranges, *, residual_limit_m: float, height_error_m: float) -> Position:
    """Return the solution. With three signals the height is held, which is wrong by `height_error_m`."""
    directions = np.array([signal.direction for signal in signals]).reshape(-1, 3)
    weights = np.array(ranges.weights)
    place = _solve_without_outliers(directions, weights, np.array(ranges.code_m), residual_limit_m, height_error_m)
    if not place.solved:
        zeros = (0.0, 0.0, 0.0)
        return Position(False, place.kept, zeros, zeros, zeros, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0), 0.0)
    used = place.kept
    directions, weights = np.ascontiguousarray(directions[used]), weights[used]
    speed = _solve_without_outliers(directions, weights, np.array(ranges.rate_mps)[used], _RATE_LIMIT_MPS, 0.0)
    carrier = _solve_without_outliers(directions, weights, np.array(ranges.carrier_m)[used], math.inf, height_error_m)
    free = len(used) - 4
    square = 0.0
    if free > 0:
        for weight, residual in zip(weights.tolist(), place.residuals.tolist(), strict=True):
            square += weight * residual * residual
        square /= free
    return Position(
        True,
        used,
        place.shift[:3],
        speed.shift[:3],
        carrier.shift[:3],
        place.variance[:3],
        place.dilution,
        math.sqrt(square),
    )


def open_variance(signals: list[Signal]) -> tuple[float, float, float]:
    """Return the variances of the fix of all satellites above the mask in the open, of a range of weight 1."""
    directions = np.array([signal.direction for signal in signals]).reshape(-1, 3)
    weights = np.array([signal.direction[2] * signal.direction[2] * power(0.0) for signal in signals])
    zeros = np.zeros(len(signals))
    solved, _, variance, _ = solve_gnss(directions, weights, zeros, np.empty(len(signals)))
    return variance[:3] if solved else (1.0, 1.0, 1.0)
