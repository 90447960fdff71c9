"""Type and range checks of the values in a message; errors name the path of the value, such as welcome.ring.name."""

from __future__ import annotations

import math
from typing import Any

from hil_companion.errors import BadMessage

INT64_MAX = 2**63 - 1


class Fields:
    """Checked access to one map of a message. All methods raise BadMessage, with `path` as the name of the map."""

    def __init__(self, entries: Any, path: str) -> None:
        if not isinstance(entries, dict):
            raise BadMessage(f"{path}: a map is needed, this is {type(entries).__name__}")
        self.entries: dict[Any, Any] = entries
        self.path = path

    def get(self, name: str) -> Any:
        if name not in self.entries:
            raise BadMessage(f"{self.path}.{name} is missing")
        return self.entries[name]

    def integer(self, name: str, low: int = 0, high: int = INT64_MAX) -> int:
        value = self.get(name)
        if type(value) is not int or not low <= value <= high:
            raise self.type_error(name, f"a whole number from {low} to {high}")
        return int(value)

    def number(self, name: str, low: float = -math.inf, high: float = math.inf) -> float:
        value = self.get(name)
        if type(value) not in (int, float) or not math.isfinite(value) or not low <= value <= high:
            raise self.type_error(name, f"a finite number from {low} to {high}")
        return float(value)

    def boolean(self, name: str) -> bool:
        value = self.get(name)
        if type(value) is not bool:
            raise self.type_error(name, "true or false")
        return value

    def text(self, name: str, longest: int = 4096) -> str:
        value = self.get(name)
        if not isinstance(value, str) or len(value) > longest:
            raise self.type_error(name, f"text of at most {longest} characters")
        return value

    def choice(self, name: str, choices: Any) -> str:
        value = self.text(name)
        if value not in choices:
            raise self.type_error(name, "one of " + ", ".join(choices))
        return value

    def sequence(self, name: str, longest: int) -> list[Any]:
        value = self.get(name)
        if not isinstance(value, list) or len(value) > longest:
            raise self.type_error(name, f"a list of at most {longest} entries")
        return value

    def mapping(self, name: str) -> dict[str, Any]:
        value = self.get(name)
        if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
            raise self.type_error(name, "a map with text for keys")
        return value

    def optional_map(self, name: str) -> dict[str, Any] | None:
        return None if self.entries.get(name) is None else self.mapping(name)

    def type_error(self, name: str, needed: str) -> BadMessage:
        """Return the error for an entry that is not `needed`."""
        return BadMessage(f"{self.path}.{name}: {needed} is needed, this is {str(self.entries.get(name))[:60]!r}")
