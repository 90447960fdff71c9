"""Existence of a tracked object: evidence of its sightings.

The log-likelihood ratio of one box is linear in its features (logistic regression; Bishop 2006, Pattern Recognition and
Machine Learning, 4.3.2), fitted to the boxes of flights over tuning maps with the scores of the shipped detector:

    z = ln p(box | object) / p(box | something else) = w0 + sum w_i f_i

The score of another label at the same place counts against a person: bicycles and parasols have two scores. A person's
box is as high as a person, and its middle is as high above the ground.

Boxes of one object show the same clothes in front of the same background, so they are not independent. With the
correlation rho between two of them, n count as n / (1 + (n - 1) rho) independent ones (design effect; Kish 1965, Survey
Sampling, 5.4), and the log-odds of an object are

    l = l_0 + sum z_i / (1 + (n - 1) rho)
"""

from __future__ import annotations

PERSON = "person"
_PRIOR, _CORRELATION = -3.8, 0.1  # l_0 and rho
WEAK = 0.12  # a score of so much less than the threshold can be a sighting
RIVAL = 0.27  # a rival's score of so much less than the threshold, and those below it, say nothing
LEAST_EVIDENCE = -2.0  # a box with less is not a sighting
_CONSTANT, _SCORE, _RIVAL_SCORE, _ON_SEAT = 2.9, 8.0, -6.65, 1.0
_HEIGHT_M, _PER_M_LOW, _PER_M_HIGH, _MOST_M = 1.65, -3.0, -1.3, 1.0  # of the box
_MIDDLE_M, _MIDDLE_LOW, _MIDDLE_HIGH, _MIDDLE_MOST_M = 0.8, -3.9, -5.2, 0.8  # of its middle above the ground


def sighting_evidence(
    over_threshold: float,
    rival_over_threshold: float | None,
    height_m: float | None = None,
    middle_m: float | None = None,
    *,
    on_seat: bool = False,
) -> float:
    """Return z of a box. None: unknown, or no rival.

    `over_threshold`: its score minus the detection threshold, `rival_over_threshold`: that of the best box of another
    label over it, `height_m`: of the box, `middle_m`: of the box's middle above the ground.
    """
    z = _CONSTANT + _SCORE * over_threshold
    if rival_over_threshold is not None:
        z += _RIVAL_SCORE * max(0.0, rival_over_threshold + RIVAL)
    if height_m is not None:
        z += _off(height_m - _HEIGHT_M, _PER_M_LOW, _PER_M_HIGH, _MOST_M)
    if middle_m is not None:
        z += _off(middle_m - _MIDDLE_M, _MIDDLE_LOW, _MIDDLE_HIGH, _MIDDLE_MOST_M)
    return z + (_ON_SEAT if on_seat else 0.0)


def _off(off_m: float, low: float, high: float, most_m: float) -> float:
    return min(abs(off_m), most_m) * (low if off_m < 0.0 else high)


def object_odds(evidence: float, sightings: int) -> float:
    """Return the log-odds of an object with this sum of evidence; it is reported from 0 on."""
    return _PRIOR + evidence / (1.0 + _CORRELATION * (sightings - 1))
