"""Regular expressions of clients: they mean what AirSim's users write, and none holds the server up."""

from __future__ import annotations

import contextlib
import random
import re
import time

import pytest

from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.world.objects.names import like, matching

COSTLY = [
    "(.|.)*!",
    "(a|a)*!",
    ".*.*.*.*.*.*!",
    "(a+)+b",
    "((((a*)*)*)*)*!",
    "(a{0,200}){0,200}!",
    "a?" * 60 + "a" * 60,
    r"\pL{1000}",
    "a?" * 100_000,
]


@pytest.mark.parametrize("pattern", COSTLY)
def test_no_expression_takes_long(pattern: str) -> None:
    begin_s = time.process_time()
    with contextlib.suppress(RpcError):
        assert matching(pattern, ["a" * 190] * 20, any_case=True) == []
    assert time.process_time() - begin_s < 1.0


@pytest.mark.parametrize("pattern", [".*", "Cube[0-9]+", "(Cone|Cube)_?1", "C.*_[12]", r"(?i)cube\d", "Cube1|", r"\w+"])
def test_expressions_mean_what_they_mean_in_python(pattern: str) -> None:
    source = random.Random(1)
    names = ["".join(source.choice(["Cube", "cube", "Cone", "_", "1", "2", "ä"]) for _ in range(3)) for _ in range(300)]
    names += ["Cube1", "Cone_1", ""]
    expected = [name for name in names if re.fullmatch(pattern, name)]
    assert len(expected) > 0
    if pattern == r"\w+":  # ASCII, as in ECMAScript
        expected = [name for name in expected if "ä" not in name]
    assert matching(pattern, names, any_case=False) == expected


@pytest.mark.parametrize("pattern", ["[", "(", "(a)\\1", "(?=a)a", "a++", "x\udcff", "[z-a]", "(a{0,200}){0,200}!"])
def test_the_error_names_the_expression_and_what_is_wrong(pattern: str) -> None:
    with pytest.raises(RpcError, match=r"' is not a regular expression \(https://github.com/google/re2\): \w.*"):
        matching(pattern, ["a"], any_case=False)


def test_a_name_that_is_not_unicode_is_listed() -> None:
    assert matching(".*", ["a\udcffb"], any_case=False) == ["a\udcffb"]


def test_wildcards() -> None:
    names = ["Cylinder_8", "Cone_5", "aXbYc", "aXbYd", "a.c"]
    assert like(["Cyl*"], names) == {"Cylinder_8"}
    assert like(["cone?5", "cylinder_?"], names) == {"Cone_5", "Cylinder_8"}
    assert like(["a*b*c"], names) == {"aXbYc"}
    assert like(["Cone", "a.*", "\udcff"], names) == {"a.c"}
