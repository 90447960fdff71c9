"""Shell patterns of strangers against the names of topics: `*`, `?`, `[abc]`, `[a-z]`, `[!abc]`.

Python's fnmatch makes a regular expression of each pattern and remembers thousands of them. What a stranger sends is
neither worth that time nor that memory: here a pattern is cut into tokens once, and no pattern that is longer than a
name costs more than a look at its length.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class _Class(NamedTuple):
    negated: bool
    chars: str
    ranges: list[tuple[str, str]]


_Token = str | _Class  # "*", "?", one character, or a class


def matching(names: Iterable[str], pattern: str) -> list[str]:
    """The names that fit, in their order. Upper and lower case differ; a slash is a character like any other."""
    tokens = _tokens(pattern)
    shortest = sum(t != "*" for t in tokens)
    return [name for name in names if shortest <= len(name) and _fits(tokens, name)]


def _tokens(pattern: str) -> list[_Token]:
    tokens: list[_Token] = []
    at = 0
    while at < len(pattern):
        char = pattern[at]
        end = _class_end(pattern, at) if char == "[" else -1
        if end > 0:
            tokens.append(_class(pattern[at + 1 : end]))
            at = end
        elif char != "*" or not tokens or tokens[-1] != "*":
            tokens.append(char)
        at += 1
    return tokens


def _class_end(pattern: str, at: int) -> int:
    """Where the class that begins here closes; -1: nowhere, it is a plain bracket. One behind [ or [! is in it."""
    first = at + 2 if pattern[at + 1 : at + 2] == "!" else at + 1
    return pattern.find("]", first + 1)


def _class(inside: str) -> _Class:
    negated = inside.startswith("!")
    inside = inside[negated:]
    chars, ranges, at = "", [], 0
    while at < len(inside):
        if inside[at + 1 : at + 2] == "-" and at + 2 < len(inside):
            ranges.append((inside[at], inside[at + 2]))
            at += 3
        else:
            chars += inside[at]
            at += 1
    return _Class(negated, chars, ranges)


def _fits(tokens: list[_Token], name: str) -> bool:
    """Greedy from left to right: only the last star passed ever has to take more."""
    t = n = 0
    star, star_n = -1, 0
    while n < len(name):
        if t < len(tokens) and tokens[t] == "*":
            star, star_n = t, n
            t += 1
        elif t < len(tokens) and _is(tokens[t], name[n]):
            t, n = t + 1, n + 1
        elif star >= 0:
            star_n += 1
            t, n = star + 1, star_n
        else:
            return False
    return all(left == "*" for left in tokens[t:])


def _is(token: _Token, char: str) -> bool:
    if isinstance(token, str):
        return token in ("?", char)
    negated, chars, ranges = token
    return (char in chars or any(low <= char <= high for low, high in ranges)) != negated
