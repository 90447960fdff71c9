"""Patterns of topics mean what they mean to Python's fnmatch, and cost little whatever they are."""

from __future__ import annotations

import random
from fnmatch import fnmatchcase

import pytest

from firmware_bridge.companion.patterns import matching


@pytest.mark.parametrize("alphabet", ["ab/*?", "ab*?[]!", "abc[]*/"])
def test_as_fnmatch(alphabet: str) -> None:
    rng = random.Random(4)
    for _ in range(4000):
        pattern = "".join(rng.choices(alphabet, k=rng.randint(1, 8)))
        names = ["".join(rng.choices("abc/]![", k=rng.randint(0, 5))) for _ in range(4)]
        assert matching(names, pattern) == [n for n in names if fnmatchcase(n, pattern)], pattern


@pytest.mark.parametrize("pattern", ["[a-c]x", "[!a-c]x", "[a-cx-z]*", "[-a]?", "[a-]?", "*[b-b]*", "[c-a]x", "?-?"])
def test_ranges_as_fnmatch(pattern: str) -> None:
    names = ["ax", "bx", "dx", "-x", "a-x", "abc", "x", "", "zz", "cx-"]
    assert matching(names, pattern) == [n for n in names if fnmatchcase(n, pattern)]
