"""Per-frame timings of the companion link: sums, clocks, set-points and the file."""

from __future__ import annotations

import csv
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_bridge.companion.frames import CompanionFrame, Reply
from hil.run.companion.files import COLUMNS, read_timing
from hil.run.companion.timing import TimedPilot, TimingLog
from hil.run_files import TIMING_NAME
from signals.desired import DesiredState
from signals.errors import RecordingError

OFFSET_NS = 5_000_000_000  # client's clock minus the bench's
UP = DesiredState(v_W=(0.0, 0.0, 1.0))


def _frame(number: int) -> CompanionFrame:
    return CompanionFrame(number, 10 * number, 40_000_000 * number, ())


def _answer(log: TimingLog, number: int, *, desired: DesiredState | None, client: str = "cut") -> int:
    """Make, send and answer a frame (2 ms to the CUT, 5 ms in it, 3 ms back); return the arrival of the answer [ns]."""
    log.made(number)
    log.sending(client, _frame(number))
    frame_sent_ns = time.monotonic_ns()
    received, sent, arrived = frame_sent_ns + 2_000_000, frame_sent_ns + 7_000_000, frame_sent_ns + 10_000_000
    times = (received + OFFSET_NS, sent + OFFSET_NS, arrived, OFFSET_NS)
    log.replied(Reply(client, number, desired, False, 5_000_000, *times))
    return arrived


def _rows(out: Path) -> list[dict[str, str]]:
    with (out / TIMING_NAME).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_parts_of_a_frame_add_up_on_the_bench_s_clock(tmp_path: Path) -> None:
    begun_ns = time.perf_counter_ns() - 20_000_000
    log = TimingLog(tmp_path, begun_ns=lambda: begun_ns)
    _answer(log, 7, desired=None)
    log.close()
    (row,) = _rows(tmp_path)
    assert tuple(row) == COLUMNS
    assert (row["client"], row["frame"], row["tick"], row["t_ns"]) == ("cut", "7", "70", "280000000")
    assert int(row["render_ns"]) >= 20_000_000
    assert int(row["link_ns"]) >= 2_000_000  # plus the time between two readings of the clock
    assert int(row["t1_ns"]) == int(row["render_ns"]) + int(row["link_ns"])
    assert (row["t2_ns"], row["reply_ns"], row["command_ns"], row["t3_ns"]) == ("5000000", "3000000", "", "")
    assert int(row["clock_offset_ns"]) == OFFSET_NS
    assert log.clients["cut"].t3.count == 0


def test_a_set_point_ends_the_newest_answer_that_applies(tmp_path: Path) -> None:
    log = TimingLog(tmp_path, begun_ns=time.perf_counter_ns)
    for number, from_ns in ((0, 100), (1, 200), (2, 900)):
        _answer(log, number, desired=UP)
        log.desired("cut", number, from_ns)
    log.commanded(50)  # no answer applies yet
    log.commanded(500)  # frame 1; frame 0 is never flown
    time.sleep(0.02)  # past the time of the answer, which lies in the future here
    log.commanded(900)
    log.close()
    rows = {row["frame"]: row for row in _rows(tmp_path)}
    assert [row["frame"] for row in _rows(tmp_path)] == ["0", "1", "2"]
    assert rows["0"]["t3_ns"] == ""
    assert rows["1"]["t3_ns"] != ""
    assert int(rows["2"]["command_ns"]) > 0
    assert int(rows["2"]["t3_ns"]) == int(rows["2"]["reply_ns"]) + int(rows["2"]["command_ns"])
    assert log.clients["cut"].t3.count == 2


def test_answers_without_a_set_point_are_written_at_the_end(tmp_path: Path) -> None:
    log = TimingLog(tmp_path, begun_ns=time.perf_counter_ns)
    for number in range(300):
        _answer(log, number, desired=UP)
    assert len(log.clients["cut"].pending) < 300  # bounded, whatever happens
    log.close()
    log.close()
    assert [int(row["frame"]) for row in _rows(tmp_path)] == list(range(300))


def test_an_answer_to_a_frame_that_was_never_sent_is_ignored(tmp_path: Path) -> None:
    log = TimingLog(tmp_path, begun_ns=time.perf_counter_ns)
    log.replied(Reply("unknown", 3, None, False, 0, 0, 0, 0, 0))
    log.sending("cut", _frame(9))  # the log has no such frame
    log.replied(Reply("cut", 9, None, False, 0, 0, 0, 0, 0))
    log.close()
    assert _rows(tmp_path) == []


def test_the_pilot_s_set_points_are_noted_and_its_bytes_kept(tmp_path: Path) -> None:
    class Pilot:
        set_points = 0

        def step(self, t_ns: int, frames: object) -> bytes:
            self.set_points += t_ns == 900
            return b"%d" % t_ns

    log = TimingLog(tmp_path, begun_ns=time.perf_counter_ns)
    _answer(log, 0, desired=UP)
    log.desired("cut", 0, 0)
    pilot = TimedPilot(Pilot(), log)  # type: ignore[arg-type]
    assert pilot.step(100, ()) == b"100"
    assert log.clients["cut"].t3.count == 0
    assert pilot.step(900, ()) == b"900"
    assert log.clients["cut"].t3.count == 1


def test_the_file_is_read_back_by_client(tmp_path: Path) -> None:
    log = TimingLog(tmp_path, begun_ns=time.perf_counter_ns)
    _answer(log, 0, desired=None, client="b")
    _answer(log, 1, desired=UP, client="a")
    log.desired("a", 1, 0)
    log.commanded(0)
    log.close()
    path = tmp_path / TIMING_NAME
    whole = read_timing(path)
    assert list(whole) == ["a", "b"]
    assert whole["a"].t_s.tolist() == [0.04]
    assert whole["b"].t2_ms.tolist() == [5.0]
    assert np.isnan(whole["b"].t3_ms).all()
    assert np.isfinite(whole["a"].t3_ms).all()
    path.write_text(path.read_text()[:-8])  # killed in the middle of a row
    assert list(read_timing(path)) == ["b"]
    assert read_timing(tmp_path / "none.csv") == {}


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=f"gone/{TIMING_NAME}: cannot be written"):
        TimingLog(tmp_path / "gone", begun_ns=time.perf_counter_ns)
