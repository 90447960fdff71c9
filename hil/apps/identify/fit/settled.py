"""Puts back what flights do not show, one unknown at a time; the others move to what is most likely with it.

About the optimum the likelihood is a parabola with the information A. With the unknowns e held at given values,
    s_f = s*_f - A_ff^-1 A_fe (s_e - s*_e),  covariance of s_f: A_ff^-1
Two unknowns that brake alike are each undetermined as long as both are free, and their sum is not: the one that is
known least goes first, back to the value it began with, and what remains is looked at again. An unknown beyond what a
vehicle file can say, such as a drag below zero, is held at that bound.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.shooting import Solution

Array = NDArray[np.float64]
_DETERMINED = {"exp": 0.15, "plus": 0.3}  # greatest 1 sigma of ln p; greatest share of the prior's


def settled(
    unknowns: Sequence[at.Unknown], solution: Solution, free: NDArray[np.bool_]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return theta with what the flights do not determine put back, its deviations, and which is kept.

    The deviation is that of `solution` where an unknown was free all along; of one that is only determined given those
    that were put back it is the greater of what it is then and of what its own limit allows.
    """
    n = len(unknowns)
    deviation = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    limit = np.array([_DETERMINED[u.law] * (u.prior if u.law == "plus" else 1.0) for u in unknowns])
    vehicle = np.array([not u.key.startswith("log.") for u in unknowns])
    bounds = [_bounds(u) for u in unknowns]
    # Deviations of the residuals' colour (shooting.py) over those of the information alone.
    plain = _deviations(solution.information, free)
    colour = np.where(plain > 0.0, deviation / np.maximum(plain, 1e-300), 1.0)
    open_, s, now = free.copy(), solution.s.copy(), deviation.copy()
    kept = ~free
    while True:
        over = [max(low - x, x - high, 0.0) / u.prior if o and v else 0.0
                for (low, high), x, u, o, v in zip(bounds, s, unknowns, open_, vehicle, strict=True)]  # fmt: skip
        doubt = np.where(open_ & vehicle, now / limit, 0.0)
        if max(doubt) > 1.0:
            i = int(np.argmax(doubt))
            value = 0.0
            kept[i] = True
        elif max(over) > 0.0:
            i = int(np.argmax(over))
            value = bounds[i][0] if s[i] < bounds[i][0] else bounds[i][1]
        else:
            break
        open_[i] = False
        s[i] = value
        held = free & ~open_
        A = solution.information
        s[open_] = solution.s[open_] - np.linalg.solve(
            A[np.ix_(open_, open_)], A[np.ix_(open_, held)] @ (s[held] - solution.s[held])
        )
        now = np.where(open_, _deviations(A, open_) * colour, 0.0)
    shown = np.where(open_ & vehicle, np.minimum(deviation, np.maximum(now, limit)), deviation)
    kept |= ~vehicle & (deviation > limit)
    assert len(s) == n
    return s, shown, kept


def _bounds(unknown: at.Unknown) -> tuple[float, float]:
    """Return the range of s that a vehicle file can say; a law that keeps above its floor needs no lower bound."""
    if unknown.law == "exp" and unknown.start == unknown.floor:
        return -np.inf, np.inf  # switched off
    low = -np.inf if unknown.law == "exp" or np.isinf(unknown.least) else unknown.inverse(unknown.least)
    return low, np.inf if np.isinf(unknown.most) else unknown.inverse(unknown.most)


def _deviations(information: Array, free: NDArray[np.bool_]) -> Array:
    out = np.zeros(len(information))
    out[free] = np.sqrt(np.maximum(np.diag(np.linalg.inv(information[np.ix_(free, free)])), 0.0))
    return out
