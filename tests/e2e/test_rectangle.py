"""The default mission on the mock rig: flown, judged, recorded, replayed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import Recording
from tests.golden.digests import FLIGHTS
from tests.worlds.bench_process import hil
from tests.worlds.run_json_schema import problems_of

CONSOLE = "console.txt"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fly the default bench as a user does, over the pty."""
    out = tmp_path_factory.mktemp("run")
    done = hil("run", "--out", str(out))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASS" in done.stdout
    (out.parent / CONSOLE).write_text(done.stdout)
    return out


def test_the_digest_is_the_golden_one(flown: Path) -> None:
    assert json.loads((flown / "run.json").read_text())["digest"] == FLIGHTS["default"]["digest"]


def test_the_book_prints_what_the_command_prints(flown: Path) -> None:
    console = [line.rstrip() for line in (flown.parent / CONSOLE).read_text().splitlines()]
    verdict = [line for line in console[console.index("PASS") :] if not line.startswith(("speed", "results"))]
    docs = Path(__file__).resolve().parents[2] / "docs"
    assert "\n".join(verdict) in (docs / "start.md").read_text()
    cross_track_m = json.loads((flown / "run.json").read_text())["mission"]["max_cross_track_m"]
    assert f"everything recorded | cross-track {cross_track_m:.3f} m |" in (docs / "accuracy.md").read_text()


def assert_accurate(mission: dict[str, Any]) -> None:
    assert mission["max_cross_track_m"] <= 1.0
    assert mission["final_error_m"] <= 0.7
    assert mission["altitude_error_m"] <= 0.5
    assert mission["landed"] is True
    assert mission["landed_tilt_deg"] < 5.0


def test_run_json_follows_the_contract(flown: Path) -> None:
    run = json.loads((flown / "run.json").read_text())
    assert problems_of(run) == []
    assert run["status"] == "PASS"
    assert run["deterministic"] is True
    assert run["mission"]["completed"] is True
    assert run["mission"]["reached"] == run["mission"]["waypoints"] == 6
    assert_accurate(run["mission"])
    assert run["autopilot"]["steps"] == round(run["sim_s"] * 250)
    assert run["autopilot"]["link"] | {"tx_bytes": 0, "rx_bytes": 0} == {
        "tx_bytes": 0,
        "rx_bytes": 0,
        "bad_crc": 0,
        "garbage_bytes": 0,
        "lost_frames": 0,
        "bad_controls": 0,
        "unanswered": 0,
        "repeated": 0,
    }
    contact = next(s for s in run["skipped"] if s["what"] == "contact")
    assert contact["ticks_skipped"] > contact["ticks_touching"] > 0


def test_the_recording_holds_every_tick_and_every_message(flown: Path) -> None:
    run = json.loads((flown / "run.json").read_text())
    ticks = run["autopilot"]["steps"]
    counts: dict[str, int] = {}
    recording = Recording(flown / "run.mcap")
    for message in recording.messages():
        counts[message.topic] = counts.get(message.topic, 0) + 1
    assert counts["/truth/pose"] == counts["/imu"] == ticks
    assert counts["/gps"] == pytest.approx(ticks / 25, abs=3)  # the last messages were still in transit
    assert counts["/baro"] == counts["/mag"] == run["sensors"]["baro"]["samples"]
    assert counts["/mavlink/to_autopilot"] > ticks
    assert counts["/actuators"] == ticks - 20
    assert recording.complete
    assert recording.metadata["hil_result"]["digest"] == run["digest"]


def test_the_report_is_a_page_with_pictures(flown: Path) -> None:
    page = (flown / "report.html").read_text()
    assert "PASS" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert page.count("data:image/png;base64,") >= 3
    assert (flown / "flight.png").stat().st_size > 20_000


def test_replay_says_identical_and_names_the_first_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    run_bench(load_bench(settings=["duration_s=4", "record.report=false"]), out, quiet=True)
    assert run_command_line(["replay", str(out), "--out", str(tmp_path / "again")]) == 0
    assert "identical" in capsys.readouterr().out
    # Another seed gives another flight, from the first sample of a noisy sensor on.
    bench = out / "bench.yaml"
    bench.write_text(bench.read_text().replace("seed: 1\n", "seed: 2\n"))
    assert run_command_line(["replay", str(out), "--out", str(tmp_path / "other")]) == 1
    shown = capsys.readouterr().out
    assert "first difference at tick 0" in shown
    assert "port /" in shown


@pytest.mark.slow  # `flown` is one of them
@pytest.mark.parametrize("seed", range(1, 11))
def test_ten_seeds_pass(seed: int, tmp_path: Path) -> None:
    bench = load_bench(seed=seed, settings=["autopilot.transport=loopback", "record.mcap=false", "record.report=false"])
    outcome = run_bench(bench, tmp_path, quiet=True)
    assert outcome.status == "PASS", outcome.run
    assert_accurate(outcome.run["mission"])


@pytest.mark.parametrize(
    ("settings", "seed"),
    [
        (["vehicle=iris", "mission=rigs/missions/square.waypoints"], 3),
        pytest.param(["mission=rigs/missions/survey.plan", "tick_hz=100"], 5, marks=pytest.mark.slow),
        pytest.param(["tick_hz=1000", "duration_s=200"], 7, marks=pytest.mark.slow),
        (["vehicle=hexa_x", "mission=rigs/missions/square.waypoints", "tick_hz=100"], 4),
        *(
            pytest.param([f"vehicle={name}"], 4, marks=pytest.mark.slow)
            for name in ("hexa_x", "octa_x", "x8", "y6", "racer")
        ),
    ],
)
def test_other_vehicles_and_missions(settings: list[str], seed: int, tmp_path: Path) -> None:
    common = ["autopilot.transport=loopback", "record.mcap=false", "record.tlog=false", "record.report=false"]
    outcome = run_bench(load_bench(seed=seed, settings=[*common, *settings]), tmp_path, quiet=True)
    assert outcome.status == "PASS", (outcome.run["error"], outcome.run["verdict"], outcome.run["mission"])


def test_a_run_without_mission_stays_on_the_ground(tmp_path: Path) -> None:
    settings = ["autopilot.transport=loopback", "mission=null", "duration_s=8", "record.report=false"]
    outcome = run_bench(load_bench(settings=settings), tmp_path, quiet=True)
    assert outcome.status == "PASS"
    assert outcome.run["sim_s"] == 8.0
    assert outcome.run["mission"]["waypoints"] == 0
