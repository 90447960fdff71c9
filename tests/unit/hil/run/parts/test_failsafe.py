"""A failsafe that nobody declared makes a flight a FAIL; a declared one does not; one that is needed must come."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from firmware_bridge.autopilots.mock.firmware import MOCK
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.parts.links.failsafe import FailsafePart, cause_of
from hil.run.recorder.recorder import Event
from signals.errors import ConfigError

S = 1_000_000_000
Heartbeat, Text = message_class("HEARTBEAT"), message_class("STATUSTEXT")
# Up, 60 m north, down.
PLAN = """QGC WPL 110
0	1	0	16	0	0	0	0	47.39774200	8.54559400	488.0	1
1	0	3	22	0	0	0	0	47.39774200	8.54559400	4.0	1
2	0	3	16	0	0	0	0	47.39828200	8.54559400	4.0	1
3	0	3	21	0	0	0	0	47.39828200	8.54559400	0.0	1
"""
NO_GPS = """
plan: hop.waypoints
outcome: any
limits: {max_cross_track_m: null, altitude_error_m: null, final_error_m: null}
actions: [{at_s: 8, fault: {sensor: gps, kind: dropout}}]
"""


def load(folder: Path, script: str, *settings: str) -> Any:
    (folder / "hop.waypoints").write_text(PLAN)
    (folder / "flight.yaml").write_text(script)
    (folder / "bench.yaml").write_text(
        "tick_hz: 100\nautopilot: {transport: loopback}\nrecord: {mcap: false, tlog: false}"
    )
    return load_bench(folder / "bench.yaml", mission=str(folder / "flight.yaml"), settings=list(settings))


def fly(folder: Path, script: str, *settings: str) -> RunResult:
    return run_bench(load(folder, script, *settings), folder / "out", quiet=False)


def test_a_failsafe_is_a_fail_on_the_console_in_run_json_and_in_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fly(tmp_path, NO_GPS).run
    assert run["status"] == "FAIL"
    (reason,) = run["verdict"]["reasons"]
    assert reason.startswith(
        "mock: Failsafe activated: no valid position, descending at 13.0 s, mode MISSION (fault: gps"
    )
    assert f"failsafe: {reason}" in capsys.readouterr().out
    (failsafe,) = run["failsafes"]
    assert (failsafe["mode"], failsafe["expected"]) == ("MISSION", False)
    assert [row["text"] for row in run["warnings"]] == ["GPS lost"]
    page = (tmp_path / "out/report.html").read_text()
    assert reason.replace("'", "&#x27;") in page
    times = [float(row.split("<")[0]) for row in page.partition("<h2>Events</h2>")[2].split("<tr><td>")[1:]]
    assert times == sorted(times)


@pytest.mark.parametrize("declared", ["{}", "{from_s: 8, to_s: 20}", "{required: false, mode: MISSION}"])
def test_a_declared_failsafe_passes(tmp_path: Path, declared: str) -> None:
    run = fly(tmp_path, f"{NO_GPS}failsafe: {declared}\n", "record.report=false").run
    assert (run["status"], run["verdict"]["reasons"]) == ("PASS", [])
    assert run["failsafes"][0]["expected"] is True


def test_another_failsafe_than_the_declared_one_fails(tmp_path: Path) -> None:
    run = fly(tmp_path, f"{NO_GPS}failsafe: {{mode: LAND, to_s: 40}}\n", "record.report=false").run
    assert run["status"] == "FAIL"
    assert run["verdict"]["reasons"][0].startswith("mock: Failsafe activated")
    assert run["verdict"]["reasons"][-1] == "no failsafe came with mode LAND to 40 s, and the flight needs one"


def test_a_failsafe_that_is_needed_must_come(tmp_path: Path) -> None:
    script = NO_GPS.replace("{at_s: 8, fault: {sensor: gps, kind: dropout}}", "{at_s: 8, set_mode: LAND}")
    result = fly(tmp_path, f"{script}failsafe: {{}}\n", "record.report=false")
    assert result.run["verdict"]["reasons"] == ["no failsafe came, and the flight needs one"]


def test_a_flight_that_is_to_crash_may_have_failsafes() -> None:
    encoder, run = FrameEncoder(1, 1), SimpleNamespace(say=lambda *_: None, recorder=SimpleNamespace(events=[]))
    for judged, status in ((True, "FAIL"), (False, "PASS")):
        part = FailsafePart(MOCK, None, judged=judged)
        part.build(cast("Any", run))
        for message in (
            Heartbeat(2, 12, 0x81, 0, 4, 3),
            Text(2, "Failsafe activated"),
            Heartbeat(2, 12, 0x81, 0, 5, 3),
        ):
            part.step(0, FrameParser().feed(encoder.frame(message.MSGID, pack(message))))
        assert part.verdict().status == status
        assert len(part.run_keys()["failsafes"]) == 1


def test_mistakes_are_told_with_their_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"flight\.yaml:6: failsafe\.mode: no mode 'LADN' \(did you mean 'LAND'\?\)"):
        load(tmp_path, f"{NO_GPS}failsafe: {{mode: LADN}}\n")


def test_the_cause_is_the_last_fault_that_has_not_long_ended() -> None:
    events = [
        Event(10 * S, "fault", "gps: dropout began"),
        Event(15 * S, "fault", "gps: dropout ended"),
        Event(45 * S, "fault", "rotor 1: stuck at 0 rad/s"),
        Event(60 * S, "fault", "baro: drift began"),
    ]
    assert cause_of(9 * S, events) == ""
    assert cause_of(20 * S, events) == "fault: gps dropout at 10 s"
    assert cause_of(30 * S, events) == ""
    assert cause_of(50 * S, events) == "fault: rotor 1 stuck at 0 rad/s at 45 s"
