"""Existence of a tracked object: evidence of its sightings, and of the pictures that should have shown it.

The log-odds of existence are a sum over pictures (binary Bayes filter; Thrun, Burgard and Fox 2005, Probabilistic
Robotics, 4.2):

    l = l_0 + sum ln p(z | person) / p(z | no person)

z is a box with a score and a height, or no box where the picture should show the object. Pictures from nearly the same
place show the same background and the same shadows, so they are not independent: each counts `_SHARE`.
"""

from __future__ import annotations

import math

PERSON = "person"
_PRIOR, _STILL = -2.0, -3.0  # l_0, and what is added to it for a person who never walked: posts do not walk
_SHARE = 0.35
_SEEN, _SEEN_FALSE = 0.72, 0.3  # probability of a box on a visible person, and on something that was once boxed
_SLOPE, _EVEN, _MOST = 12.0, 0.04, 1.6  # scores: equally frequent `_EVEN` above the threshold
# Heights of boxes on people: mean, deviation, ln of the densities' ratio at the mean, below and above. A tall box often
# shows two people, one behind the other.
_HEIGHT_M, _HEIGHT_SIGMA_M, _BEST, _LOW, _TALL = 1.65, 0.4, 0.9, -2.0, -0.7
# Share of a box's own pixels that differ from the seat under it: people from 0.38 on, empty seats below.
_SEAT_SLOPE, _SEAT_EVEN, _SEATED, _EMPTY = 12.0, 0.35, 1.0, -1.8
MISS = _SHARE * math.log((1.0 - _SEEN) / (1.0 - _SEEN_FALSE))


def sighting_evidence(over_threshold: float, height_m: float | None, beside_seat: float | None = None) -> float:
    """Return the log-likelihood ratio of a box by its score minus the threshold and by the height of its object.

    `beside_seat`: `Seats.other_share` of the box.
    """
    by_score = max(-_MOST, min(_MOST, _SLOPE * (over_threshold - _EVEN)))
    by_height = 0.0
    if height_m is not None:
        lowest = _LOW if height_m < _HEIGHT_M else _TALL
        by_height = max(lowest, _BEST - 0.5 * ((height_m - _HEIGHT_M) / _HEIGHT_SIGMA_M) ** 2)
    by_seat = 0.0
    if beside_seat is not None:
        by_seat = max(_EMPTY, min(_SEATED, _SEAT_SLOPE * (beside_seat - _SEAT_EVEN)))
    return _SHARE * (math.log(_SEEN / _SEEN_FALSE) + by_score + by_height + by_seat)


def object_odds(evidence: float, *, still_person: bool) -> float:
    """Return the log-odds of an object with this evidence of its sightings; it is reported from 0 on."""
    return _PRIOR + (_STILL if still_person else 0.0) + evidence
