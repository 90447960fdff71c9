"""Noise of `NoiseSettings`, in the manner of AirSim's documentation of them. It is off unless the settings enable it.

    HorzDistortion   each row moves sideways by up to `strength` of the width
    HorzWave         a band of rows bulges sideways by up to `strength` of the width; it moves over the picture
    HorzNoiseLines   of a share `density_y` of the rows, a share `density_xy` of the pixels is random
    Rand             each pixel is mixed with a random shade u^density, u uniform: the higher, the fewer bright ones

`contrib` is the share of each effect in the pixel. The noise depends on the camera, the time and the image type alone.
RandSpeed and RandSize, which belong to Unreal's texture of noise, have no effect.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.settings.cameras import Noise
from signals.noise import noise_key

_BAND = 0.1  # half the height of the wave's band at a size of 1


def with_noise(rgb: NDArray[np.uint8], noise: Noise, name: str, t_ns: int) -> NDArray[np.uint8]:
    """Return a picture with noise; `name` tells one camera and image type from another."""
    random = np.random.Generator(np.random.Philox(key=noise_key(t_ns & 0x7FFFFFFFFFFFFFFF, name)))
    height, width = rgb.shape[:2]
    picture = rgb.astype(np.float32)
    strength = noise.horz_distortion_strength * (2.0 * random.random(height) - 1.0)
    picture = _mixed(picture, _moved(picture, strength * width), noise.horz_distortion_contrib)
    rows = (np.arange(height) + 0.5) / height
    half = max(_BAND * abs(noise.horz_wave_vert_size), 1.0 / height)
    bulge = np.maximum(0.0, 1.0 - ((rows - random.random()) / half) ** 2)
    picture = _mixed(picture, _moved(picture, noise.horz_wave_strength * width * bulge), noise.horz_wave_contrib)
    shade = 255.0 * random.random((height, width, 1), np.float32)
    hit = random.random((height, 1, 1)) < noise.horz_noise_lines_density_y
    hit = hit & (random.random((height, width, 1)) < noise.horz_noise_lines_density_xy)
    picture = np.where(hit, _mixed(picture, shade, noise.horz_noise_lines_contrib), picture)
    exponent = round(min(max(noise.rand_density, 1.0), 16.0))
    u = random.random((height, width, 1), np.float32)
    grain = np.full_like(u, 255.0)
    for _ in range(exponent):
        grain *= u
    picture = _mixed(picture, grain, noise.rand_contrib)
    return np.clip(picture + 0.5, 0.0, 255.0).astype(np.uint8)


def _mixed(picture: NDArray[np.float32], other: NDArray[np.float32], share: float) -> NDArray[np.float32]:
    part = np.float32(min(max(share, 0.0), 1.0))
    return picture + part * (other - picture)


def _moved(picture: NDArray[np.float32], by_px: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the rows moved sideways; pixels at the edges are repeated."""
    height, width = picture.shape[:2]
    by = np.clip(np.rint(by_px), -width, width).astype(np.int64)
    columns = np.clip(np.arange(width)[None, :] - by[:, None], 0, width - 1)
    return picture[np.arange(height)[:, None], columns]
