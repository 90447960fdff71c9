"""Similarity of two radar recordings: normalised cross-correlation (NCC) of range-Doppler images. Offline.

    NCC(p, q) = sum (p - mean p)(q - mean q) / sqrt( sum (p - mean p)^2 sum (q - mean q)^2 )

over the pixels of one receiver's image, then the mean over receivers and over pairs of frames. Two frames of the same
sensor in the same scene differ by their noise, so `compare` gives the NCC of simulated and real frames together with
the NCC of pairs of different real frames. Variants of the images:

    linear           magnitude; leakage alone makes the NCC almost 1
    dB               20 log10 of the magnitude: noise counts as much as leakage
    dB, bins >= 5    as dB, without the bins that leakage fills
    mean removed     linear, after subtracting the mean over a frame's chirps from each sample
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.radar.spectra import noise_power, range_doppler, range_doppler_noise

Float64 = NDArray[np.float64]

_FIRST_CLEAR_BIN = 5
_MIN_MAGNITUDE = 1e-12  # [counts], for the logarithm


@dataclass(frozen=True)
class Correlation:
    """Correlation in one variant. The value between real frames is the reference."""

    simulated_against_real: float
    real_against_real: float

    @property
    def difference(self) -> float:
        return self.simulated_against_real - self.real_against_real

    def __str__(self) -> str:
        return (
            f"simulated against real {self.simulated_against_real:.4f}, real against real {self.real_against_real:.4f}"
        )


@dataclass(frozen=True)
class Comparison:
    """Comparison of a simulated recording with a real one."""

    ncc: Mapping[str, Correlation]
    noise_power_db: Float64  # (K, N / 2 + 1) simulated over real
    range_doppler_noise_db: Float64  # (K,) simulated over real
    odd_code_share: tuple[float, float]  # simulated, real


def _decibel(image: Float64) -> Float64:
    return 20.0 * np.log10(np.maximum(image, _MIN_MAGNITUDE))


_VARIANTS: Mapping[str, tuple[bool, Callable[[Float64], Float64]]] = {
    "linear": (False, lambda image: image),
    "dB": (False, _decibel),
    "dB, bins >= 5": (False, lambda image: _decibel(image[..., _FIRST_CLEAR_BIN:])),
    "mean removed": (True, lambda image: image),
}


def correlations(simulated: NDArray[Any], real: NDArray[Any]) -> dict[str, Correlation]:
    """Return the NCC of samples (F, K, M, N) by variant; it needs at least two real frames of the same K, M, N."""
    if simulated.shape[1:] != real.shape[1:]:
        raise ValueError(f"simulated frames are {simulated.shape[1:]} and real ones {real.shape[1:]}")
    if len(real) < 2 or len(simulated) < 1:
        raise ValueError("a correlation needs a simulated frame and two real ones")
    found = {}
    for remove_mean in (False, True):
        images = range_doppler(simulated, remove_mean=remove_mean), range_doppler(real, remove_mean=remove_mean)
        for name, (removes, view) in _VARIANTS.items():
            if removes is remove_mean:
                a, b = (_unit(view(image)) for image in images)
                found[name] = Correlation(_mean_product(a, b, same=False), _mean_product(b, b, same=True))
    return found


def compare(simulated: NDArray[Any], real: NDArray[Any]) -> Comparison:
    """Return all figures that compare a simulated recording with a real one."""

    def decibel(a: Float64, b: Float64) -> Float64:
        ratio: Float64 = 10.0 * np.log10(a / b)
        return ratio

    return Comparison(
        ncc=correlations(simulated, real),
        noise_power_db=decibel(noise_power(simulated).mean(axis=0), noise_power(real).mean(axis=0)),
        range_doppler_noise_db=2.0
        * decibel(range_doppler_noise(range_doppler(simulated)), range_doppler_noise(range_doppler(real))),
        odd_code_share=(odd_code_share(simulated), odd_code_share(real)),
    )


def odd_code_share(adc: NDArray[Any]) -> float:
    return float((adc & 1).mean())


def _unit(images: Float64) -> Float64:
    """Return images (F, K, ...) as (K, F, pixels), each of mean 0 and length 1."""
    flat = images.reshape(*images.shape[:2], -1)
    flat = flat - flat.mean(axis=-1, keepdims=True)
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    return np.swapaxes(flat / np.where(length > 0.0, length, 1.0), 0, 1)


def _mean_product(a: Float64, b: Float64, *, same: bool) -> float:
    """Return the mean product over receivers and pairs of frames; `same`: without pairs of a frame with itself."""
    products = a @ np.swapaxes(b, 1, 2)
    if not same:
        return float(products.mean())
    frames = products.shape[1]
    return float(products[:, ~np.eye(frames, dtype=bool)].mean())
