"""Rain in a radar's way: attenuation, and the echoes of drops.

Attenuation (Recommendation ITU-R P.838-3, for circular polarisation and level paths), with the rate r in mm/h:

    gamma = k r^alpha [dB/km],   k = (k_H + k_V) / 2,   alpha = (k_H alpha_H + k_V alpha_V) / (2 k)

with the sums of the Recommendation's tables 1 to 4 over log10 of the frequency in GHz, from 1 to 1000 GHz.

Backscatter of a volume, from Mie's series over the drop sizes of Marshall and Palmer (J. Meteorology 5, 1948, p. 165):

    eta = integral of sigma_b(D) N(D) dD [m^2/m^3],   N(D) = 8000 exp(-4.1 r^-0.21 D) [1/(m^3 mm)], D in mm to 7
    sigma_b = (pi / k^2) |sum of (2 n + 1) (-1)^n (a_n - b_n)|^2   (Bohren and Huffman, 1983, sec. 4.4)

with water of 10 degrees Celsius (Liebe, Hufford and Manabe, Int. J. Infrared Millim. Waves 12, 1991, p. 659). Drops
fall at v(D) = 9.65 - 10.3 exp(-0.6 D) m/s, D in mm (Atlas, Srivastava and Sekhon, Rev. Geophys. 11, 1973, p. 1).

A frame has `ECHOES` echoes of drops: each at a random pixel's direction and a random range out to what is seen there,
and of a random size, which sets its speed. An echo stands for its share of the volume, so that the expected power is
that of

    dP = P_t G_t G_r lambda^2 eta R^2 dOmega dR / ((4 pi)^3 R^4)

Determinism: setup in Python floats with det_*, the frame in + - * / sqrt of single elements and counted random numbers.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_exp, det_log, det_pow, det_sin
from signals.noise import noise_key
from signals.rotation import dot
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.echoes import Echoes

Float64 = NDArray[np.float64]
Complex = tuple[float, float]

ECHOES = 4096
NEAREST_M = 0.1  # nearer drops are left out: a single one would be seen, and no mean
_LN_10 = 2.302585092994046
_DROPS_PER_M3_MM = 8000.0
_STEP_MM, _GREATEST_MM = 0.05, 7.0
_WATER_K = 283.15
_NODES = 4096
# a_j, b_j, c_j; then m and c. Recommendation ITU-R P.838-3 (2005), tables 1 to 4.
_K_H = (
    (
        (-5.33980, -0.10008, 1.13098),
        (-0.35351, 1.26970, 0.45400),
        (-0.23789, 0.86036, 0.15354),
        (-0.94158, 0.64552, 0.16817),
    ),
    -0.18961,
    0.71147,
)
_K_V = (
    (
        (-3.80595, 0.56934, 0.81061),
        (-3.44965, -0.22911, 0.51059),
        (-0.39902, 0.73042, 0.11899),
        (0.50167, 1.07319, 0.27195),
    ),
    -0.16398,
    0.63297,
)
_ALPHA_H = (
    (
        (-0.14318, 1.82442, -0.55187), (0.29591, 0.77564, 0.19822), (0.32177, 0.63773, 0.13164),
        (-5.37610, -0.96230, 1.47828), (16.1721, -3.29980, 3.43990),
    ),
    0.67849,
    -1.95537,
)  # fmt: skip
_ALPHA_V = (
    (
        (-0.07771, 2.33840, -0.76284), (0.56727, 0.95545, 0.54039), (-0.20238, 1.14520, 0.26809),
        (-48.2991, 0.791669, 0.116226), (48.5833, 0.791459, 0.116479),
    ),
    -0.053739,
    0.83433,
)  # fmt: skip


def coefficients(frequency_hz: float) -> tuple[float, float, float, float]:
    """Return k_H, alpha_H, k_V, alpha_V."""
    x = det_log(frequency_hz * 1e-9) / _LN_10

    def series(table: tuple[tuple[tuple[float, float, float], ...], float, float]) -> float:
        terms, m, c = table
        return sum(a * det_exp(-((x - b) / w) * ((x - b) / w)) for a, b, w in terms) + m * x + c

    return det_pow(10.0, series(_K_H)), series(_ALPHA_H), det_pow(10.0, series(_K_V)), series(_ALPHA_V)


def attenuation_db_per_km(frequency_hz: float, rain_mm_per_h: float) -> float:
    """Return gamma, one way."""
    if rain_mm_per_h <= 0.0:
        return 0.0
    k_h, alpha_h, k_v, alpha_v = coefficients(frequency_hz)
    k = 0.5 * (k_h + k_v)
    return k * det_pow(rain_mm_per_h, (k_h * alpha_h + k_v * alpha_v) / (2.0 * k))


def water_permittivity(frequency_hz: float) -> Complex:
    """Return eps' and eps'' of water."""
    theta = 300.0 / _WATER_K - 1.0
    f = frequency_hz * 1e-9
    e0 = 77.66 + 103.3 * theta
    e1, e2 = 0.0671 * e0, 3.52
    fp = 20.20 - 146.0 * theta + 316.0 * theta * theta
    fs = 39.8 * fp
    p, s = 1.0 + (f / fp) * (f / fp), 1.0 + (f / fs) * (f / fs)
    return (e0 - e1) / p + (e1 - e2) / s + e2, (e0 - e1) * (f / fp) / p + (e1 - e2) * (f / fs) / s


@lru_cache(maxsize=4096)
def drop_sections_m2(diameter_m: float, frequency_hz: float) -> tuple[float, float]:
    """Return the cross-sections of a drop for backscatter and extinction [m^2]."""
    k = TURN_RAD * frequency_hz / SPEED_OF_LIGHT_MPS
    x = 0.5 * k * diameter_m
    er, ei = water_permittivity(frequency_hz)
    size = sqrt(er * er + ei * ei)
    m: Complex = (sqrt(0.5 * (size + er)), -sqrt(0.5 * (size - er)))
    terms = int(x + 4.0 * det_pow(x, 1.0 / 3.0) + 2.0)
    z = (m[0] * x, m[1] * x)
    ratio: list[Complex] = [(0.0, 0.0)] * (terms + 17)  # of the logarithmic derivative, downwards
    for n in range(terms + 16, 0, -1):
        nz = _over((float(n), 0.0), z)
        below = _over((1.0, 0.0), (ratio[n][0] + nz[0], ratio[n][1] + nz[1]))
        ratio[n - 1] = (nz[0] - below[0], nz[1] - below[1])
    psi0, psi1 = det_cos(x), det_sin(x)  # psi_-1, psi_0
    chi0, chi1 = -det_sin(x), det_cos(x)
    back: Complex = (0.0, 0.0)
    extinct, sign = 0.0, 1.0
    for n in range(1, terms + 1):
        psi0, psi1 = psi1, (2 * n - 1) / x * psi1 - psi0
        chi0, chi1 = chi1, (2 * n - 1) / x * chi1 - chi0
        sign = -sign
        parts = []
        for d in (_over(ratio[n], m), _times(ratio[n], m)):
            g = (d[0] + n / x, d[1])
            top = (g[0] * psi1 - psi0, g[1] * psi1)
            # xi = psi - j chi, so that fields turn as exp(+j omega t) with eps' - j eps''.
            low = _times(g, (psi1, chi1))
            parts.append(_over(top, (low[0] - psi0, low[1] - chi0)))
        a, b = parts
        weight = 2.0 * n + 1.0
        back = (back[0] + sign * weight * (a[0] - b[0]), back[1] + sign * weight * (a[1] - b[1]))
        extinct += weight * (a[0] + b[0])
    area = 0.5 * TURN_RAD / (k * k)
    return area * (back[0] * back[0] + back[1] * back[1]), 4.0 * area * 0.5 * extinct


def _times(a: Complex, b: Complex) -> Complex:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _over(a: Complex, b: Complex) -> Complex:
    s = b[0] * b[0] + b[1] * b[1]
    return (a[0] * b[0] + a[1] * b[1]) / s, (a[1] * b[0] - a[0] * b[1]) / s


def drop_spectrum(frequency_hz: float, rain_mm_per_h: float) -> list[tuple[float, float, float]]:
    """Return for each size its fall speed [m/s], and its part of eta [m^2/m^3] and of the extinction [1/m]."""
    slope_per_mm = 4.1 * det_pow(rain_mm_per_h, -0.21)
    rows = []
    for i in range(int(_GREATEST_MM / _STEP_MM)):
        d_mm = (i + 0.5) * _STEP_MM
        number = _DROPS_PER_M3_MM * det_exp(-slope_per_mm * d_mm) * _STEP_MM
        back, extinct = drop_sections_m2(1e-3 * d_mm, frequency_hz)
        rows.append((max(0.0, 9.65 - 10.3 * det_exp(-0.6 * d_mm)), back * number, extinct * number))
    return rows


class Rain:
    """Rain of one rate before one radar.

    `direction_R` (n, 3) and `weight` (n,) of the pixels of its view: W(d) of scatterers.py, 0 where no echo counts.
    """

    def __init__(
        self, frequency_hz: float, rain_mm_per_h: float, direction_R: Float64, weight: Float64, max_range_m: float,
        *, seed: int, name: str,
    ) -> None:  # fmt: skip
        self._key = np.array(noise_key(seed, f"{name}.rain"), np.uint64)
        self._direction_R, self._weight, self._max_range_m = direction_R, weight, max_range_m
        self._pixels = np.flatnonzero(weight > 0.0)
        spectrum = drop_spectrum(frequency_hz, rain_mm_per_h)
        self.eta_per_m = sum(row[1] for row in spectrum)
        share, shares = 0.0, []
        for _, part, _ in spectrum:
            share += part / self.eta_per_m
            shares.append(share)
        self._shares, self._fall_mps = np.array(shares), np.array([row[0] for row in spectrum])
        loss_db_per_km = attenuation_db_per_km(frequency_hz, rain_mm_per_h)
        self._far_m = 2.0 * max_range_m
        node_m = self._far_m / _NODES
        loss = [det_pow(10.0, -loss_db_per_km * 2.0 * i * node_m / 20_000.0) for i in range(_NODES + 1)]
        self._loss = np.array([*loss, loss[-1]])

    def attenuate(self, echoes: Echoes) -> None:
        """Multiply the amplitudes by the loss over both ways; beyond twice the greatest range, by that there."""
        place = np.minimum(echoes.range_m, self._far_m) * (_NODES / self._far_m)
        node = place.astype(np.int64)
        low = self._loss[node]
        echoes.amplitude[:] *= low + (place - node) * (self._loss[node + 1] - low)

    def echoes(self, picture_range: NDArray[np.float32], down_R: Vec3, v_R: Vec3, seq: int) -> Echoes:
        """Return the echoes of drops, not attenuated. `down_R`: unit vector; `v_R`: the radar's velocity."""
        raw = np.random.Philox(counter=[0, 0, 0, seq], key=self._key).random_raw(3 * ECHOES)
        u = ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(3, ECHOES)
        pixel = self._pixels[(u[0] * len(self._pixels)).astype(np.int64)]
        range_m = NEAREST_M + u[1] * (self._max_range_m - NEAREST_M)
        size = np.searchsorted(self._shares, u[2] * self._shares[-1])
        fall_mps = self._fall_mps[np.minimum(size, len(self._fall_mps) - 1)]
        d = self._direction_R[pixel]
        # W(d)^2 holds the pixel's solid angle; each echo stands for all pixels and ranges over the number of echoes.
        share = self.eta_per_m * (self._max_range_m - NEAREST_M) * len(self._pixels) / ECHOES
        amplitude = self._weight[pixel] * np.sqrt(share) / range_m
        amplitude[range_m >= picture_range.reshape(-1)[pixel]] = 0.0
        along = [fall_mps * g - v for g, v in zip(down_R, v_R, strict=True)]
        speed_mps = dot(d.T, along)
        return Echoes(range_m, speed_mps, np.ascontiguousarray(d), amplitude)
