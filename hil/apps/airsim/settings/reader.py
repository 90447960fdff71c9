"""Reading of one JSON object key by key: types and limits are checked, unknown keys are found."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any

from signals.documents.document import Document, Place
from signals.documents.validate import at, nearest, shown
from signals.errors import Problem
from signals.samples import Vec3

MAX_ENTRIES = 256  # vehicles, cameras of a vehicle, sensors of a vehicle, image types
_FAR_M = 100_000.0  # positions


def number(default: float, low: float, high: float, *keys: str) -> Any:
    """Declare a dataclass field that `Reader.values` reads: the last of the `keys` that is given counts."""
    return field(default=default, metadata={"keys": keys, "limits": (low, high)})


def given(default: Any, key: str) -> Any:
    """Declare a dataclass field that `Reader.values` reads: text, true or false, as its default is."""
    return field(default=default, metadata={"keys": (key,)})


@dataclass
class Report:
    """Findings about a settings file: `problems` stop the program, `notes` are shown once."""

    document: Document
    problems: list[Problem] = field(default_factory=list)
    notes: list[Problem] = field(default_factory=list)
    without_meaning: dict[str, None] = field(default_factory=dict)
    unknown: dict[tuple[str, str], Problem] = field(default_factory=dict)


class Reader:
    """One object of the file. A method returns the value of a key, or the default; `close` notes the other keys."""

    def __init__(self, report: Report, place: Place, data: Any) -> None:
        self.report = report
        self.place = place
        self._data: dict[str, Any] = {}
        self._known: dict[str, None] = {}
        self._wrong = not isinstance(data, dict)
        if isinstance(data, dict):
            self._data = data
        else:
            report.problems.append(at(report.document, place, f"must be an object in braces, not {shown(data)}"))

    def has(self, key: str) -> bool:
        """Return True if the key is given."""
        return key in self._data

    def problem(self, key: str | None, message: str, hint: str = "") -> None:
        """Add a problem at a key, or at this object, unless the object itself is wrong."""
        if not self._wrong:
            self.report.problems.append(self._finding(key, message, hint))

    def note(self, key: str | None, message: str, hint: str = "") -> None:
        """Add a note at a key, or at this object."""
        self.report.notes.append(self._finding(key, message, hint))

    def optional(self, key: str, low: float, high: float) -> float | None:
        """Return a number; None where the key is absent or NaN, as AirSim's documentation writes an unset value."""
        self._known[key] = None
        value = self._data.get(key)
        if key not in self._data or (isinstance(value, float) and math.isnan(value)):
            return None
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.problem(key, f"must be a number, not {shown(value)}")
        elif not low <= value <= high:
            self.problem(key, f"must be {low:g} to {high:g}, not {shown(value)}")
        else:
            return float(value)
        return None

    def number(self, key: str, default: float, low: float, high: float) -> float:
        """Return a finite number."""
        value = self._data.get(key)
        if isinstance(value, float) and math.isnan(value):
            self._known[key] = None
            self.problem(key, "must be a number, not NaN")
            return default
        found = self.optional(key, low, high)
        return default if found is None else found

    def values(self, of: type) -> dict[str, Any]:
        """Return the values of the fields of a dataclass that are declared by `number` or `given`."""
        values: dict[str, Any] = {}
        for declared in fields(of):
            for key in declared.metadata.get("keys", ()):
                default = values.get(declared.name, declared.default)
                limits = declared.metadata.get("limits")
                read = self.flag if isinstance(default, bool) else self.text
                values[declared.name] = read(key, default) if limits is None else self.number(key, default, *limits)
        return values

    def whole(self, key: str, default: int, low: int, high: int) -> int:
        """Return a whole number; 256.0 is one too."""
        self._known[key] = None
        value = self._data.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            self.problem(key, f"must be a whole number, not {shown(value)}")
        elif not low <= value <= high:
            self.problem(key, f"must be {low} to {high}, not {shown(value)}")
        else:
            return value
        return default

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        self._known[key] = None
        value = self._data.get(key, default)
        if isinstance(value, bool):
            return value
        self.problem(key, f"must be true or false, not {shown(value)}")
        return default

    def text(self, key: str, default: str = "") -> str:
        """Return text."""
        self._known[key] = None
        value = self._data.get(key, default)
        if isinstance(value, str):
            return value
        self.problem(key, f"must be text, not {shown(value)}", "put it in quotes")
        return default

    def choice(self, key: str, default: str, words: Iterable[str], *, any_case: bool = False) -> str:
        """Return one of `words` as it is written there; "" is the default."""
        value = self.text(key, default) or default
        for word in words:
            if value == word or (any_case and value.lower() == word.lower()):
                return word
        self.problem(key, f"has an unknown value: {shown(value)}", nearest(value, words))
        return default

    def vector(self, default: Vec3) -> Vec3:
        """Return X, Y and Z of this object."""
        return self._three(("X", "Y", "Z"), default, _FAR_M)

    def angles_deg(self, default: Vec3) -> Vec3:
        """Return Roll, Pitch and Yaw of this object."""
        return self._three(("Roll", "Pitch", "Yaw"), default, 3600.0)

    def _three(self, keys: tuple[str, str, str], default: Vec3, most: float) -> Vec3:
        x, y, z = (self.optional(key, -most, most) for key in keys)
        return (default[0] if x is None else x, default[1] if y is None else y, default[2] if z is None else z)

    def child(self, key: str) -> Reader | None:
        """Return the reader of an object, None where the key is absent. As in AirSim, null and [] count as absent."""
        self._known[key] = None
        value = self._data.get(key)
        return None if value is None or value == [] else Reader(self.report, (*self.place, key), value)

    def named(self, key: str) -> list[tuple[str, Reader]] | None:
        """Return the objects of an object with their names, sorted as AirSim keeps them; None where it is absent."""
        group = self.child(key)
        if group is None:
            return None
        names = sorted(group._data)
        if len(names) > MAX_ENTRIES:
            self.problem(key, f"must hold at most {MAX_ENTRIES} entries, not {len(names)}")
        return [(name, Reader(self.report, (*group.place, name), group._data[name])) for name in names[:MAX_ENTRIES]]

    def listed(self, key: str) -> list[Reader]:
        """Return the objects of a list. Other elements are left out, as in AirSim."""
        self._known[key] = None
        value = self._data.get(key, [])
        if not isinstance(value, list):
            self.problem(key, f"must be a list in brackets, not {shown(value)}")
            return []
        if len(value) > MAX_ENTRIES:
            self.problem(key, f"must hold at most {MAX_ENTRIES} entries, not {len(value)}")
        readers = []
        for i, item in enumerate(value[:MAX_ENTRIES]):
            if isinstance(item, dict):
                readers.append(Reader(self.report, (*self.place, key, i), item))
            else:
                self.note(key, f"holds {shown(item)}, which is left out", "an element is an object in braces")
        return readers

    def without_meaning(self, *keys: str) -> None:
        """Name keys that AirSim reads and that change nothing here; the report tells those that are given, once."""
        self._known.update(dict.fromkeys(keys))
        self.report.without_meaning.update({key: None for key in keys if key in self._data})

    def close(self, section: str) -> None:
        """Note the keys that no call asked for, which AirSim ignores too: once in all objects of `section`."""
        for key in self._data:
            if key not in self._known:
                hint = nearest(key, self._known, listed=False)
                finding = self._finding(key, "is not a setting of AirSim and is ignored", hint)
                self.report.unknown.setdefault((section, key), finding)

    def _finding(self, key: str | None, message: str, hint: str) -> Problem:
        return at(self.report.document, self.place if key is None else (*self.place, key), message, hint)
