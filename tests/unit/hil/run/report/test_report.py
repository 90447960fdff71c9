"""run.json, the report page and the progress display."""

from __future__ import annotations

import copy
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from hil.config.missions.path import PlanPoint
from hil.run.recorder.recorder import Event
from hil.run.recorder.track import Track, TrackArrays
from hil.run.report.page import Report, write_page
from hil.run.report.run_json import write_run_json
from hil.run.runs.progress import Progress
from signals.errors import RecordingError
from tests.worlds.run_json_schema import RUN, problems_of
from tests.worlds.synthetic_flight import TICK_NS, make_flight


@pytest.fixture(scope="module")
def track() -> TrackArrays:
    track = Track(TICK_NS)
    for tick in make_flight(300):
        track.truth(tick.truth)
        track.actuators(tick.actuators)
    return track.arrays()


def test_run_json_is_written_whole_with_finite_numbers_in_order(tmp_path: Path) -> None:
    path = tmp_path / "out" / "run.json"
    run = copy.deepcopy(RUN)
    run["mission"]["final_error_m"] = float("nan")
    run["mission"]["max_cross_track_m"] = float("inf")
    run["extra"] = {"position": (1.0, np.float64(2.0), np.int64(3))}
    write_run_json(path, run)
    read = json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in run.json"))
    assert read["mission"]["final_error_m"] is None
    assert read["mission"]["max_cross_track_m"] is None
    assert read["extra"] == {"position": [1.0, 2.0, 3]}
    assert list(read) == list(run)
    assert problems_of(read) == []
    before = path.read_bytes()
    with pytest.raises(TypeError, match="cannot hold a object"):
        write_run_json(path, {"x": object()})
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["run.json"]
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"run\.json: cannot be written"):
        write_run_json(tmp_path / "file" / "run.json", RUN)


def test_page_stands_alone_and_says_it_all(tmp_path: Path, track: TrackArrays) -> None:
    from hil.run.report import figures  # matplotlib
    from hil.run.report.pictures import flight_pictures, timing_pictures

    corners = [(0.0, 0.0, 10.0), (40.0, 0.0, 10.0), (40.0, 25.0, 10.0), (0.0, 25.0, 10.0), (0.0, 0.0, 10.0)]
    plan = [PlanPoint(p_W, str(number)) for number, p_W in enumerate(corners)]
    events = [Event(1_500_000_000, "statustext", "Ready <b>to</b> fly")]
    with figures.style():
        pictures = flight_pictures(tmp_path, track, plan, "city park")
        pictures += timing_pictures(tmp_path, [(90_000.0, 10), (120_000.0, 3)], {"physics": 20.0, "wait": 80.0})
    page = write_page(tmp_path, RUN, events, Report(pictures))
    html = page.read_text()
    assert len(re.findall("data:image/png;base64,iVBOR", html)) == 3
    assert not re.search(r"(src|href)='?\"?(https?:|//|[a-z]+\.png)", html)
    for text in ("PASS", "city_park on rig mock, seed 1", "0.31 m", "4 of 4", "landing speed", "0f" * 32):
        assert text in html
    assert "Ready &lt;b&gt;to&lt;/b&gt; fly" in html
    assert "nobody reads &lt;front/rgb&gt;" in html
    assert "<b>to</b>" not in html
    for name in ("flight.png", "motion.png", "timing.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_page_of_a_run_that_never_began(tmp_path: Path) -> None:
    from hil.run.report.pictures import flight_pictures  # matplotlib

    run = copy.deepcopy(RUN) | {
        "status": "ERROR",
        "error": {"type": "PortNotFound", "message": "/dev/ttyACM7: no such port"},
        "realtime_factor": None,
        "sensors": {},
        "skipped": [],
    }
    assert flight_pictures(tmp_path, Track(TICK_NS).arrays(), [], "") == []
    page = write_page(tmp_path, run, [], Report())
    html = page.read_text()
    assert "PortNotFound" in html
    assert "/dev/ttyACM7: no such port" in html
    assert "<img" not in html


def test_page_with_nothing_but_one_row_or_no_plan(tmp_path: Path) -> None:
    from hil.run.report.pictures import flight_pictures  # matplotlib

    track = Track(TICK_NS)
    track.truth(make_flight(1)[0].truth)
    for plan in ([], [PlanPoint((1.0, 2.0, 3.0), "1")]):
        pictures = flight_pictures(tmp_path, track.arrays(), plan, "")
        assert "<img" in write_page(tmp_path, RUN, [], Report(pictures)).read_text()
    assert (tmp_path / "flight.png").exists()


class Clock:
    """Wall time that moves only when told to."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def run_progress(stream: io.StringIO, *, ticks: int, tick_wall_s: float, quiet: bool = False) -> int:
    clock, asked = Clock(), 0

    def status() -> tuple[str, int, int]:
        nonlocal asked
        asked += 1
        return "flying", 2, 4

    with Progress(tick_ns=TICK_NS, status=status, quiet=quiet, stream=stream, clock=clock) as progress:
        for tick in range(ticks):
            clock.now_s += tick_wall_s
            progress.tick(tick)
    return asked


def test_without_a_terminal_a_line_every_ten_simulated_seconds() -> None:
    stream = io.StringIO()
    run_progress(stream, ticks=25_000, tick_wall_s=0.0002)  # 100 s at 20 times real time
    lines = stream.getvalue().splitlines()
    assert 9 <= len(lines) <= 11
    assert re.fullmatch(r"t = +\d+\.\d s  20\.0x real time  flying, 2 of 4 waypoints", lines[-1])
    assert "\x1b" not in stream.getvalue()


def test_a_terminal_is_updated_ten_times_a_second_at_most() -> None:
    stream = Terminal()
    asked = run_progress(stream, ticks=25_000, tick_wall_s=0.0002)  # 5 s of wall time
    assert 30 <= asked <= 50
    assert "2 of 4 waypoints" in stream.getvalue()


def test_quiet_is_quiet() -> None:
    stream = Terminal()
    run_progress(stream, ticks=5_000, tick_wall_s=0.001, quiet=True)
    assert stream.getvalue() == ""
