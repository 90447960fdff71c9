"""Tone curve of the path tracer's camera: light to sRGB codes.

With x the light relative to a white surface in the reference light (sim/frame/path_traced/sky.py):

    y = x^a / (b x^(a d) + c)                                   (Lottes, GDC 2016)

a raises the contrast as a camera's picture style does, d shapes the shoulder. b and c follow from two points of the
curve: `_MIDDLE_IN` becomes `_MIDDLE_OUT`, and `_BRIGHTEST` becomes 1. The sRGB transfer function (IEC 61966-2-1)
follows.
"""

from __future__ import annotations

import numpy as np

_CONTRAST, _SHOULDER = 1.16, 0.977
_MIDDLE_IN, _MIDDLE_OUT = 0.14, 0.205
_BRIGHTEST = 7.0


def _coefficients() -> tuple[float, float]:
    a, d, m, out, top = _CONTRAST, _SHOULDER, _MIDDLE_IN, _MIDDLE_OUT, _BRIGHTEST
    per = 1.0 / ((top ** (a * d) - m ** (a * d)) * out)
    return (top**a * out - m**a) * per, (top ** (a * d) * m**a - top**a * m ** (a * d) * out) * per


_B, _C = _coefficients()


def curve(x: np.ndarray) -> np.ndarray:
    """Return the share of the display's light, 0 to 1."""
    x = np.clip(x, 0.0, _BRIGHTEST)
    result: np.ndarray = x**_CONTRAST / (_B * x ** (_CONTRAST * _SHOULDER) + _C)
    return np.clip(result, 0.0, 1.0)


def to_srgb(light: np.ndarray, white: float, balance: np.ndarray) -> np.ndarray:
    """Return codes (height, width, 3) of radiance. `white`: that of a white surface; `balance`: factors (3,)."""
    y = curve(np.nan_to_num(light) * (balance / white))
    codes = np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1.0 / 2.4) - 0.055)
    return (codes * 255.0 + 0.5).astype(np.uint8)
