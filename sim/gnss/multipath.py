"""Errors of a receiver's loops by one reflection beside the direct signal.

The code loop takes the difference of an early and a late correlator, d chips apart. With the triangle R(t) = 1 - |t|
for the correlation of a chip of length 1 (an infinite bandwidth), a reflection of relative amplitude a, delay D [chips]
and phase phi puts the zero of

    R(e + d/2) - R(e - d/2) + a cos phi (R(e - D + d/2) - R(e - D - d/2)) = 0

to, with s = a cos phi (van Nee, IEEE PLANS 1992; Braasch in Parkinson and Spilker, Global Positioning System, 1996, ch.
14),

    e = s D / (1 + s)                    for D <= (1 + s) d / 2
    e = s d / 2                          up to  D = 1 - (1 - s) d / 2
    e = s (1 + d / 2 - D) / (2 - s)      up to  D = 1 + d / 2,         0 beyond

phi = 0 and 180 degrees are the two sides of the published envelope. The carrier's error and the change of the amplitude
are

    psi = atan2(b sin phi, 1 + b cos phi)    A = sqrt(1 + 2 b cos phi + b^2),   b = a R(D)

While the receiver moves, phi turns with the fading frequency f. A loop of bandwidth B follows with 1 / sqrt(1 + (f /
B)^2); the code loop is carrier-aided, B = 1 Hz. Several reflections add their errors, which holds for small amplitudes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from signals._kernel import det_atan2, det_cos, det_sin

CODE_LOOP_HZ = 1.0
_MOST = 0.95  # of the amplitude of a reflection: beyond, the loops would follow it


class LoopErrors(NamedTuple):
    """Errors by one reflection."""

    code_chips: float
    phase_rad: float
    amplitude: float


def code_error_chips(amplitude: float, delay_chips: float, spacing_chips: float) -> float:
    """Return the error of the code; `amplitude`: a cos phi, above -1."""
    s, d, delay = amplitude, spacing_chips, delay_chips
    if delay <= 0.5 * (1.0 + s) * d:
        return s * delay / (1.0 + s)
    if delay <= 1.0 - 0.5 * (1.0 - s) * d:
        return 0.5 * s * d
    if delay < 1.0 + 0.5 * d:
        return s * (1.0 + 0.5 * d - delay) / (2.0 - s)
    return 0.0


def loop_errors(
    amplitude: float, delay_chips: float, phase_rad: float, *, spacing_chips: float, fading_hz: float = 0.0
) -> LoopErrors:
    """Return the errors by a reflection of this amplitude and phase."""
    a = min(amplitude, _MOST)
    cosine, sine = det_cos(phase_rad), det_sin(phase_rad)
    ratio = fading_hz / CODE_LOOP_HZ
    followed = 1.0 / math.sqrt(1.0 + ratio * ratio)
    b = a * max(0.0, 1.0 - delay_chips)
    in_phase = 1.0 + b * cosine
    return LoopErrors(
        followed * code_error_chips(a * cosine, delay_chips, spacing_chips),
        det_atan2(b * sine, in_phase),
        math.sqrt(in_phase * in_phase + b * b * sine * sine),
    )


def reflection_amplitude(cosine: float, permittivity: float, *, conducts: bool, cross_polar: float) -> float:
    """Return the amplitude of a reflection at a right-handed antenna, for incidence at the angle of `cosine`.

        G_s = (c - q) / (c + q),  G_p = (eps c - q) / (eps c + q),   q = sqrt(eps - sin^2)       (Fresnel)
        co-polar (G_p + G_s) / 2, cross-polar (G_p - G_s) / 2

    A metal has G_s = -1, G_p = 1. `cross_polar`: the antenna's amplitude for the left-handed part. The permittivity of
    a building's materials is the same at 1.6 GHz as at 60 GHz, and their conductivity does not count (ITU-R P.2040).
    """
    if conducts:
        across, along = -1.0, 1.0
    else:
        q = math.sqrt(permittivity - (1.0 - cosine * cosine))
        across = (cosine - q) / (cosine + q)
        along = (permittivity * cosine - q) / (permittivity * cosine + q)
    right, left = 0.5 * (along + across), 0.5 * (along - across) * cross_polar
    return math.sqrt(right * right + left * left)
