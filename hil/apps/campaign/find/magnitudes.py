"""Numbers of a case that are made smaller: wind, strengths and durations of faults, and settings of the vehicle.

Each has a neutral value, at which it has no effect or is that of the base. The failure is taken to persist from some
share of the distance between neutral value and value on; that share is found by bisection.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from hil.apps.campaign.cases.distributions import rounded
from hil.apps.campaign.find.parts import ABSENT, LISTS, STEADY, Data, at, parts_of, put
from hil.config import Bench
from signals.documents.document import Place
from signals.documents.yaml_lines import dotted, read_yaml

TOLERANCE = 1 / 16  # of the distance to the neutral value
_AT_ONCE = 3  # trials of one step of the bisection: it leaves a quarter
# Numbers of the entries of a list with their neutral values; a text names the key of the same entry that holds it.
_OF_ENTRIES: dict[Place, dict[str, float | str]] = {
    LISTS[0]: {"value": 0.0, "rate_per_s": 0.0, "until_s": "at_s"},
    LISTS[1]: {"factor": 1.0, "imbalance_gcm": 0.0},
    LISTS[2]: {"rate": 0.0, "for_s": 0.0, "delay_s": 0.0},
    LISTS[3]: {"hold_s": 0.0},
}


class Magnitude(NamedTuple):
    """One number of a case."""

    place: Place
    value: float
    neutral: float

    def at(self, share: float) -> float:
        """Return the number at a share of the distance from its neutral value."""
        return rounded(self.neutral + share * (self.value - self.neutral))

    def text(self, value: float) -> str:
        return f"{dotted(self.place)}: {self.value:g} becomes {value:g}"


def magnitudes_of(data: Data, base: Data, bench: Bench, base_bench: Bench) -> list[Magnitude]:
    """Return the numbers of a case that can be made smaller. `base_bench` is the bench of `base`."""
    found = [*_wind(data), *_entries(data), *_differing(data, base, bench, base_bench)]
    return [m for m in found if m.value != m.neutral]


def with_value(data: Data, magnitude: Magnitude, share: float) -> Data:
    """Return the data of a case with a number at a share of its distance from the neutral value."""
    data = copy.deepcopy(data)
    put(data, magnitude.place, magnitude.at(share))
    return data


def least_share(first_failing: Callable[[Sequence[float]], int | None], tolerance: float = TOLERANCE) -> float:
    """Return the least share with which the failure persists, to a tolerance; 1 if none below 1 does.

    `first_failing` returns the index of the first share with which it persists, None if there is none.
    """
    if first_failing([0.0]) is not None:
        return 0.0
    low, high = 0.0, 1.0
    while high - low > tolerance:
        step = (high - low) / (_AT_ONCE + 1)
        shares = [low + step * k for k in range(1, _AT_ONCE + 1)]
        found = first_failing(shares)
        low, high = (shares[-1], high) if found is None else (shares[found] - step, shares[found])
    return high


def _wind(data: Data) -> Iterator[Magnitude]:
    places: list[Place] = [STEADY, *((*LISTS[3], i, "velocity_W_mps") for i in range(len(_list(data, LISTS[3]))))]
    for place in places:
        yield from (Magnitude((*place, i), v, 0.0) for i, v in enumerate(_list(data, place)))
    strength = at(data, ("wind", "turbulence", "wind_20ft_mps"))
    if _is_number(strength):
        yield Magnitude(("wind", "turbulence", "wind_20ft_mps"), strength, 0.0)


def _entries(data: Data) -> Iterator[Magnitude]:
    for place, keys in _OF_ENTRIES.items():
        for index, entry in enumerate(_list(data, place)):
            for key, neutral in keys.items():
                value = at(entry, (key,))
                end = at(entry, (neutral,)) if isinstance(neutral, str) else neutral
                if _is_number(value) and _is_number(end):
                    yield Magnitude((*place, index, key), value, end)


def _differing(data: Data, base: Data, bench: Bench, base_bench: Bench) -> Iterator[Magnitude]:
    """Yield the other numbers that differ from the base; whole numbers, such as seeds, have no size."""
    config = base_bench.config.model_dump(mode="json")
    vehicle = read_yaml(bench.files["vehicle"]).data if "vehicle" in bench.files else {}
    for part in parts_of(data, base):
        place, neutral = part.place, part.without
        if place[:1] == ("wind",) or any(place[: len(lists)] == lists for lists in LISTS):
            continue
        if neutral is ABSENT:
            neutral = at(vehicle, place[1:]) if place[0] == "vehicle_settings" else at(config, place)
        if _is_number(part.value) and _is_number(neutral) and float in (type(part.value), type(neutral)):
            yield Magnitude(place, part.value, neutral)


def _list(data: Data, place: Place) -> list[Any]:
    value = at(data, place)
    return value if isinstance(value, list) else []


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)
