"""Limits that judge a flight. Wider ones would be met whatever was flown, which `null` says openly."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field


def _breakable(most: float, unit: str) -> AfterValidator:
    def checked(value: float) -> float:
        if value >= most:
            raise ValueError(
                f"{value:g} {unit} is too wide to judge a flight: write less than {most:g} {unit}, or null"
            )
        return value

    return AfterValidator(checked)


DistanceLimit = Annotated[float, Field(gt=0), _breakable(1000.0, "m")]
DistanceLimitOrZero = Annotated[float, Field(ge=0), _breakable(1000.0, "m")]
RollLimit = Annotated[float, Field(gt=0), _breakable(10_000.0, "m")]  # along a runway
SpeedLimit = Annotated[float, Field(gt=0), _breakable(50.0, "m/s")]
AngleLimit = Annotated[float, Field(gt=0), _breakable(180.0, "deg")]
StallMargin = Annotated[float, Field(ge=0.5)]  # of an airspeed; at less, the wings carry a quarter of the weight
TimeLimit = Annotated[float, Field(gt=0), _breakable(3600.0, "s")]
TimeLimitOrZero = Annotated[float, Field(ge=0), _breakable(3600.0, "s")]
