"""Delta debugging: the algorithm ddmin of A. Zeller and R. Hildebrandt, "Simplifying and isolating failure-inducing
input", IEEE Transactions on Software Engineering 28 (2), 2002, section 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
# Returns the index of the first of several subsets with which the failure persists, None if there is none.
FirstFailing = Callable[[Sequence[list[T]]], int | None]


def ddmin(items: Sequence[T], first_failing: FirstFailing[T]) -> list[T]:
    """Return a subset with which the failure persists, in the order of `items`: without any one of them it does not.

    The failure must persist with all of them. The tests of one step (all subsets, then all complements) are asked for
    together, so that they can be made at the same time.
    """
    if not items or first_failing([[]]) is not None:
        return []
    current, n = list(items), 2
    while len(current) >= 2:
        subsets = _split(current, n)
        found = first_failing(subsets)
        if found is not None:
            current, n = subsets[found], 2
            continue
        complements = [[x for other in subsets if other is not subset for x in other] for subset in subsets]
        found = first_failing(complements) if n > 2 else None  # of two subsets each is the other's complement
        if found is not None:
            current, n = complements[found], n - 1
        elif n < len(current):
            n = min(len(current), 2 * n)
        else:
            break
    return current


def _split(items: list[T], n: int) -> list[list[T]]:
    """Return `n` subsets of nearly equal size."""
    ends = [len(items) * k // n for k in range(n + 1)]
    return [items[begin:end] for begin, end in pairwise(ends)]
