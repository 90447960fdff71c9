"""Several vehicles in one run: faults of one of them, and companions in control of each, live and from their traces."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

import pytest
from rich.console import Console

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.recorder.reading import read_messages
from hil.run.replay import fly_and_compare
from hil.run_files import TRACE_NAME
from signals.errors import RecordingError
from tests.worlds.hop_flights import HOP

BENCH = """
rig: mock
tick_hz: 100
mission: hop.waypoints
autopilot: {transport: loopback}
record: {report: false, tlog: false}
limits: {max_cross_track_m: null, final_error_m: null, altitude_error_m: null}
formation: {spacing_m: 4}
"""
SCRIPT = """
plan: hop.waypoints
actions:
  - {at_s: 12, fault: {rotor: 0, kind: efficiency, factor: 0.97}}
  - {after: takeoff, fault: {sensor: baro, kind: dropout, for_s: 0.2}}
"""


def fly(folder: Path, text: str) -> RunResult:
    (folder / "hop.waypoints").write_text(HOP)
    (folder / "script.yaml").write_text(SCRIPT)
    (folder / "bench.yaml").write_text(BENCH + text)
    return run_bench(load_bench(folder / "bench.yaml"), folder / "run", quiet=True)


def test_faults_of_a_script_and_of_a_bench_hit_their_own_vehicle(tmp_path: Path) -> None:
    wing = "wing: {faults: {sensors: [{kind: dropout, sensor: gps, at_s: 10, until_s: 10.5}]}}"
    result = fly(tmp_path, f"vehicles: {{lead: {{mission: script.yaml}}, {wing}, other: {{}}}}\n")
    assert result.run["error"] is None
    faults = defaultdict(list)
    for message in read_messages(result.out / "run.mcap"):
        _, name, topic = message.topic.split("/", 2) if message.topic.count("/") > 1 else ("", "", message.topic)
        if topic == "events" and any(word in message.decode()["msg"] for word in ("rotor 0", "baro", "gps")):
            faults[name].append(message.decode()["msg"])
    assert any(text.startswith("rotor 0:") for text in faults["lead"])
    assert any("baro" in text for text in faults["lead"])
    assert faults["wing"]
    assert all("gps" in text for text in faults["wing"])
    assert "other" not in faults


@pytest.mark.slow
def test_vehicles_flown_by_companions_repeat_from_their_traces(tmp_path: Path) -> None:
    """The computing times of the clients are measured, so only the traces repeat the flight."""
    text = "companion: {port: 0, start: [waypoints], control: true, rate_hz: 25, time: latency_true}\n"
    result = fly(tmp_path, text + "vehicles: {lead: {}, wing: {companion: {start: [waypoints, echo]}}}\n")
    assert (result.status, result.run["deterministic"]) == ("PASS", False), result.run["verdict"]
    clients = {
        name: set(json.loads((result.out / name / "run.json").read_text())["companion"]["clients"])
        for name in ("lead", "wing")
    }
    assert clients == {"lead": {"waypoints"}, "wing": {"waypoints", "echo"}}
    replayed = fly_and_compare(result.out, tmp_path / "again", Console(quiet=True))
    assert replayed.identical, str(replayed)
    with pytest.raises(RecordingError, match=f"hil replay {result.out}"):
        fly_and_compare(result.out / "lead", None, Console(quiet=True))
    (result.out / "wing" / TRACE_NAME).unlink()
    with pytest.raises(RecordingError, match="wing: this run on rig mock does not repeat"):
        fly_and_compare(result.out, tmp_path / "third", Console(quiet=True))
