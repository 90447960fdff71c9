"""Appearance of an object: contrasts of its colours that light changes little, and how likely tracks share one object.

Light multiplies the linear R, G and B of a colour. The shade of a tree is a third of the sun, so the logarithms

    u = ln(rgb + eps)                                   of the upper and of the lower part, eps: `_DARK`

of both parts move together. What lights the shade is the sky, which is bluer than the sun: with each unit that a part
is darker, its r - g falls and its b - g rises by `_DAYLIGHT`, by a regression within people. So the hue is taken as it
were if the part's mean of u were `_MIDDLE_U`. Of the hues of one person's tracks, the median distance from their median
is 0.018 to 0.033 without this and 0.012 to 0.020 with it (times 1.48; six maps for tuning), and grey clothes in the
shade no longer look like blue ones in the sun. Six contrasts are taken, of which only the first changes with the light:

    lightness  mean of all six u        step  mean u of the upper part - mean u of the lower part
    and for each part  r - g  and  b - g  of u - `_DAYLIGHT` (mean u - `_MIDDLE_U`)

Contrast c of a track is x_c = m_c + b_c + w_c: the people's mean m, the person's own deviation with variance B, and
the light and the noise at the place with variance V (Ioffe 2006, Probabilistic Linear Discriminant Analysis, here with
variances instead of matrices). For n sightings V = W (1 + `_FEW` / n); that of a hue is larger for a dark part and for
a strong hue. The tracks of an object are taken one after another, those with most sightings first. Those before
predict the next with mean mu and variance s. For each block of contrasts, the light's and each part's,

    ratio = ln[ (1 - eps) N(x; mu, s + V) / p(x) + eps ],    s = 1 / (1/B + sum 1/V),    eps: `_ODD`
    p(x)  = q_0 N(x; m, B + V) + sum q_k N(x; common hue k, sigma^2 + V)

and the sum over tracks and blocks is the log-likelihood ratio of one object against as many as tracks. p is the density
among all people, of whom many wear the same few hues. eps is the share of blocks that say nothing: a leaf before the
coat, a second person in the box. Such a block moves mu by less, with its chance of not being one as the weight. A part
that is not seen counts nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence, Tuple

import cv2
import numpy as np

_DARK = 0.002
_DAYLIGHT, _MIDDLE_U = np.array([0.065, 0.0, -0.115]), -3.0  # r, g and b of u, for each unit of a part's mean u
# m, B and W in the order of `tone_of`, from the tracks on tuning maps; eps and the hues by the number of errors there.
_MEAN = np.array([-3.4, 0.1, 0.2, 0.1, 0.0, 0.05])
_BETWEEN = np.array([0.85, 1.3, 0.7, 0.6, 0.3, 0.5]) ** 2
_WITHIN = np.array([0.40, 0.35, 0.03, 0.03, 0.03, 0.03]) ** 2
_FEW, _ODD, _LEADERS = 3.0, 0.1, 4
_DIM = -4.7  # mean u of a part below which noise blurs its hue
_OF_HUE = 0.05  # deviation of a strong hue, as a share of it: `_DARK` weakens it in the shade
_COMMON_SIGMA = 0.1
Common = Tuple[float, Tuple[float, float]]  # share of the people, and r - g and b - g, of a common hue
_NEUTRAL, _DENIM, _KHAKI = (0.0, 0.12), (-0.5, 0.9), (0.25, -0.5)
_SIDES = 2  # of each block: a rucksack is seen from behind, and so is the skirt of a coat over the trousers
# Contrasts that are odd together, of the light, of the upper and of the lower part, with the common hues of clothes.
_BLOCKS: Sequence[tuple[tuple[int, int], Sequence[Common]]] = (
    ((0, 1), ()),
    ((2, 3), ((0.4, _NEUTRAL),)),
    ((4, 5), ((0.35, _NEUTRAL), (0.25, _DENIM), (0.12, _KHAKI))),
)


def tone_of(look: np.ndarray) -> np.ndarray:
    """Return the six contrasts of a look; NaN where a part is not seen."""
    lab = look.reshape(1, 2, 3).astype(np.float32)
    u = np.log(np.maximum(_linear(lab), 0.0) + _DARK)[0]
    upper, lower = u[0].mean(), u[1].mean()
    u = u - _DAYLIGHT * (u.mean(axis=1, keepdims=True) - _MIDDLE_U)
    return np.array(
        [
            0.5 * (upper + lower),
            upper - lower,
            u[0, 0] - u[0, 1],
            u[0, 2] - u[0, 1],
            u[1, 0] - u[1, 1],
            u[1, 2] - u[1, 1],
        ]
    )


def _linear(lab: np.ndarray) -> np.ndarray:
    # OpenCV's LAB2LRGB is the inverse of the conversion in `looks` without the gamma of sRGB.
    return np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2LRGB), float)


@dataclass(frozen=True)
class Appearance:
    """Contrasts of one track, NaN if not seen, and their variances V; from `sightings` sightings.

    `anyone`: ln p(x) of each block.
    """

    contrasts: tuple[float, ...]
    variance: tuple[float, ...]
    sightings: int
    anyone: tuple[float, ...]

    @staticmethod
    def of_track(look: np.ndarray | None, sightings: int) -> Appearance:
        contrasts = np.full(len(_MEAN), math.nan) if look is None else tone_of(look)
        variance = _WITHIN * (1.0 + _FEW / sightings)
        upper, lower = contrasts[0] + 0.5 * contrasts[1], contrasts[0] - 0.5 * contrasts[1]
        for part, mean in ((slice(2, 4), upper), (slice(4, 6), lower)):
            if math.isfinite(mean):
                variance[part] *= 1.0 + math.exp(min(4.0, 2.0 * (_DIM - mean)))
        strong = np.nan_to_num(contrasts[2:])
        variance[2:] += (_OF_HUE * strong) ** 2
        x, v = tuple(contrasts.tolist()), tuple(variance.tolist())
        return Appearance(x, v, sightings, tuple(_log_anyone(x, v, block, common) for block, common in _BLOCKS))


def appearance_ratio(tracks: Sequence[Appearance]) -> float:
    """Return the log-likelihood ratio of one object against as many objects as tracks."""
    ordered = sorted(tracks, key=lambda a: (-a.sightings, a.contrasts[0] != a.contrasts[0], a.contrasts))
    if len(ordered) < 2:
        return 0.0
    # The first track may be odd itself: the best of the first ones that leads the others.
    return max(_ratio([ordered[k], *ordered[:k], *ordered[k + 1 :]]) for k in range(min(_LEADERS, len(ordered))))


class _Side:
    """Mean and precision of a block's contrasts of one person, and how many tracks they are of."""

    def __init__(self, block: Sequence[int]) -> None:
        self.mean = {c: float(_MEAN[c]) for c in block}
        self.precision = {c: 1.0 / float(_BETWEEN[c]) for c in block}
        self.count = 0.0

    def alike(self, one: Appearance, seen: Sequence[int]) -> float:
        x, v = one.contrasts, one.variance
        return sum(_log_normal(x[c] - self.mean[c], 1.0 / self.precision[c] + v[c]) for c in seen)

    def add(self, one: Appearance, seen: Sequence[int], weight: float) -> None:
        self.count += weight
        for c in seen:
            more = weight / one.variance[c]
            self.mean[c] = (self.precision[c] * self.mean[c] + more * one.contrasts[c]) / (self.precision[c] + more)
            self.precision[c] += more


def _ratio(tracks: Sequence[Appearance]) -> float:
    # Plain numbers: arrays of six take ten times as long, and the search asks for thousands of ratios.
    total = 0.0
    for k, (block, _) in enumerate(_BLOCKS):
        sides: list[_Side] = []
        for one in tracks:
            seen = [c for c in block if one.contrasts[c] == one.contrasts[c]]
            if seen:
                total += _add(sides, one, seen, block, one.anyone[k])
    return total


def _add(sides: list[_Side], one: Appearance, seen: Sequence[int], block: Sequence[int], anyone: float) -> float:
    """Add a track's block to the sides of a person; return its log-likelihood ratio."""
    ratio, odd = 0.0, 1.0
    if sides:
        count = sum(side.count for side in sides)
        own = [(1.0 - _ODD) * side.count / count * math.exp(side.alike(one, seen) - anyone) for side in sides]
        whole = sum(own) + _ODD
        ratio, odd = math.log(whole), _ODD / whole
        for side, part in zip(sides, own):
            side.add(one, seen, part / whole)
    if odd > 0.5 and len(sides) < _SIDES:
        sides.append(_Side(block))
        sides[-1].add(one, seen, odd)
    return ratio


def _log_anyone(x: Sequence[float], v: Sequence[float], block: Sequence[int], common: Sequence[Common]) -> float:
    """Return the logarithm of the density of a block's contrasts among all people."""
    seen = [c for c in block if x[c] == x[c]]
    rest = 1.0 - sum(share for share, _ in common)
    density = rest * math.exp(sum(_log_normal(x[c] - _MEAN[c], _BETWEEN[c] + v[c]) for c in seen))
    for share, hue in common:
        off = [(x[c] - m, _COMMON_SIGMA**2 + v[c]) for c, m in zip(block, hue) if c in seen]
        density += share * math.exp(sum(_log_normal(*one) for one in off))
    return math.log(max(density, 1e-30))


def _log_normal(off: float, variance: float) -> float:
    """Return the logarithm of a normal density, without the constant."""
    return -0.5 * (off * off / variance + math.log(variance))
