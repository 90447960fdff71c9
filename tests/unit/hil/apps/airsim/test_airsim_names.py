"""Regular expressions of clients: they mean what Python's mean, and none holds the server up."""

from __future__ import annotations

import contextlib
import random
import re
import time

import pytest

from hil.apps.airsim.pictures.names import matching
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.rpc.patterns import BoundedPattern

COSTLY = [
    "(.|.)*!",
    "(a|a)*!",
    ".*.*.*.*.*.*!",
    "(a+)+b",
    "((((a*)*)*)*)*!",
    "(a{0,200}){0,200}!",
    "a?" * 60 + "a" * 60,
]


@pytest.mark.parametrize("pattern", COSTLY)
def test_no_expression_takes_long(pattern: str) -> None:
    begin_s = time.process_time()
    with contextlib.suppress(RpcError):
        assert matching(pattern, ["a" * 190] * 20) == []
    assert time.process_time() - begin_s < 2.0


@pytest.mark.parametrize(
    "pattern",
    [
        r"a|b*c",
        r"(?:ab|a)(c|bcd)(d*)",
        r"[a-c]+?\d{2,}",
        r"\bA.c$",
        r"^a{2}b{,2}$",
        r"(a|)*b?",
        r"[^]]\x61|\]",
        r"a{x}",
    ],
)
def test_expressions_mean_what_they_mean_in_python(pattern: str) -> None:
    source = random.Random(1)
    names = ["".join(source.choice("abcdA12]{x}") for _ in range(source.randrange(7))) for _ in range(3000)]
    names += ["abcd", "a{x}", "b12", "A1c", "aab", "aabb", "aaaa", "]", "xa"]
    expected = [name for name in names if re.fullmatch(pattern, name, re.IGNORECASE)]
    expression = BoundedPattern(pattern, re.IGNORECASE)
    assert expected
    for name in names:
        assert BoundedPattern(pattern, re.IGNORECASE).fullmatch(name) is (name in expected), name
    assert expression.fullmatch(expected[0])
