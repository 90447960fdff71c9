"""Colour and pattern of each surface of a seed: hue, brightness, contrast, scale, and where the pattern begins.

On a texture's texels, with m the texture's mean colour and H the rotation of colours about the grey axis:

    c' = brightness (H m + contrast (H c - H m)),  kept within 0 and 1

A surface of one colour has c = m. Codes of sRGB are changed, not linear light: a factor then looks alike on dark and
on bright surfaces. Only + - * / make the numbers, besides the sine and cosine of the hue, which are the same on every
machine too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hil.signals._kernel import det_cos, det_sin
from hil.signals.units import RAD_PER_DEG
from sim.randomize.draw import between, between_logarithms, dice
from sim.randomize.settings import TextureLimits

_PER_ROOT_3 = 0.5773502691896258
Rgb = tuple[float, float, float]
T = TypeVar("T", float, NDArray[np.float64])


@dataclass(frozen=True)
class SurfaceLook:
    """What one surface is made to look like."""

    hue_deg: float
    brightness: float
    contrast: float
    scale: float  # of the pattern; above 1 it is larger
    shift: tuple[float, float]  # share of the pattern by which it begins later, along its rows and columns

    def colour(self, rgb: Rgb) -> Rgb:
        """Of a surface, or of what multiplies its texture; codes of sRGB / 255."""
        r, g, b = (self.brightness * channel for channel in self._turned(*rgb))
        return _within(r), _within(g), _within(b)

    def texels(self, image: NDArray[np.uint8], *, shifted: bool = True) -> NDArray[np.uint8]:
        """(H, W, 3) codes of a texture. What does not repeat, such as the faces of a cube, cannot be shifted."""
        total = image.reshape(-1, 3).sum(axis=0, dtype=np.int64)
        mean = [float(t) / (image.shape[0] * image.shape[1]) for t in total]
        c = [image[:, :, i] - mean[i] for i in range(3)]
        # H is linear: H m + contrast H (c - m).
        middle, away = self._turned(*mean), self._turned(c[0], c[1], c[2])
        made = np.empty(image.shape, np.uint8)
        for i in range(3):
            value = (away[i] * self.contrast + middle[i]) * self.brightness
            made[:, :, i] = np.clip(value + 0.5, 0.0, 255.0).astype(np.uint8)
        if not shifted:
            return made
        rows, columns = (int(share * size) for share, size in zip(self.shift, image.shape[:2], strict=True))
        return np.roll(made, (rows, columns), axis=(0, 1))

    def _turned(self, r: T, g: T, b: T) -> tuple[T, T, T]:
        """Rotated about the grey axis."""
        angle = self.hue_deg * RAD_PER_DEG
        cosine, sine = det_cos(angle), det_sin(angle) * _PER_ROOT_3
        grey = (r + g + b) * ((1.0 - cosine) / 3.0)
        return (
            r * cosine + (b - g) * sine + grey,
            g * cosine + (r - b) * sine + grey,
            b * cosine + (g - r) * sine + grey,
        )


def draw_surface(limits: TextureLimits, seed: int, name: str, *, keeps_hue: bool) -> SurfaceLook:
    """Of the surface called `name`; a pure function."""
    rolled = dice(seed, "textures", name)
    hue_deg = between(rolled, limits.hue_deg)
    brightness = between(rolled, limits.brightness)
    contrast = between(rolled, limits.contrast)
    scale = between_logarithms(rolled, limits.scale)
    shift = (rolled.unit(), rolled.unit())
    return SurfaceLook(
        0.0 if keeps_hue else hue_deg, brightness, contrast, scale, shift if limits.shift else (0.0, 0.0)
    )


def _within(channel: float) -> float:
    return min(max(channel, 0.0), 1.0)
