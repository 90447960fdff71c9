"""Values that a user gives a fit: `--fix KEY=VALUE`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from signals.documents.document import Document
from signals.documents.validate import nearest, validate
from signals.errors import ConfigError, Problem
from sim.physics.vehicle import Vehicle

_WHERE = "--fix"


def read_fixed(texts: Sequence[str], vehicle: Vehicle) -> dict[str, float]:
    """Return the values by key: paths of numbers in the vehicle file. Raises ConfigError with every problem."""
    known = dict(_numbers(vehicle.model_dump(mode="json"), ""))
    fixed: dict[str, float] = {}
    problems = []
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not equals or not math.isfinite(number):
            problems.append(Problem(_WHERE, f"must be KEY=NUMBER, not {text!r}", "such as --fix mass_kg=2.06"))
        elif key not in known:
            hint = nearest(key, known, listed=False) or "a path in the vehicle file, such as inertia_kgm2.0"
            problems.append(Problem(_WHERE, f"{key} is no number of the vehicle {vehicle.name!r}", hint))
        else:
            fixed[key] = number
    if problems:
        raise ConfigError(problems)
    return fixed


def with_fixed(vehicle: Vehicle, fixed: Mapping[str, float]) -> Vehicle:
    """Return the vehicle with these values. Raises ConfigError for one that a vehicle cannot have."""
    if not fixed:
        return vehicle
    data: Any = vehicle.model_dump(mode="json", exclude_defaults=True)
    whole = vehicle.model_dump(mode="json")
    for key, value in fixed.items():
        here, source = data, whole
        *path, last = key.split(".")
        for part in path:
            index: Any = int(part) if isinstance(here, list) else part
            source = source[index]
            if isinstance(here, dict) and index not in here:
                here[index] = source
            here = here[index]
        here[int(last) if isinstance(here, list) else last] = value
    built, problems = validate(Vehicle, data, Document(_WHERE, data))
    if built is None or problems:
        raise ConfigError(problems)
    return built


def _numbers(data: Any, path: str) -> Iterator[tuple[str, float]]:
    """Yield every number with its path."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        here = f"{path}{key}"
        if isinstance(value, float):
            yield here, value
        else:
            yield from _numbers(value, f"{here}.")
