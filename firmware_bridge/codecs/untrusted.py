"""Checks of values that came over the wire from untrusted clients, with messages that name the place. No I/O."""

from __future__ import annotations

from math import isfinite

from firmware_bridge.codecs.errors import CodecError


def whole(place: str, value: object, low: int, high: int) -> int:
    """A whole number within the limits. CodecError naming the place."""
    if type(value) is not int or not low <= value <= high:
        raise CodecError(f"{place}: {shown(value)} is no whole number within {low}..{high}")
    return value


def number(place: str, value: object, largest: float) -> float:
    """A finite number, no larger than that either way, in whatever unit the place has. CodecError naming the place."""
    if type(value) not in (int, float) or not isfinite(value) or abs(value) > largest:  # type: ignore[arg-type]
        raise CodecError(f"{place}: {shown(value)} is no finite number of sensible size")
    return float(value)  # type: ignore[arg-type]


def shown(value: object) -> str:
    """A value in a message for people: short, and without control characters."""
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
