"""Flights that a companion flies: lockstep and latency-true, live, from the trace, and beside a busy processor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from firmware_bridge.companion.keys import make_keys
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.replay import replay
from hil.run_files import TRACE_NAME
from tests.worlds.hop_flights import CAMERAS, RECTANGLE, fly, saved
from tests.worlds.run_json_schema import problems_of
from tests.worlds.strained_machine import busy_processors

PILOT = "start: [waypoints], control: true, rate_hz: 25"
RECORDED = "record: {report: false, tlog: false}\n"


def from_trace(run: Path, out: Path, *settings: str) -> RunResult:
    trace = f"companion.trace={run / TRACE_NAME}"
    return run_bench(load_bench(run / "bench.yaml", settings=[trace, *settings]), out, quiet=True)


def repeated(run: Path, out: Path) -> str:
    def again(config: Path, folder: Path) -> None:
        run_bench(load_bench(config, settings=[f"companion.trace={run / TRACE_NAME}"]), folder, quiet=True)

    result = replay(run, again, out_dir=out)
    assert result.identical, str(result)
    return str(result.digests[1])


def assert_flown(run: dict[str, Any], time: str) -> None:
    assert run["error"] is None, run["error"]
    assert problems_of(run) == []
    # The client's computing time is measured, so only its trace repeats such a flight.
    assert (run["status"], run["deterministic"]) == ("PASS", time == "lockstep")
    pilot = run["companion"]["clients"]["waypoints"]
    assert (pilot["control"], pilot["finished"], pilot["malformed"]) == (True, True, 0)
    assert run["companion"]["time"] == time
    assert run["companion"]["refused"] == []
    if time == "lockstep":
        assert (pilot["frames"], pilot["dropped"]) == (run["companion"]["frames"], 0)
    assert pilot["frames"] + pilot["dropped"] == pytest.approx(run["companion"]["frames"], abs=1)
    assert all(pilot[part]["p50"] >= 0.0 for part in ("t1_ms", "t2_ms", "t3_ms"))


@pytest.mark.slow
def test_the_rectangle_in_lockstep(tmp_path: Path) -> None:
    outcome = fly(tmp_path, PILOT, mission=RECTANGLE)
    assert_flown(outcome.run, "lockstep")
    assert outcome.run["mission"]["reached"] == 6


@pytest.mark.parametrize("mission", ["hop", pytest.param("rectangle", marks=pytest.mark.slow)])
def test_a_flight_in_latency_true_time_and_again_beside_busy_processors(tmp_path: Path, mission: str) -> None:
    outcome = fly(tmp_path, f"{PILOT}, time: latency_true", mission=RECTANGLE if mission == "rectangle" else None)
    assert_flown(outcome.run, "latency_true")
    with busy_processors(2):
        again = from_trace(outcome.out, tmp_path / "again")
    assert again.run["error"] is None
    assert again.run["digest"] == outcome.run["digest"]
    # The answers' times matter: half a second more latency on the link gives another flight.
    other = from_trace(outcome.out, tmp_path / "other", "companion.link_delay_s=0.5", "duration_s=15")
    assert other.run["digest"] != again.run["digest"]


@pytest.mark.slow
def test_a_lockstep_flight_is_the_same_beside_busy_processors_and_its_recording_repeats(tmp_path: Path) -> None:
    first = fly(tmp_path / "first", PILOT, RECORDED)
    with busy_processors(2):
        second = fly(tmp_path / "second", PILOT)
    assert_flown(first.run, "lockstep")
    assert first.run["mission"]["reached"] == first.run["mission"]["waypoints"]
    assert first.run["digest"] == second.run["digest"]
    traced = [(r.out / TRACE_NAME).read_text().count("\n") for r in (first, second)]
    assert traced[0] == traced[1] > 100
    assert repeated(first.out, tmp_path / "again") == first.run["digest"]


def test_every_arrangement_carries_the_same_flight_with_the_keys_of_the_bench(tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", ["waypoints", "echo"])
    digests = set()
    for arrangement in ("shared_memory", "one_port", "ports"):
        shown = f"arrangement: {arrangement}, keys: {tmp_path / 'keys'}"
        companion = f"start: [waypoints, echo], control: true, rate_hz: 10, {shown}"
        run = fly(tmp_path / arrangement, companion, CAMERAS, settings=("duration_s=4",)).run
        assert run["error"] is None, run["error"]
        assert run["companion"]["arrangement"] == arrangement
        echo = run["companion"]["clients"]["echo"]
        assert (echo["frames"], echo["dropped"], echo["malformed"], echo["control"]) == (40, 0, 0, False)
        assert {"front/rgb", "front/depth", "rear/rgb", "imu", "truth"} <= set(echo["topics"])
        assert echo["bytes"] > 30 * 32 * 24 * (3 + 4 + 3)
        assert run["companion"]["clients"]["waypoints"]["topics"] == ["truth"]
        digests.add(run["digest"])
    assert len(digests) == 1


def test_channels_that_no_client_wants_are_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "watcher.py").write_text(
        "class Watcher:\n"
        "    topics = ('front/rgb', 'imu')\n"
        "    def __call__(self, frame):\n"
        "        assert frame['front/rgb']['rgb'].shape == (24, 32, 3) or frame.frame == 0\n"
        "        assert len(frame['imu']['gyro_radps']) == (25 if frame.frame else 1)\n"
    )
    companion = "start: ['watcher:Watcher'], rate_hz: 10"
    outcome = fly(tmp_path, companion, CAMERAS, settings=("duration_s=2",))
    run = outcome.run
    assert run["error"] is None, run["error"]
    assert run["companion"]["topics"] == ["front/rgb", "imu"]
    skipped = {s["what"] for s in run["skipped"]}
    assert {"front/depth", "rear/rgb"} <= skipped, run["skipped"]
    assert "front/rgb" not in skipped
    assert run["companion"]["clients"]["Watcher"]["frames"] == 20
    assert run["mission"] is not None  # flown by the ground station: no client has control
    # Without the client the flight is the same, and the same frames are drawn.
    again = from_trace(outcome.out, tmp_path / "again")
    assert again.run["digest"] == run["digest"]
    assert {s["what"] for s in again.run["skipped"]} == skipped


def test_realtime_flight_of_a_slow_companion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "slow.py").write_text(
        "import time\nclass Slow:\n    topics = ('truth',)\n    def __call__(self, frame):\n        time.sleep(0.15)\n"
    )
    companion = "start: ['slow:Slow'], rate_hz: 25, time: realtime"
    run = fly(tmp_path, companion, settings=("duration_s=3", "pace=1")).run
    assert run["error"] is None, run["error"]
    counts = run["companion"]["clients"]["Slow"]
    assert run["companion"]["frames"] == 75
    assert 0 < counts["frames"] <= 21
    assert counts["dropped"] >= 75 - 21 - 4
    assert saved(tmp_path / "run")["deterministic"] is True  # it only received frames
