"""Validation of values from untrusted clients. Errors name the place of the value."""

from __future__ import annotations

from math import isfinite

from firmware_bridge.codecs.errors import CodecError


def whole(place: str, value: object, low: int, high: int) -> int:
    """Return a whole number within the limits. CodecError names the place."""
    if type(value) is not int or not low <= value <= high:
        raise CodecError(f"{place}: {shown(value)} is not a whole number within {low}..{high}")
    return value


def number(place: str, value: object, largest: float) -> float:
    """Return a finite number with |value| <= `largest`, in the unit of the place. CodecError names the place."""
    if type(value) not in (int, float) or not isfinite(value) or abs(value) > largest:  # type: ignore[arg-type]
        raise CodecError(f"{place}: {shown(value)} is not a finite number within +-{largest:g}")
    return float(value)  # type: ignore[arg-type]


def shown(value: object) -> str:
    """Format a value for a message: at most 60 characters, without control characters."""
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
