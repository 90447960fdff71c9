"""Strict JSON with line numbers, which are determined when a message needs them."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from signals.documents.document import Document, Place, read_text, shown_path
from signals.errors import ConfigError, Problem

_LIMIT_BYTES = 64_000_000
_LIMIT_VALUES = 5_000_000  # a value takes some 100 bytes; a mission of 65,535 items has a million
_MAX_DUPLICATES = 20  # duplicate keys that are located, each by a pass over the whole text
_LEXEME = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')


class _Lines(Mapping[Place, int]):
    """Line of every place of a JSON text, found on first use: files without problems never need it."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._lines: dict[Place, int] | None = None

    def _table(self) -> dict[Place, int]:
        if self._lines is None:
            self._lines = dict(_places(self._text))
        return self._lines

    def __getitem__(self, place: Place) -> int:
        return self._table()[place]

    def __iter__(self) -> Iterator[Place]:
        return iter(self._table())

    def __len__(self) -> int:
        return len(self._table())


def _places(text: str) -> Iterator[tuple[Place, int]]:
    """Yield every place of a valid JSON text with its line, in order of appearance."""
    place: list[str | int] = []
    in_object: list[bool] = []
    expect_key = False
    line, counted_to = 1, 0
    for match in _LEXEME.finditer(text):
        line += text.count("\n", counted_to, match.start())
        counted_to = match.start()
        lexeme = match.group()
        if lexeme in ",:":
            if lexeme == "," and in_object:
                last = place.pop()
                if in_object[-1]:
                    expect_key = True
                else:
                    assert isinstance(last, int)
                    place.append(last + 1)
            continue
        if lexeme in "}]":
            opened_object = in_object.pop()
            if not (opened_object and expect_key):  # an empty object has no key to remove
                place.pop()
            expect_key = False
            continue
        if expect_key:
            place.append(json.loads(lexeme, strict=False))
            expect_key = False
            yield tuple(place), line
            continue
        if not (in_object and in_object[-1]):
            yield tuple(place), line
        if lexeme == "{":
            in_object.append(True)
            expect_key = True
        elif lexeme == "[":
            in_object.append(False)
            place.append(0)


def parse_json(text: str, source: str, *, repeated: list[Problem] | None = None) -> Document:
    """Parse one JSON document; NaN and Infinity become floats. Raises ConfigError.

    `repeated`, if given, collects the duplicate keys, of which the last one counts, instead of an error.
    """
    duplicates: list[str] = []

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(items)
        if len(result) != len(items):
            counts = Counter(key for key, _ in items)
            duplicates.extend(key for key in result if counts[key] > 1)
        return result

    if not text.strip():
        raise ConfigError.at(source, "is empty")
    values = text.count(",") + text.count("[") + text.count("{")
    if values > _LIMIT_VALUES:
        message = f"holds {values:,} values; {_LIMIT_VALUES:,} are read"
        raise ConfigError.at(source, message, "is it the file you meant?")
    try:
        data = json.loads(text, object_pairs_hook=pairs)
    except json.JSONDecodeError as error:
        raise ConfigError.at(f"{source}:{error.lineno}", f"is not valid JSON: {error.msg}") from None
    except RecursionError:
        raise ConfigError.at(source, "is nested too deeply") from None
    except ValueError as error:  # an integer of thousands of digits
        raise ConfigError.at(source, f"is not valid JSON: {error}") from None
    document = Document(source, data, _Lines(text))
    if duplicates:
        found = [_duplicate_problem(text, source, key) for key in list(dict.fromkeys(duplicates))[:_MAX_DUPLICATES]]
        if repeated is None:
            raise ConfigError(found)
        repeated += found
    return document


def _duplicate_problem(text: str, source: str, key: str) -> Problem:
    """Return the problem at the second of two equal keys."""
    first_line: dict[Place, int] = {}
    for place, line in _places(text):
        if place and place[-1] == key and place in first_line:
            hint = f"the first one is on line {first_line[place]}"
            return Problem(f"{source}:{line}", f"{key!r} is given twice", hint)
        first_line[place] = line
    return Problem(source, f"{key!r} is given twice")


def read_json(path: Path) -> Document:
    """Read and parse a file. Raises ConfigError."""
    return parse_json(read_text(path, limit_bytes=_LIMIT_BYTES), shown_path(path))
