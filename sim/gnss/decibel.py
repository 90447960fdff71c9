"""Decibels by the functions that give the same bits on every machine."""

from __future__ import annotations

from signals._kernel import det_exp, det_log

_PER_DB = 0.2302585092994046  # ln 10 / 10


def power(db: float) -> float:
    """Return the ratio of powers; exactly 1 for 0 dB."""
    return det_exp(db * _PER_DB)


def decibel(ratio: float) -> float:
    """Return a ratio of powers > 0 in dB."""
    return det_log(ratio) / _PER_DB
