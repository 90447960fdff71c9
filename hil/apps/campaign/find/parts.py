"""The settings of a case as data, and the parts of them that can be taken out.

Taken out are entries of the lists of faults and gusts, the optional sections, and every value that differs from the
settings of all points of the campaign: it returns to the value there, or to that of the bench if there is none. The
components of a vector are parts of their own. A steady wind that the base does not set returns to zero.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hil.config import Bench
from hil.config.layers import parse_setting
from signals.documents.document import Place
from signals.documents.yaml_lines import dotted

ABSENT: Any = type("Absent", (), {"__repr__": lambda _: "absent"})()
STEADY: Place = ("wind", "steady_W_mps")
LISTS: tuple[Place, ...] = (
    ("faults", "sensors"),
    ("faults", "rotors"),
    ("faults", "surfaces"),
    ("faults", "links"),
    ("wind", "gusts"),
)
SECTIONS: tuple[Place, ...] = (("wind", "turbulence"), ("weather",))

Data = dict[str, Any]


class Part(NamedTuple):
    """One part of a case. `without` is the value in its place when it is taken out; ABSENT: none."""

    place: Place
    value: Any
    without: Any

    @property
    def text(self) -> str:
        return f"{dotted(self.place)} = {json.dumps(self.value, ensure_ascii=False)}"

    @property
    def text_without(self) -> str:
        """The part and how it is taken out."""
        back = self.without is not ABSENT and self.without is not None
        return f"{self.text}, back to {json.dumps(self.without, ensure_ascii=False)}" if back else self.text


def data_of(texts: Sequence[str]) -> Data:
    """Return texts of `--set` as nested data."""
    data: Data = {}
    for text in texts:
        place, value, _ = parse_setting(text)
        put(data, place, value, make=True)
    return data


def with_inherited(data: Data, bench: Bench) -> Data:
    """Return the data of a case with the faults, gusts and turbulence that its bench file has."""
    if bench.script is not None or bench.vehicles:
        return data  # those of a script are not settings
    data = copy.deepcopy(data)
    config = bench.config.model_dump(mode="json", include={"faults", "wind"}, exclude_none=True)
    for place in (*LISTS, ("wind", "turbulence")):
        value = at(config, place)
        if value not in (ABSENT, []) and at(data, place) is ABSENT:
            put(data, place, value, make=True)
    return data


def parts_of(data: Data, base: Data) -> list[Part]:
    """Return the parts of a case. `base` are the settings of all points of its campaign."""
    parts = []
    for place in LISTS:
        entries = at(data, place)
        parts += [Part((*place, i), entry, ABSENT) for i, entry in enumerate(entries if entries is not ABSENT else ())]
    parts += [Part(place, at(data, place), None) for place in SECTIONS if at(data, place) not in (ABSENT, None)]
    return [*parts, *_differences((), data, base)]


def without(data: Data, parts: Sequence[Part]) -> Data:
    """Return the data of a case without these parts."""
    data = copy.deepcopy(data)
    for part in sorted(parts, key=lambda part: [str(key).zfill(6) for key in part.place], reverse=True):
        if part.without is ABSENT:
            _delete(data, part.place)
        else:
            put(data, part.place, part.without)
    return data


def at(data: Any, place: Place) -> Any:
    """Return the value at a place, ABSENT if there is none."""
    for key in place:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return ABSENT
    return data


def put(data: Any, place: Place, value: Any, *, make: bool = False) -> None:
    """Set the value at a place. Where a part of the way is missing, `make` it, or do nothing."""
    for key in place[:-1]:
        if make and not isinstance(data.get(key), dict):
            data[key] = {}
        if at(data, (key,)) is ABSENT:
            return
        data = data[key]
    if make or at(data, place[-1:]) is not ABSENT:
        data[place[-1]] = value


def _delete(data: Data, place: Place) -> None:
    """Delete the value at a place, and every mapping that is empty then."""
    holder = at(data, place[:-1])
    if at(holder, place[-1:]) is ABSENT:
        return
    del holder[place[-1]]
    if holder == {} and len(place) > 1:
        _delete(data, place[:-1])


def _differences(place: Place, data: Data, base: Any) -> Iterator[Part]:
    for key, value in data.items():
        here = (*place, key)
        before = at(base, (key,)) if isinstance(base, Mapping) else ABSENT
        if here in LISTS or here in SECTIONS or value == before:
            continue
        if here == STEADY and not _is_vector(before):
            before = [0.0, 0.0, 0.0]
        if isinstance(value, Mapping) and value and (before is ABSENT or isinstance(before, Mapping)):
            yield from _differences(here, dict(value), before)
        elif _is_vector(value) and _is_vector(before) and len(value) == len(before):
            pairs = enumerate(zip(value, before, strict=True))
            yield from (Part((*here, i), v, b) for i, (v, b) in pairs if v != b)
        else:
            yield Part(here, value, before)


def _is_vector(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(type(v) in (int, float) for v in value)
