"""The transfer function of sRGB (IEC 61966-2-1), with the same bits on every machine. Codes are code / 255."""

from __future__ import annotations

from signals._kernel import det_pow


def linear(code: float) -> float:
    """Return the light of an sRGB code."""
    return code / 12.92 if code <= 0.04045 else det_pow((code + 0.055) / 1.055, 2.4)


def srgb(light: float) -> float:
    """Return the sRGB code of linear light."""
    return 12.92 * light if light <= 0.0031308 else 1.055 * det_pow(light, 1.0 / 2.4) - 0.055
