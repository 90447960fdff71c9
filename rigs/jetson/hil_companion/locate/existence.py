"""Existence of a tracked object: evidence of its sightings.

The log-likelihood ratio of one box is linear in its features (logistic regression; Bishop 2006, Pattern Recognition and
Machine Learning, 4.3.2), fitted to the boxes of flights over tuning maps with the scores of the shipped detector:

    z = ln p(box | object) / p(box | something else) = w0 + sum w_i f_i

The score of another label at the same place counts against a person: bicycles and parasols have two scores. A person's
box is as high as a person, and its middle is as high above the ground: that of a person who stands or walks (`upright`)
or who sits (`seated`), which are two hypotheses with weights of their own.

Boxes of one object show the same clothes in front of the same background, so they are not independent. With the
correlation rho between two of them, n count as n / (1 + (n - 1) rho) independent ones (design effect; Kish 1965, Survey
Sampling, 5.4). What all boxes of an object say together is one observation: the median height m of their middles,
normal with the mean of an upright person, of a seated one, or of other things that resemble one, and the share s of
boxes on a seat. A person who stands in clear view has a box in almost every picture, and other things, one that comes
and goes. So each of k pictures that had to show a still object (`views`) says besides, with the shares h of hits
(pictures with a box) of persons of the posture and of other things,

    z'_j = ln h(posture) / h(thing) for a hit,  ln (1 - h(posture)) / (1 - h(thing)) for a miss

and n counts the misses too. Of one that moves, no picture had to show it at a certain place. But at any time it is at
one of its places, so as many sightings as pictures k show one of them, the mean over its places, are expected of a
person, and few of tracks that belong to nobody. The number of sightings has a negative binomial distribution (Poisson,
with a rate of a gamma distribution) with the mean r k:

    seen = ln NB(n; r k, shape) / NB(n; r_others k, shape_others), at most `_MOST_SEEN`

The log-odds of an object are the greater of

    l_upright = l_0 + (sum z_i + sum z'_j) / (1 + (n - 1) rho) + ln N(m; upright) / N(m; low things) + seen
    l_seated  =       the same sum of the seated z and z' + ln N(m; seated) / N(m; things on seats) + seen + seat(s)

and who was at two places does not sit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

PERSON = "person"
_UPRIGHT_PRIOR, _SEATED_PRIOR, _CORRELATION = -6.0, -4.3, 0.1  # l_0 of both, and rho
WEAK = 0.12  # a score of so much less than the threshold can be a sighting; on a seat, one of `RIVAL` less
RIVAL = 0.27  # a rival's score of so much less than the threshold, and those below it, say nothing
LEAST_EVIDENCE = -2.0  # a box with less is not a sighting
_MOST_M, _MIDDLE_MOST_M = 1.0, 0.8  # a greater difference of a height or of a middle counts as this one
_SEAT_SURE, _OFF_SEAT = 0.5, -6.0  # seat(s): a line from `_OFF_SEAT` at s = 0 to 0 at `_SEAT_SURE` and more


@dataclass(frozen=True)
class _Posture:
    """Weights of z, and the middles of objects of this posture and of other things that look like it [m]."""

    constant: float
    score: float
    faint: float  # weight of the score below that of other sightings, besides
    rival: float
    height_m: float
    lower: float  # per metre below `height_m`
    higher: float
    middle_m: float
    middle_lower: float
    middle_higher: float
    median_m: float
    others_m: float
    spread_m: float
    most_ratio: float
    hits: float  # share of the pictures in clear view that have a box of a still person; of a still thing
    others_hits: float

    def looked(self, hits: int, misses: int) -> float:
        """Return the evidence of the pictures that had to show a still object."""
        hit, miss = self.hits / self.others_hits, (1.0 - self.hits) / (1.0 - self.others_hits)
        return hits * math.log(hit) + misses * math.log(miss)

    def evidence(self, over: float, rival_over: float | None, height_m: float | None, middle_m: float | None) -> float:
        z = self.constant + self.score * over + self.faint * min(0.0, over + WEAK)
        if rival_over is not None:
            z += self.rival * max(0.0, rival_over + RIVAL)
        if height_m is not None:
            z += _off(height_m - self.height_m, self.lower, self.higher, _MOST_M)
        if middle_m is not None:
            z += _off(middle_m - self.middle_m, self.middle_lower, self.middle_higher, _MIDDLE_MOST_M)
        return z

    def median_ratio(self, median_m: float, count: int) -> float:
        """Return the log-likelihood ratio of the median of `count` middles."""
        variance = self.spread_m**2 + _MIDDLE_SIGMA_M**2 / count
        ratio = ((median_m - self.others_m) ** 2 - (median_m - self.median_m) ** 2) / (2.0 * variance)
        return max(-_LEAST_RATIO, min(self.most_ratio, ratio))


_UPRIGHT = _Posture(2.96, 6.26, 0.0, -6.33, 1.7, -2.48, -2.27, 0.9, -4.21, -5.54, 0.87, 0.47, 0.1, 3.0, 0.92, 0.37)
_SEATED = _Posture(2.73, 0.0, 5.0, -5.93, 1.7, -3.91, 0.0, 0.55, -1.88, -4.46, 0.53, 0.3, 0.04, 2.0, 0.5, 0.39)
_MIDDLE_SIGMA_M, _LEAST_RATIO = 0.22, 6.0
# Sightings for each picture that shows a place of the object: mean and shape; and the most that many of them may say.
_UPRIGHT_SEEN, _SEATED_SEEN, _OTHERS_SEEN = (1.0, 8.0), (0.6, 6.0), (0.2, 1.5)
_MOST_SEEN = 1.0


@dataclass(frozen=True)
class Evidence:
    """Evidence of one box for an upright and for a seated object, and what is counted of it."""

    upright: float
    seated: float = -math.inf
    middle_m: float | None = None
    on_seat: bool = False

    @property
    def best(self) -> float:
        return max(self.upright, self.seated if self.on_seat else self.seated + 0.5 * _OFF_SEAT)


def sighting_evidence(
    over_threshold: float,
    rival_over_threshold: float | None,
    height_m: float | None = None,
    middle_m: float | None = None,
    *,
    on_seat: bool = False,
) -> Evidence:
    """Return the evidence of a person's box. None: unknown, or no rival.

    `over_threshold`: its score minus the detection threshold, `rival_over_threshold`: that of the best box of another
    label over it, `height_m`: of the box, `middle_m`: of the box's middle above the ground.
    """
    features = (over_threshold, rival_over_threshold, height_m, middle_m)
    return Evidence(_UPRIGHT.evidence(*features), _SEATED.evidence(*features), middle_m, on_seat)


def thing_evidence(over_threshold: float, rival_over_threshold: float | None) -> Evidence:
    """Return the evidence of a box of another label, which has no posture."""
    return Evidence(_UPRIGHT.evidence(over_threshold, rival_over_threshold, None, None))


def _seen_ratio(count: int, in_view: float, mean: float, shape: float) -> float:
    """Return the log-likelihood ratio of the number of sightings, a posture's against that of something else."""
    if in_view <= 0.0:
        return 0.0
    others_mean, others_shape = _OTHERS_SEEN
    ratio = _log_count(count, mean * in_view, shape) - _log_count(count, others_mean * in_view, others_shape)
    return min(_MOST_SEEN, ratio)


def _log_count(count: int, mean: float, shape: float) -> float:
    """Return ln of the negative binomial chance of a count, without the term ln (count!) that no mean changes."""
    chances = math.lgamma(count + shape) - math.lgamma(shape)
    return chances - shape * math.log1p(mean / shape) - count * math.log1p(shape / mean)


def _off(off_m: float, low: float, high: float, most_m: float) -> float:
    return min(abs(off_m), most_m) * (low if off_m < 0.0 else high)


class Evidences:
    """Evidence of all sightings of an object."""

    def __init__(self) -> None:
        self.count = self.seats = 0
        self.upright = self.seated = 0.0
        self.middles_m: list[float] = []

    def add(self, one: Evidence) -> None:
        self.count += 1
        self.seats += one.on_seat
        self.upright += one.upright
        self.seated += one.seated
        if one.middle_m is not None:
            self.middles_m.append(one.middle_m)

    def __add__(self, other: Evidences) -> Evidences:
        total = Evidences()
        total.count, total.seats = self.count + other.count, self.seats + other.seats
        total.upright, total.seated = self.upright + other.upright, self.seated + other.seated
        total.middles_m = [*self.middles_m, *other.middles_m]
        return total

    @property
    def seated_more(self) -> float:
        """Return how much more the boxes say for a sitter than for somebody upright; 0 if less."""
        return max(0.0, self.seated - self.upright) / (1.0 + _CORRELATION * (self.count - 1))

    def odds(self, hits: int = 0, misses: int = 0, *, in_view: float = 0.0, still: bool = True) -> float:
        """Return the log-odds of the object; it is reported from 0 on.

        `hits`, `misses`: pictures that had to show it if it is still, with and without a box. `in_view`: number k of
        pictures that show its places. `still`: it was at one place only, as who sits is.
        """
        dependence = 1.0 + _CORRELATION * (self.count + misses - 1)
        upright = _UPRIGHT_PRIOR + (self.upright + _UPRIGHT.looked(hits, misses)) / dependence
        seated = _SEATED_PRIOR + (self.seated + _SEATED.looked(hits, misses)) / dependence
        if self.middles_m:
            median_m = sorted(self.middles_m)[len(self.middles_m) // 2]
            upright += _UPRIGHT.median_ratio(median_m, len(self.middles_m))
            seated += _SEATED.median_ratio(median_m, len(self.middles_m))
        upright += _seen_ratio(self.count, in_view, *_UPRIGHT_SEEN)
        seated += _seen_ratio(self.count, in_view, *_SEATED_SEEN)
        share = min(1.0, self.seats / max(1, self.count) / _SEAT_SURE)
        return max(upright, seated + _OFF_SEAT * (1.0 - share)) if still else upright
