"""Random colour and pattern of a surface: hue, brightness, contrast, scale and shift of the pattern.

With m the mean colour of a texture and H the rotation of colours about the grey axis, its texels c become

    c' = brightness (H m + contrast (H c - H m)),  limited to 0 .. 1

A surface of one colour has c = m. The change applies to sRGB codes, not to linear light, so that a factor looks the
same on dark and bright surfaces. Only + - * / and the sine and cosine of `signals._kernel` are used, so the bits are
the same on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_sin
from signals.units import RAD_PER_DEG
from sim.scene.appearance import TextureLimits
from sim.scene.random_generator import feature_rng

_PER_ROOT_3 = 0.5773502691896258
Rgb = tuple[float, float, float]
T = TypeVar("T", float, NDArray[np.float64])
NO_SHIFT = (0.0, 0.0)


@dataclass(frozen=True)
class SurfaceAppearance:
    """Colour and pattern of one surface, relative to the map's."""

    hue_deg: float
    brightness: float
    contrast: float
    scale: float  # of the pattern; above 1: larger
    shift: tuple[float, float]  # of the pattern along its rows and columns, as a share of its size

    def colour(self, rgb: Rgb) -> Rgb:
        """Return the changed colour of a surface; sRGB codes / 255."""
        r, g, b = (self.brightness * channel for channel in self._rotated(*rgb))
        return _clipped(r), _clipped(g), _clipped(b)

    def texels(self, image: NDArray[np.uint8], *, shifts: bool = True) -> NDArray[np.uint8]:
        """Return the changed texture, (H, W, 3) sRGB codes. Cube maps cannot be shifted: their faces do not repeat."""
        total = image.reshape(-1, 3).sum(axis=0, dtype=np.int64)
        mean = [float(t) / (image.shape[0] * image.shape[1]) for t in total]
        c = [image[:, :, i] - mean[i] for i in range(3)]
        # H is linear: H m + contrast H (c - m).
        rotated_mean, deviation = self._rotated(*mean), self._rotated(c[0], c[1], c[2])
        changed = np.empty(image.shape, np.uint8)
        for i in range(3):
            value = (deviation[i] * self.contrast + rotated_mean[i]) * self.brightness
            changed[:, :, i] = np.clip(value + 0.5, 0.0, 255.0).astype(np.uint8)
        return shifted(changed, self.shift) if shifts else changed

    def _rotated(self, r: T, g: T, b: T) -> tuple[T, T, T]:
        """Return a colour rotated about the grey axis."""
        angle = self.hue_deg * RAD_PER_DEG
        cosine, sine = det_cos(angle), det_sin(angle) * _PER_ROOT_3
        grey = (r + g + b) * ((1.0 - cosine) / 3.0)
        return (
            r * cosine + (b - g) * sine + grey,
            g * cosine + (r - b) * sine + grey,
            b * cosine + (g - r) * sine + grey,
        )


def draw_surface(limits: TextureLimits, seed: int, name: str, *, keeps_hue: bool) -> SurfaceAppearance:
    """Draw the appearance of the surface called `name`, as a pure function of the arguments."""
    rng = feature_rng(seed, "textures", name)
    hue_deg = rng.between(*limits.hue_deg)
    brightness = rng.between(*limits.brightness)
    contrast = rng.between(*limits.contrast)
    scale = rng.log_between(*limits.scale)
    shift = (rng.unit(), rng.unit())
    return SurfaceAppearance(
        0.0 if keeps_hue else hue_deg, brightness, contrast, scale, shift if limits.shift else NO_SHIFT
    )


def shifted(image: NDArray[np.uint8], shift: tuple[float, float]) -> NDArray[np.uint8]:
    """Return a repeating image (H, W, ...) shifted along its rows and columns, by shares of its size."""
    rows, columns = (int(share * size) for share, size in zip(shift, image.shape[:2], strict=True))
    return np.roll(image, (rows, columns), axis=(0, 1))


def _clipped(channel: float) -> float:
    return min(max(channel, 0.0), 1.0)
