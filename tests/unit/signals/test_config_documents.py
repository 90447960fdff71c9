"""Strict YAML and JSON: what values mean, on which line they stand, and what is refused where."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from signals.documents.document import read_text, shown_path
from signals.documents.json_lines import parse_json
from signals.documents.yaml_lines import dump_yaml, parse_yaml
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from sim.sensors.presets import load_preset


def problems(parse: Any, text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "f")
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("on", "on"), ("yes", "yes"), ("No", "No"), ("OFF", "OFF"), ("y", "y"), ("true", True), ("False", False),
        ("1:30", "1:30"), ("190:20:30", "190:20:30"), ("010", 10), ("0o10", 8), ("0x1F", 31), ("1_000", "1_000"),
        ("1e3", 1000.0), ("1.5E-3", 0.0015), (".5", 0.5), ("-7", -7), ("+7", 7), ("1.", 1.0), ("~", None),
        ("null", None), ("2001-12-14", "2001-12-14"), ("-.inf", -math.inf), (".INF", math.inf), ("'1'", "1"),
        ("1.2.3", "1.2.3"), ("e3", "e3"),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    read = parse_yaml(f"a: {text}\n", "f").data["a"]
    assert read == value
    assert type(read) is type(value)


def test_every_place_knows_its_line() -> None:
    document = parse_yaml("a: 1\nb:\n  c: [1,\n    2]\n  d:\n  - x: 1\n  -\n    y: 2\n", "f")
    expected = {("a",): 1, ("b",): 2, ("b", "c"): 3, ("b", "c", 1): 4, ("b", "d", 0, "x"): 6, ("b", "d", 1, "y"): 8}
    assert {place: document.lines[place] for place in expected} == expected
    assert document.where(("b", "c", 9, "z")) == "f:3"


def test_anchors_and_merges_keep_the_line_of_what_they_bring() -> None:
    document = parse_yaml("base: &b\n  x: 1\n  y: 2\nother:\n  <<: *b\n  y: 3\n", "f")
    assert document.data["other"] == {"x": 1, "y": 3}
    assert document.where(("other", "x")) == "f:2"
    assert document.where(("other", "y")) == "f:6"


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("a: 1\nb: 2\na: 3\n", "f:3", "a is given twice (the first one is on line 1)"),
        ("a:\n  b: 1\n  b: 1\n", "f:3", "a.b is given twice"),
        ("a:\n\tb: 1\n", "f:2", "tab"),
        ("a: [1,\nb: 2\n", "f:", "not valid YAML"),
        ("a: 1\n b: 2\n", "f:2", "not valid YAML"),
        ("1: a\n", "f:1", "a key must be text, not 1"),
        ("true: a\n", "f:1", "a key must be text"),
        ("a: &x\n  b: *x\n", "f:1", "contains itself"),
        ("a: *nobody\n", "f:1", "undefined alias"),
        ("a: !!python/object/apply:os.getcwd []\n", "f:1", "tag"),
        ("a: !!int x\n", "f:1", "is not a value of type !!int"),
        ("a: 1\n---\nb: 2\n", "f:2", "not valid YAML"),
        ("a: 1\nb: \x07\n", "f:2", "U+0007"),
    ],
)
def test_refused_yaml_names_the_line(text: str, where: str, words: str) -> None:
    found = problems(parse_yaml, text)
    assert len(found) == 1, found
    assert found[0].startswith(where)
    assert words in found[0]


def test_aliases_of_aliases_do_not_eat_the_memory() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert "values once unfolded" in problems(parse_yaml, "\n".join(lines))[0]


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=20,
)


def places(value: Any, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [here, *(place for key, child in children for place in places(child, (*here, key)))]


@given(PLAIN, st.sampled_from([None, 1]))
def test_json_reads_back_and_every_place_has_a_line(value: Any, indent: int | None) -> None:
    text = json.dumps(value, indent=indent)
    document = parse_json(text, "f")
    assert document.data == value
    assert sorted(document.lines, key=repr) == sorted(places(value), key=repr)
    assert set(document.lines.values()) <= set(range(1, text.count("\n") + 2))


@given(PLAIN)
def test_pyyaml_and_this_reader_agree_on_quoted_files(value: Any) -> None:
    text = yaml.safe_dump({"v": value}, default_style='"', allow_unicode=True)
    assert parse_yaml(text, "f").data == {"v": yaml.safe_load(text)["v"]}


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("", "f", "is empty"),
        ('{"a": 1,\n"b": }', "f:2", "not valid JSON"),
        ('{"a": 1,\n"b": {"a": 1,\n"a": 2}}', "f:3", "'a' is given twice (the first one is on line 2)"),
    ],
)
def test_refused_json_names_the_line(text: str, where: str, words: str) -> None:
    found = problems(parse_json, text)
    assert found[0].startswith(where)
    assert words in found[0]


def test_deep_nesting_is_refused_on_its_line() -> None:
    assert "nested too deeply" in problems(parse_json, "[" * 200_000)[0]
    for depth in (52, 300, 20_000):
        text = "a: 1\nb: " + "[" * depth + "]" * depth
        assert problems(parse_yaml, text) == ["f:2: is nested too deeply: more than 50 levels"]
    assert parse_yaml("b: " + "[" * 49 + "]" * 49, "f").data


def test_half_characters_are_refused() -> None:
    assert problems(parse_yaml, 'a: 1\nb: "\\ud800"\n')[0].startswith("f:2: holds half a surrogate pair")
    assert problems(parse_yaml, '"\\udfff": 1\n')[0].startswith("f:1: a key holds half")


def test_only_regular_files_are_read_and_no_more_than_the_limit(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    (tmp_path / "long").write_text("x" * 101)
    for path, words in (
        (tmp_path / "pipe", "not a regular file"), (Path("/dev/zero"), "not a regular file"), (loop, "cannot be read"),
        (tmp_path / "long", "more than"), (tmp_path / ("n" * 300), "cannot be read"), (Path("a\0b"), "cannot be read"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=words):
            read_text(path, limit_bytes=100)


def test_paths_are_shown_after_the_working_directory_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert shown_path(Path("b.yaml")) == "b.yaml"


VEHICLE = (Path(__file__).parents[3] / "rigs/vehicles/x500.yaml").read_text()
PRESET = """kind: gps
part: "x"
sources: {}
parameters:
  satellites: {value: 12, status: choice}
"""


@pytest.mark.parametrize(
    ("read", "text", "words"),
    [
        (load_vehicle, VEHICLE + "mass_kg: 2.0\n", "mass_kg is given twice (the first one is on line "),
        (load_vehicle, VEHICLE.replace("mass_kg:", "mas_kg:"), "mas_kg: unknown key (did you mean 'mass_kg'?)"),
        (load_vehicle, VEHICLE.replace("mass_kg: ", "mass_kg: !!str "), "mass_kg must be a number in kg"),
        (
            load_preset,
            PRESET.replace("gps", "camera").replace("satellites: {value: 12", "shadows: {value: yes"),
            "f.yaml:5: parameters.shadows must be true or false, not 'yes' (write true or false)",
        ),
        (load_preset, PRESET + "part: y\n", "f.yaml:6: part is given twice (the first one is on line 2)"),
        (load_preset, PRESET + "sorces: {}\n", "f.yaml:6: sorces: unknown key (did you mean 'sources'?)"),
        (
            load_preset,
            PRESET.replace("satellites", "satelites"),
            "f.yaml:5: parameters.satelites: unknown key (did you",
        ),
        (load_preset, PRESET.replace("12", "yes"), "f.yaml:5: parameters.satellites must be a whole number, not 'yes'"),
        (load_preset, PRESET.replace("12", "0o14.5"), "f.yaml:5: parameters.satellites must be a whole number"),
    ],
)
def test_vehicles_and_presets_are_read_as_strictly_as_benches(
    read: Any, text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("f.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        read(Path("f.yaml"))
    assert words in str(caught.value)
    assert str(caught.value).startswith("f.yaml:")


@given(PLAIN)
def test_what_is_written_reads_back_as_the_very_same(value: Any) -> None:
    assert parse_yaml(dump_yaml({"v": value}), "f").data == {"v": value}
