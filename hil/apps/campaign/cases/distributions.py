"""Distributions of sampled axes: each turns a number u of (0, 1) into a value by its inverse distribution function."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from signals.noise import normal_from_uniform

DIGITS = 6  # significant digits of a sampled number, so that it is the same on every machine and short to write
_KINDS = ("uniform", "normal", "log_uniform", "integers", "choice")


class Distribution(StrictModel):
    """Distribution of one sampled axis; exactly one of the first five keys is given."""

    uniform: tuple[float, float] | None = None  # [least, greatest]
    normal: tuple[float, Annotated[float, Field(gt=0)]] | None = None  # [mean, standard deviation]
    log_uniform: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] | None = None
    integers: tuple[int, int] | None = None  # [least, greatest], both possible
    choice: Annotated[list[Any], Field(min_length=1)] | None = None
    weights: list[Annotated[float, Field(gt=0)]] | None = None  # of `choice`; null: equal
    within: tuple[float, float] | None = None  # values of `normal` are clipped to these

    @model_validator(mode="after")
    def _one_kind(self) -> Distribution:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of {', '.join(_KINDS)}")
        for kind in ("uniform", "log_uniform", "integers", "within"):
            ends = getattr(self, kind)
            if ends is not None and ends[1] < ends[0]:
                raise ValueError(f"{kind}: the first value, {ends[0]:g}, must not be above the second, {ends[1]:g}")
            if ends is not None and not math.isfinite(ends[1] - ends[0]):
                raise ValueError(f"{kind}: the values are too far apart")
        if self.weights is not None and (self.choice is None or len(self.weights) != len(self.choice)):
            raise ValueError("weights needs one number for each value of choice")
        if self.within is not None and self.normal is None:
            raise ValueError("within belongs to normal")
        return self

    def value(self, u: float) -> Any:
        """Return the value at the probability `u`, 0 < u < 1."""
        if self.choice is not None:
            return self.choice[self._index(u)]
        if self.integers is not None:
            least, greatest = self.integers
            return min(greatest, least + int(u * (greatest - least + 1)))
        if self.normal is not None:
            mean, deviation = self.normal
            x = mean + deviation * float(normal_from_uniform(np.array([u]))[0])
            if self.within is not None:
                x = min(max(x, self.within[0]), self.within[1])
        elif self.uniform is not None:
            x = self.uniform[0] + (self.uniform[1] - self.uniform[0]) * u
        else:
            assert self.log_uniform is not None
            x = self.log_uniform[0] * (self.log_uniform[1] / self.log_uniform[0]) ** u
        return rounded(x)

    def extremes(self) -> list[Any]:
        """Return values to try before any flight: all choices, or a low and a high value."""
        return list(self.choice) if self.choice is not None else [self.value(1e-6), self.value(1.0 - 1e-6)]

    def _index(self, u: float) -> int:
        assert self.choice is not None
        weights = self.weights or [1.0] * len(self.choice)
        remaining = u * sum(weights)
        for index, weight in enumerate(weights):
            if remaining < weight:
                return index
            remaining -= weight
        return len(weights) - 1


def rounded(x: float) -> float:
    """Return `x` with `DIGITS` significant digits."""
    return float(f"{x:.{DIGITS}g}")
