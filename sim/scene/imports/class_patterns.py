"""Patterns by which the user gives classes to the objects of an imported map (`map.classes`)."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence


class ClassPatterns:
    """Shell patterns by class. The last pattern that matches counts; those that never match are known."""

    def __init__(self, classes: Mapping[str, Sequence[str]] | None) -> None:
        self._patterns = [
            (name, index, pattern)
            for name, patterns in (classes or {}).items()
            for index, pattern in enumerate(patterns)
        ]
        self._unmatched = dict.fromkeys((name, index) for name, index, _ in self._patterns)

    def class_of(self, names: Iterable[str], default: str) -> str:
        """Return the class of an object that has any of the names."""
        words = [name for name in names if name]
        for name, index, pattern in self._patterns:
            if any(fnmatch.fnmatchcase(word, pattern) for word in words):
                default = name
                self._unmatched.pop((name, index), None)
        return default

    @property
    def unmatched(self) -> tuple[tuple[str, int], ...]:
        """Class and index of each pattern that has matched nothing so far."""
        return tuple(self._unmatched)
