"""Replay finds a changed bit at its place."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from hil.run.recorder.mcap.mcap_file import SafeFile, VehicleTopics
from hil.run.recorder.mcap.mcap_sink import McapRecording
from hil.run.recorder.reading import Recording
from hil.run.recorder.recorder import Recorder
from hil.run.replay import _traces, compare, replay
from hil.run.report.page import Report, write_page
from signals.errors import RecordingError
from signals.samples import ImuSample
from tests.worlds.synthetic_flight import TICK_NS, Tick, fly, make_flight

TICKS = 600


@pytest.fixture(scope="module")
def flight() -> list[Tick]:
    return make_flight(TICKS)


def record(
    out: Path, flight: list[Tick], *, close: bool = True, event: str = "", tick_ns: int = TICK_NS, status: str = "PASS"
) -> Path:
    recorder = Recorder(out, mcap=True, tlog=False, tick_ns=tick_ns)
    if event:
        recorder.event(0, "note", event)
    fly(recorder, flight)
    if close:
        recorder.close(status)
    return out / "run.mcap"


@pytest.fixture(scope="module")
def recorded(flight: list[Tick], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recorded"), flight)


def with_tick(flight: list[Tick], k: int, **changes: object) -> list[Tick]:
    return [*flight[:k], flight[k]._replace(**changes), *flight[k + 1 :]]


def test_same_flight_is_identical_whatever_the_notes_say(flight: list[Tick], recorded: Path, tmp_path: Path) -> None:
    assert compare(recorded, record(tmp_path, flight)) is None
    assert compare(recorded, record(tmp_path / "noted", flight, event="took 3 s")) is None


@pytest.mark.parametrize("k", [1, 249, 250, 433, TICKS - 1])
def test_last_bit_of_one_sample_is_found(flight: list[Tick], recorded: Path, tmp_path: Path, k: int) -> None:
    (port, imu), *rest = flight[k].samples
    assert isinstance(imu, ImuSample)
    x = imu.accel_mps2[0]
    y = float(np.nextafter(x, 99.0))
    moved = imu._replace(accel_mps2=(y, *imu.accel_mps2[1:]))
    difference = compare(recorded, record(tmp_path, with_tick(flight, k, samples=[(port, moved), *rest])))
    assert difference is not None
    assert str(difference) == (
        f"first difference at tick {k} (t = {k * 0.004:.3f} s), port /imu: linear_acceleration.x {x!r} != {y!r}"
    )


def test_the_cause_is_named_before_its_effects(flight: list[Tick], recorded: Path, tmp_path: Path) -> None:
    tick = flight[300]
    changed = tick._replace(
        truth=tick.truth._replace(v_WB_W=(0.0, 0.0, 0.0)),
        samples=[],
        sent=b"",
        actuators=tick.actuators._replace(armed=False),
    )
    later = [t._replace(sent=b"") for t in flight[301:]]
    difference = compare(recorded, record(tmp_path, [*flight[:300], changed, *later]))
    assert difference is not None
    assert (difference.tick, difference.port) == (300, "/truth/velocity")


def test_mavlink_fields_are_named(flight: list[Tick], recorded: Path, tmp_path: Path) -> None:
    k = 77
    autopilot = common.MAVLink(None, srcSystem=1, srcComponent=1)
    autopilot.seq = flight[k].received[0].raw[4]
    controls = list(flight[k].actuators.controls)
    controls[2] = 0.125
    raw = autopilot.hil_actuator_controls_encode(k * 4000, controls, 129, 1).pack(autopilot)
    frame = flight[k].received[0]._replace(raw=raw)
    difference = compare(recorded, record(tmp_path, with_tick(flight, k, received=[frame])))
    assert difference is not None
    assert difference.port == "/mavlink/from_autopilot"
    assert "port /mavlink/from_autopilot: HIL_ACTUATOR_CONTROLS.controls[2] " in str(difference)
    assert difference.fresh == 0.125


def test_missing_and_additional_messages(flight: list[Tick], recorded: Path, tmp_path: Path) -> None:
    fewer = record(tmp_path / "fewer", with_tick(flight, 100, samples=flight[100].samples[:1]))
    difference = compare(recorded, fewer)
    assert difference is not None
    assert (difference.tick, difference.port) == (100, "/baro")
    assert "only in the recorded run" in str(difference)
    turned = compare(fewer, recorded)
    assert turned is not None
    assert (turned.tick, turned.port) == (100, "/baro")
    assert "only in the fresh run" in str(turned)


def test_an_earlier_end_is_a_difference_but_a_cut_is_not(flight: list[Tick], recorded: Path, tmp_path: Path) -> None:
    ended = compare(recorded, record(tmp_path / "ended", flight[:400]))
    assert ended is not None
    assert ended.tick == 400
    cut = record(tmp_path / "cut", flight, close=False)
    assert compare(cut, recorded) is None
    assert compare(recorded, cut) is None


def test_a_recording_of_several_vehicles_is_compared_up_to_the_end_of_each(
    flight: list[Tick], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The chunk of the second vehicle was missed where that of the first is the last one in the file."""
    path = tmp_path / "run.mcap"
    recording = McapRecording(SafeFile(path), tick_ns=TICK_NS, metadata={"vehicles": "a b"}, attachments={})
    recorders = [
        Recorder(tmp_path, mcap=VehicleTopics(recording.mcap, name), tlog=False, tick_ns=TICK_NS) for name in "ab"
    ]
    for tick in flight:
        for recorder in recorders:
            fly(recorder, [tick])
    for recorder in recorders:
        recorder.close("PASS")
    recording.close(TICKS, {})
    whole, ends = path.read_bytes(), []
    for tenths in range(2, 10):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[: len(whole) * tenths // 10])
        assert compare(cut, path) is None
        scanned = Recording(cut).scan()
        ends.append((scanned.whole_ns, scanned.last_ns))
    with monkeypatch.context() as patched:
        patched.setattr(Recording, "messages", lambda _: pytest.fail("the recording is decoded once for each vehicle"))
        assert (scanned.whole_ns, scanned.last_ns) == ends[-1]
        assert scanned.end_ns("/a/truth") >= scanned.end_ns("/b/truth") == scanned.whole_ns
    assert any(b_ns < a_ns for b_ns, a_ns in ends)


def test_values_equal_but_bits_not(flight: list[Tick], tmp_path: Path) -> None:
    def flown(x: float) -> list[Tick]:
        return with_tick(flight[:9], 5, truth=flight[5].truth._replace(p_WB=(x, 0.0, 0.0)))

    difference = compare(record(tmp_path / "a", flown(0.0)), record(tmp_path / "b", flown(-0.0)))
    assert difference is not None
    assert (difference.tick, difference.port, difference.field) == (5, "/truth/pose", "bytes")


def test_replay_runs_again_and_reports(flight: list[Tick], tmp_path: Path) -> None:
    record(tmp_path, flight)
    (tmp_path / "bench.yaml").write_text("seed: 1\n")
    asked = []

    def same(config: Path, out: Path) -> None:
        asked.append(config)
        record(out, flight)

    result = replay(tmp_path, same)
    assert asked == [tmp_path / "bench.yaml"]
    assert result.identical
    assert result.ticks == TICKS
    assert result.digests[0] == result.digests[1]
    assert str(result).startswith(f"identical over {TICKS} ticks, digest ")
    record(tmp_path, flight, close=False)
    cut = replay(tmp_path, same)
    assert cut.identical
    assert "ticks, up to where the recording was cut off, digest " in str(cut)
    with pytest.raises(RecordingError, match="fresh run says nothing"):  # it was called identical over 250 ticks
        replay(tmp_path, lambda _, out: record(out, flight[:300], close=False), out_dir=tmp_path / "full_disk")
    record(tmp_path, flight)
    other = replay(tmp_path, lambda _, out: record(out, with_tick(flight, 9, sent=b"")), out_dir=tmp_path / "o")
    assert not other.identical
    assert "tick 9 (t = 0.036 s), port /mavlink/to_autopilot" in str(other)


def test_a_run_that_ended_as_error_is_compared_up_to_its_last_tick(flight: list[Tick], tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text("seed: 1\n")
    record(tmp_path, [*flight[:39], flight[39]._replace(received=[])], status="ERROR")
    whole = replay(tmp_path, lambda _, out: record(out, flight))
    assert whole.identical
    assert str(whole).startswith("identical over 40 ticks, up to where the run ended as ERROR, digest ")
    other = replay(tmp_path, lambda _, out: record(out, with_tick(flight, 9, sent=b"")), out_dir=tmp_path / "other")
    assert "tick 9 (t = 0.036 s), port /mavlink/to_autopilot" in str(other)
    shorter = replay(tmp_path, lambda _, out: record(out, flight[:30]), out_dir=tmp_path / "shorter")
    assert "first difference at tick 30 " in str(shorter), "the fresh run did not end as ERROR"
    record(tmp_path, flight[:40])
    assert not replay(tmp_path, lambda _, out: record(out, flight), out_dir=tmp_path / "passed").identical
    record(tmp_path, flight)
    broken = replay(tmp_path, lambda _, out: record(out, flight[:40], status="ERROR"), out_dir=tmp_path / "broken")
    assert not broken.identical


def test_digests_that_differ_are_a_difference_of_what_is_not_recorded(flight: list[Tick], tmp_path: Path) -> None:
    """Pictures that are not recorded are in the digest alone, and so is what a damaged copy of a recording has lost."""
    (tmp_path / "bench.yaml").write_text("seed: 1\n")

    def replayed() -> tuple[bool, str]:
        result = replay(tmp_path, lambda _, out: record(out, flight))
        return result.identical, str(result)

    record(tmp_path, flight)
    digest = Recording(tmp_path / "run.mcap").scan().metadata["hil_result"]["digest"]
    run_json(tmp_path, "PASS", digest=digest)
    assert replayed() == (True, f"identical over {TICKS} ticks, digest {digest}")
    run_json(tmp_path, "PASS", digest="another")
    identical, said = replayed()
    assert not identical
    assert f"messages are the same over {TICKS} ticks, the digests are not: another != {digest}" in said
    file = tmp_path / "run.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    identical, said = replayed()
    assert not identical, "half of the recording is gone, and the digest of the run is not that of the fresh one"
    assert "up to where the recording was cut off, the digests are not: another !=" in said
    run_json(tmp_path, "PASS", digest=digest)
    identical, said = replayed()
    assert identical
    assert said.endswith(f"up to where the recording was cut off, digest {digest}, that of the whole run")
    run_json(tmp_path, "ERROR", digest="of what was flown", error={"type": "Killed", "message": ""})
    assert replayed()[0], "a killed run has no digest of the whole"


def run_json(folder: Path, status: str, *reasons: str, **more: object) -> None:
    run = {"status": status, "error": None, "verdict": {"reasons": list(reasons), "rows": []}, **more}
    (folder / "run.json").write_text(json.dumps(run))


def test_the_verdict_of_the_recorded_run_is_carried_into_the_replay(flight: list[Tick], tmp_path: Path) -> None:
    record(tmp_path, flight[:50])
    (tmp_path / "bench.yaml").write_text("seed: 1\n")

    def passes(_config: Path, out: Path) -> None:
        record(out, flight[:50])
        run_json(out, "PASS")

    def replayed(run: Callable[[Path, Path], None] = passes) -> tuple[str, dict[str, Any]]:
        said = str(replay(tmp_path, run))
        return said, json.loads((tmp_path / "replay" / "run.json").read_text())

    run_json(tmp_path, "FAIL", "an observer was lost")
    said, fresh = replayed()
    assert said.endswith("\nthe run that was replayed: FAIL (an observer was lost)")
    assert fresh["status"] == "FAIL"
    assert fresh["verdict"]["reasons"] == ["in the run that this one replays, and not repeated: an observer was lost"]
    assert fresh["replays"] == {"status": "FAIL", "error": None, "reasons": ["an observer was lost"]}
    run_json(tmp_path, "ERROR", error={"type": "DiskFull", "message": "no space"})
    said, fresh = replayed()
    assert said.endswith("\nthe run that was replayed: ERROR (DiskFull: no space)")
    assert (fresh["status"], fresh["replays"]["error"]["type"]) == ("FAIL", "DiskFull")
    assert fresh["verdict"]["reasons"] == ["the run that this one replays ended as ERROR: DiskFull: no space"]
    run_json(tmp_path, "PASS")
    said, fresh = replayed()
    assert "the run that was replayed" not in said
    assert (fresh["status"], fresh["replays"]["status"]) == ("PASS", "PASS")

    def differs(_config: Path, out: Path) -> None:
        record(out, with_tick(flight[:50], 9, sent=b""))
        run_json(out, "PASS")

    run_json(tmp_path, "FAIL", "it was too far left")
    said, fresh = replayed(differs)
    assert "first difference at tick 9 " in said
    assert fresh["status"] == "PASS"  # another flight, with a verdict of its own
    run_json(tmp_path, "ERROR", error={"type": "LockstepLost", "message": "no answer"})
    said, fresh = replayed(differs)
    assert fresh["status"] == "FAIL", "it may differ only because it flew on where the link was lost"


def test_the_page_of_a_replay_says_what_its_run_json_says(flight: list[Tick], tmp_path: Path) -> None:
    record(tmp_path, flight[:50])
    (tmp_path / "bench.yaml").write_text("seed: 1\n")
    run_json(tmp_path, "ERROR", error={"type": "LockstepLost", "message": "no answer <5 s>"})

    def passes(_config: Path, out: Path) -> None:
        record(out, flight[:50])
        run_json(out, "PASS")
        write_page(out, json.loads((out / "run.json").read_text()), [], Report())

    replay(tmp_path, passes)
    page = (tmp_path / "replay" / "report.html").read_text()
    assert "PASS" not in page
    assert '<header class="fail"><b>FAIL</b>' in page
    assert "ended as ERROR: LockstepLost: no answer &lt;5 s&gt;" in page


def test_replay_names_the_reason_if_it_is_impossible(flight: list[Tick], tmp_path: Path) -> None:
    def nothing(config: Path, out: Path) -> None:
        pass

    with pytest.raises(RecordingError, match=r"it has no run\.mcap \(was record\.mcap off"):
        replay(tmp_path, nothing)
    record(tmp_path, flight[:10])
    with pytest.raises(RecordingError, match=r"it has no bench\.yaml \(its resolved configuration\)"):
        replay(tmp_path, nothing)
    (tmp_path / "bench.yaml").write_text("seed: 1\n")
    with pytest.raises(RecordingError, match=r"left no run\.mcap"):
        replay(tmp_path, nothing)
    (tmp_path / "run.json").write_text(json.dumps({"deterministic": False, "rig": "mock_hitl"}))
    with pytest.raises(RecordingError, match=r"on rig mock_hitl does not repeat bit for bit"):
        replay(tmp_path, nothing)
    (tmp_path / "run.json").write_text(json.dumps({"deterministic": False, "rig": "mock"}))  # such as one with signing
    with pytest.raises(RecordingError, match=r"on rig mock does not .* signing, .* needs a lockstep run without these"):
        replay(tmp_path, nothing)
    other_tick = record(tmp_path / "other", flight[:10], tick_ns=2 * TICK_NS)
    with pytest.raises(RecordingError, match="ticks every"):
        compare(tmp_path / "run.mcap", other_tick)


def test_traces_are_those_of_the_vehicles_of_the_run(tmp_path: Path) -> None:
    """The folder may also hold an earlier run's vehicles, and replays."""
    Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS, metadata={"vehicles": "a b"}).close("PASS")
    for name in ("a", "earlier", "again"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "companion.jsonl").touch()
        (tmp_path / name / "bench.yaml").touch()
    assert _traces(tmp_path) == [f"vehicles.a.companion.trace={tmp_path / 'a' / 'companion.jsonl'}"]
