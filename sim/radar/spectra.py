"""Spectra of raw radar samples: noise by bin of beat frequency, and range-Doppler images. Offline.

Noise power of bin b of one frame (white noise of deviation sigma has sigma^2 in every bin):

    S_b = mean over d of |DFT_m( w_m (X[m,b] - mean_m X[m,b]) )[d]|^2 / (N sum w_m^2),     X[m,b] = DFT_n(x[m,n])[b]

The mean leaves out the Doppler bins d near zero, which hold static and slow objects. w is a split-cosine window (slopes
over 3/20 of the frame at each end), which keeps slow changes from leaking into the other bins.

A range-Doppler image is the magnitude of the two-dimensional DFT with Hann windows, normalised so that a sine of peak
amplitude A counts at the middle of a bin gives A. It has N / 2 range bins, and zero speed in row M / 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_SLOPE_SHARE = 0.3  # share of a frame in the two slopes of the window
_STATIC_SHARE = 1.0 / 16.0  # share of the Doppler bins, on either side of zero, that is left out


def noise_power(adc: NDArray[Any]) -> Float64:
    """Return the powers [counts^2] of each frame and receiver, (F, K, N / 2 + 1), of samples (F, K, M, N)."""
    chirps, samples = adc.shape[2:]
    window = _split_cosine(chirps)
    edge = static_bins(chirps)
    power = np.empty((*adc.shape[:2], samples // 2 + 1))
    for f, frame in enumerate(adc):
        x = frame.astype(np.float64)
        spectra = np.fft.rfft(x - x.mean(axis=1, keepdims=True), axis=-1) * window[:, None]
        doppler = np.fft.fft(spectra, axis=1)[:, edge : chirps - edge + 1]
        power[f] = (doppler.real**2 + doppler.imag**2).mean(axis=1)
    return power / (samples * float(window @ window))


def range_doppler(adc: NDArray[Any], *, remove_mean: bool = False) -> Float64:
    """Return the magnitudes (F, K, M, N / 2) of samples (F, K, M, N), without each chirp's mean.

    `remove_mean`: first subtract the mean of each sample over a frame's chirps, which removes static objects.
    """
    chirps, samples = adc.shape[2:]
    fast, slow = _hann(samples), _hann(chirps)
    images = np.empty((*adc.shape[:3], samples // 2))
    for f, frame in enumerate(adc):
        x = frame.astype(np.float64)
        if remove_mean:
            x = x - x.mean(axis=1, keepdims=True)
        x = x - x.mean(axis=-1, keepdims=True)
        spectra = np.fft.rfft(x * fast, axis=-1)[..., : samples // 2]
        doppler = np.fft.fftshift(np.fft.fft(spectra * slow[:, None], axis=1), axes=1)
        images[f] = np.abs(doppler)
    return images * (2.0 / (fast.sum() * slow.sum()))


def range_doppler_noise(images: Float64, *, first_bin: int = 1) -> Float64:
    """Return the rms per receiver [counts] of images (F, K, M, B) away from zero speed and from `first_bin` on."""
    chirps = images.shape[2]
    middle, edge = chirps // 2, static_bins(chirps)
    moving = np.abs(np.arange(chirps) - middle) >= edge
    rms: Float64 = np.sqrt((images[:, :, moving, first_bin:] ** 2).mean(axis=(0, 2, 3)))
    return rms


def static_bins(chirps: int) -> int:
    """Return the number of Doppler bins on either side of zero speed that count as static."""
    return max(2, round(chirps * _STATIC_SHARE))


def _hann(n: int) -> Float64:
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)


def _split_cosine(n: int) -> Float64:
    share = (np.arange(n) + 0.5) / n
    from_end = np.minimum(share, 1.0 - share)
    slope = 0.5 - 0.5 * np.cos(2.0 * np.pi * from_end / _SLOPE_SHARE)
    return np.where(from_end < 0.5 * _SLOPE_SHARE, slope, 1.0)
