"""Regular expressions whose costs are bounded: all ways through an expression are followed at once (Thompson 1968).

Python's `re` follows one way after the other, which may take years for one name. It still compiles the expression, and
matches every character and position of it, so that these mean the same. A set of positions is an integer: bit p of it
is set for the position p.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import reduce
from operator import or_

MOST_STEPS = 200_000  # of one question, about 0.2 s
_ATOM = re.compile(r"\\(?:x..|u.{4}|U.{8}|N\{[^}]*\}|[0-3][0-7]{2}|0[0-7]?|.)|\[\^?\]?(?:\\.|[^\]\\])*\]|.", re.DOTALL)
_REPEAT = re.compile(r"(?:([*+?])|\{(\d+)\}|\{(\d*),(\d*)\})\??")
_OPEN = re.compile(r"\((?:\?:|\?P<[^>]*>|(?!\?))")
_BACK_REFERENCE = re.compile(r"\\[1-9]")
_ENDLESS = 1 << 30

Node = Callable[[str, int], int]  # name, position -> positions after a match


class CostError(Exception):
    """Expression that takes too long, or holds what cannot be matched in a bounded time."""


class BoundedPattern:
    """Regular expression. Raises re.error for one that is none, CostError for one that cannot be bounded."""

    def __init__(self, text: str, flags: int) -> None:
        re.compile(text, flags)
        self._text, self._flags, self._at = text, flags, 0
        self._steps = 0
        self._root = self._alternatives()
        if self._at != len(text):
            raise CostError(text)

    def fullmatch(self, name: str) -> bool:
        """Return True if the whole name matches. Raises CostError after MOST_STEPS steps of all names."""
        return bool(self._root(name, 0) >> len(name) & 1)

    # Syntax ----------------------------------------------------------------------------------------------------------

    def _alternatives(self) -> Node:
        ways = [self._sequence()]
        while self._text.startswith("|", self._at):
            self._at += 1
            ways.append(self._sequence())
        return ways[0] if len(ways) == 1 else self._kept(lambda name, at: reduce(or_, (way(name, at) for way in ways)))

    def _sequence(self) -> Node:
        items: list[Node] = []
        while self._at < len(self._text) and self._text[self._at] not in "|)":
            item = self._item()
            repeat = _REPEAT.match(self._text, self._at)
            if repeat is not None:
                self._at = repeat.end()
                if self._text.startswith("+", self._at):
                    raise CostError(self._text)  # possessive: not all ways count
                item = self._repeated(item, *_counts(repeat))
            items.append(item)

        def follow(name: str, at: int) -> int:
            positions = 1 << at
            for item in items:
                positions = self._after(item, name, positions)
            return positions

        return items[0] if len(items) == 1 else self._kept(follow)

    def _item(self) -> Node:
        text = self._text
        if _BACK_REFERENCE.match(text, self._at):
            raise CostError(text)
        if text[self._at] == "(":
            opened = _OPEN.match(text, self._at)
            if opened is None:
                raise CostError(text)
            self._at = opened.end()
            inner = self._alternatives()
            self._at += 1
            return inner
        found = _ATOM.match(text, self._at)
        assert found is not None
        self._at = found.end()
        atom = re.compile(found[0], self._flags)

        def match(name: str, at: int) -> int:
            end = atom.match(name, at)
            return 0 if end is None else 1 << end.end()

        return self._kept(match)

    # Matching --------------------------------------------------------------------------------------------------------

    def _repeated(self, item: Node, least: int, most: int) -> Node:
        def repeat(name: str, at: int) -> int:
            positions = 1 << at
            for _ in range(min(least, len(name) + 1)):  # after so many, the positions stay the same
                positions = self._after(item, name, positions)
            new = reached = positions
            for _ in range(min(most - least, len(name) + 1)):
                new = self._after(item, name, new) & ~reached
                if not new:
                    break
                reached |= new
            return reached

        return self._kept(repeat)

    def _after(self, item: Node, name: str, positions: int) -> int:
        found = 0
        while positions:
            lowest = positions & -positions
            positions ^= lowest
            found |= item(name, lowest.bit_length() - 1)
        return found

    def _kept(self, node: Node) -> Node:
        """Return a node that remembers its answers for the present name, and counts its steps."""
        known: dict[int, int] = {}
        of: list[str | None] = [None]

        def ask(name: str, at: int) -> int:
            self._steps += 1
            if self._steps > MOST_STEPS:
                raise CostError(self._text)
            if of[0] is not name:
                of[0] = name
                known.clear()
            if at not in known:
                known[at] = node(name, at)
            return known[at]

        return ask


def _counts(repeat: re.Match[str]) -> tuple[int, int]:
    """Return the least and the greatest number of repetitions."""
    sign, exact, low, high = repeat.groups()
    if sign is not None:
        return int(sign == "+"), 1 if sign == "?" else _ENDLESS
    if exact is not None:
        return int(exact), int(exact)
    return int(low or 0), int(high) if high else _ENDLESS
