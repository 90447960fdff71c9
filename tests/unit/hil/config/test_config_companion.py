"""The section `companion` of a bench file: every mistake is named with its line and a hint."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from firmware_bridge.companion.keys import make_keys
from hil.config import Bench
from hil.config.companion.clients import source_files
from hil.run.companion import link
from signals.errors import LinkClosed
from tests.worlds import bench_files
from tests.worlds.bench_files import elsewhere  # noqa: F401 (the fixture is for every test)


def file_of(*lines: str, more: str = "") -> str:
    """A bench file whose companion has these lines, from line 2 on."""
    return "companion:\n" + "".join(f"  {line}\n" for line in lines) + more


def load(*lines: str, more: str = "") -> Bench:
    return bench_files.load(file_of(*lines, more=more))


def problems(*lines: str, more: str = "", rig: str | None = None) -> list[str]:
    return bench_files.refused(file_of(*lines, more=more), rig=rig)


def problem(*lines: str, more: str = "", rig: str | None = None) -> str:
    (only,) = problems(*lines, more=more, rig=rig)
    return only


SEARCH = """\
scene: city_park
sensors: {front: {kind: camera, resolution: [64, 48], fov_deg: 80, rate_hz: 2}}
search:
  label: %s
"""


@pytest.mark.parametrize(
    ("label", "clients", "told"),
    [
        ("preson", "start: [detect]", "is not a class of the detector: 'preson' (did you mean 'person'?)"),
        ("Person", "start: [detect]", "is not a class of the detector: 'Person' (did you mean 'person'?)"),
        ("zebra", "start: [echo, detect]", "'zebra' (known: barrel, "),
        ("zebra", "start: [{name: detect, settings: {model: good}}]", "'zebra' (known: barrel, "),
        ("vehicle", "start: [detect]", "is 'vehicle', and detect reports the objects of person alone"),
        ("person", "start: [{name: detect, settings: {objects: [dog, bin]}}]", "the objects of dog, bin alone"),
        ("person", "start: [{name: detect, settings: {objects: []}}]", "detect reports no objects"),
        ("person", "start: [detect]", None),
        ("vehicle", "settings: {objects: [person, vehicle]}, start: [detect]", None),
        ("vehicle", "settings: {objects: null}, start: [detect]", None),
        ("tree", "start: [detect, json.decoder:client]", None),
        ("tree", "start: [detect], clients: 2", None),
        ("tree", "clients: 1", None),
        ("tree", "settings: {model: mine.onnx}, start: [detect]", None),
        ("tree", "settings: {threshold: high}, start: [detect]", None),
        ("tree", 'settings: {model: "a\\0.onnx"}, start: [detect]', None),
    ],
)
def test_a_search_for_what_the_detector_never_reports_is_refused(label: str, clients: str, told: str | None) -> None:
    """The flight failed with nobody found."""
    text = SEARCH % label + f"companion: {{{clients}}}\n"
    if told is None:
        assert bench_files.load(text)
    else:
        (refused,) = bench_files.refused(text)
        assert refused.startswith("b.yaml:4: search.label ")
        assert told in refused


def test_a_search_without_a_client_that_reports_objects_is_refused() -> None:
    (refused,) = bench_files.refused(SEARCH % "person" + "companion: {start: [echo, record]}\n")
    hint = "companion: {start: [detect]} or, for one that connects itself, clients: 1 more than are started"
    assert refused == f"b.yaml:3: search needs a companion that searches ({hint})"
    assert bench_files.load(SEARCH % "person" + "companion: {start: [echo], clients: 2}\n")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("clients: -1", "companion.clients"),
        ("clients: many", "companion.clients"),
        ("start: [echo, 1]", "companion.start"),
        ("start: [{name: echo, setings: {}}]", "settings"),
        (f"start: [{', '.join(f'm:c{i}' for i in range(9))}]", "companion.start"),
        ("control: maybe", "companion.control"),
        ("rate_hz: .nan", "companion.rate_hz"),
        ("arrangement: wireless", "companion.arrangement"),
        ("sensor_port: 80", "companion.sensor_port"),
        ("on_loss: panic", "companion.on_loss"),
        ("setpoint_hz: 251", "companion.setpoint_hz"),
    ],
)
def test_a_value_out_of_range_is_named_with_its_line(line: str, words: str) -> None:
    text = problem(line, *(["clients: 1"] if not line.startswith("clients") else []))
    assert text.startswith("b.yaml:2: ")
    assert words in text


@pytest.mark.parametrize(
    ("lines", "more", "where", "words"),
    [
        (["time: realtime", "clients: 1"], "", 2, "the run is not paced to real time .*pace=1"),
        (["start: [waypoint]"], "", 2, "does not exist: 'waypoint'.*waypoints"),
        (["start: [echo, 'json:echo']"], "", 2, "names echo twice"),
        (["start: ['pilot:fly']"], "", 2, "the module 'pilot', which cannot be found.*PYTHONPATH"),
        (["start: ['json.pilot:fly']"], "", 2, "the module 'json.pilot', which cannot be found"),
        (["clients: 1", "rate_hz: 251"], "", 3, "at most the tick's rate, 250 Hz, not 251 Hz"),
        (["clients: 1", "rate_hz: 10.0001"], "", 3, "whole number of millihertz"),
        (
            ["clients: 1", "setpoint_hz: 200"],
            "tick_hz: 100\n",
            3,
            "setpoint_hz must be",
        ),
        (["control: true"], "", 2, "there are no clients"),
        (["clients: 1", "trace: nowhere.jsonl"], "", 3, "does not exist: nowhere.jsonl"),
        (["clients: 1", "arrangement: one_port", "host: 0.0.0.0"], "", 4, "reached from other machines.*hil keys"),
        (["clients: 1", "arrangement: one_port", "keys: nowhere"], "", 4, "nowhere.*hil keys"),
        (["arrangement: ports", "clients: 1", "port: 6002", "sensor_port: 6000"], "", 4, "among the sensors' ports"),
        (["arrangement: ports", "clients: 1", "sensor_port: 65534"], "", 4, "leaves no room for 5 ports"),
    ],
)
def test_values_that_do_not_fit_the_rest_of_the_bench(lines: list[str], more: str, where: int, words: str) -> None:
    text = problem(*lines, more=more)
    assert text.startswith(f"b.yaml:{where}: "), text
    assert re.search(words, text), text


def test_free_running_firmware_needs_realtime() -> None:
    port = "autopilot: {port: /dev/null}\n"
    text = "; ".join(problems("clients: 1", "time: latency_true", more=port, rig="px4_hitl"))
    assert "b.yaml:3: companion.time is 'latency_true', but px4_hitl runs on wall-clock time" in text
    assert "companion.time=realtime" in text


def test_a_companion_in_control_excludes_scripts_and_manual_control() -> None:
    script = Path(__file__).resolve().parents[4] / "rigs" / "missions" / "rectangle_gust.yaml"
    text = problem("clients: 1", "control: true", more=f"mission: {script}\n")
    assert text.startswith("b.yaml:3: companion.control is true, but the mission is a script")
    both = problems("clients: 1", "control: true", more="mission: null\nmanual: {device: keyboard}\n")
    assert any("both would command the vehicle" in p for p in both), both


def test_keys_are_checked_before_the_run() -> None:
    make_keys(Path("keys"), ["waypoints"])
    good = ["arrangement: one_port", "keys: keys", "host: 0.0.0.0"]
    assert load("start: [waypoints]", *good).config.companion.keys == "keys"
    assert "b.yaml:4: companion.keys names a folder without keys of echo" in problem("start: [waypoints, echo]", *good)
    Path("keys/bench.key").write_text("rubbish\n")
    text = problem("start: [waypoints]", *good)
    assert text.startswith("b.yaml:4: companion.keys cannot be used")


def test_all_problems_come_at_once_and_a_valid_section_passes() -> None:
    found = problems("start: [nobody]", "rate_hz: 300", "time: realtime", "setpoint_hz: 200", more="tick_hz: 100\n")
    assert {p.split(":")[1] for p in found} >= {"2", "3", "4", "5"}
    companion = load("start: [waypoints, 'json.decoder:Cut']", "control: true", "rate_hz: 25").config.companion
    assert (companion.on, companion.expected, companion.port) == (True, 2, 5570)
    assert not load("rate_hz: 300").config.companion.on  # without clients the section is not used


def test_a_client_in_nested_folders_without_an_init_file_is_found() -> None:
    """The outer folder was looked up among the imported modules: KeyError."""
    folder = Path("outer/inner")
    folder.mkdir(parents=True)
    for name in ("pilot.py", "helper.py"):
        (folder / name).touch()
    assert load("start: ['outer.inner.pilot:fly']").config.companion.on
    found = [(name, path.resolve()) for name, path in source_files("outer.inner.pilot:fly")]
    assert found == [(f"inner/{name}", (folder / name).resolve()) for name in ("helper.py", "pilot.py")]
    assert "'outer.inner.nobody', which cannot be found" in problem("start: ['outer.inner.nobody:fly']")
    assert "'outer.nobody.pilot', which cannot be found" in problem("start: ['outer.nobody.pilot:fly']")


def test_a_started_client_has_its_own_settings_over_those_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[str, Mapping[str, Any]]] = []

    def start(cut: str, _address: str, _out: Path, settings: Mapping[str, Any], _keys: Path | None) -> Any:
        started.append((cut, settings))
        if len(started) == 2:
            raise LinkClosed("companion", "it is not there")
        return SimpleNamespace(running=False, bad_end=lambda: None, close=lambda: None)

    monkeypatch.setattr(link, "StartedClient", start)
    lines = [
        "port: 0",
        "settings: {out: a, keep_mb: 1}",
        "start: [echo, {name: record, settings: {out: b, stop: true}}]",
    ]
    companion = link.CompanionLink(load(*lines).config, tmp_path, waypoints_W=(), on_event=lambda *_: None)
    with pytest.raises(LinkClosed):
        companion.open()
    companion.close()
    assert started == [
        ("echo", {"out": "a", "keep_mb": 1}),
        ("record", {"out": "b", "keep_mb": 1, "stop": True}),
    ]
