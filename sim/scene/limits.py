"""Limits of random values, as fields of a settings file: `[least, greatest]`."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field


def ordered(limits: tuple[float, float]) -> tuple[float, float]:
    """Return the limits. Raises ValueError if the greatest is below the least."""
    if limits[1] < limits[0]:
        raise ValueError(f"must be [least, greatest], not [{limits[0]:g}, {limits[1]:g}]")
    return limits


def within(low: float, high: float) -> AfterValidator:
    """Return a validator that keeps both limits within these bounds."""

    def checked(limits: tuple[float, float]) -> tuple[float, float]:
        if not low <= min(limits) <= max(limits) <= high:
            raise ValueError(f"must be within {low:g} and {high:g}, not [{limits[0]:g}, {limits[1]:g}]")
        return limits

    return AfterValidator(checked)


Limits = Annotated[tuple[float, float], AfterValidator(ordered)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
