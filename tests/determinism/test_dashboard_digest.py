"""The dashboard does not alter a run: the same digest without a page and with pages that follow, leave or flood it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil.apps.dash.part import DashboardPart
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from tests.worlds.dashboard_page import PageThread

BENCH = """
autopilot: {transport: loopback}
duration_s: 7
record: {mcap: %s, tlog: false, report: false}
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  front: {kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 10, channels: [rgb, depth]}
"""


def fly(folder: Path, page: PageThread | None = None, *, mcap: bool = True, **live: Any) -> RunResult:
    folder.mkdir(exist_ok=True)
    (folder / "b.yaml").write_text(BENCH % str(mcap).lower())
    bench = load_bench(folder / "b.yaml")
    if page is None:
        return run_bench(bench, folder / "run", quiet=True)
    watched = page.live(**live)
    try:
        return run_bench(bench, folder / "run", quiet=True, more=[DashboardPart(watched)])
    finally:
        watched.close()
        page.join()


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    result = fly(tmp_path_factory.mktemp("alone"))
    assert result.run["error"] is None, result.run["error"]
    return result


def flood(page: PageThread, state: dict[str, Any]) -> None:
    """Send every message that must not alter a run, many of them invalid."""
    n = len(page.states)
    if n == 1:
        for _ in range(3):
            page.say(kind="step")
        page.say(kind="pace", pace=40.0)
        page.say(kind="resume")
    for k in range(50):
        page.say(
            kind=("next", "nonsense", "pace", "inject", "wind")[k % 5], pace="soon", streams=[7, "front/rgb", "no/such"]
        )
        page.say(kind="sticks", held=False, axes=[1, 1, 1, 1], ask="arm")
        page.say(kind="inject", fault={"kind": "dropout", "sensor": "nobody"})


@pytest.mark.parametrize(
    ("make_page", "live"),
    [
        (lambda: PageThread(), {}),
        (lambda: PageThread(["front/rgb", "front/depth"]), {}),
        (lambda: PageThread(["front/rgb"], flood), {"paused": True}),
        (lambda: PageThread(["front/depth"], closes_after=2), {"pace": 30.0}),
    ],
    ids=["open", "two panes", "hammered", "closed on the way"],
)
def test_a_watched_run_has_the_digest_of_the_unwatched_run(
    make_page: Callable[[], PageThread], live: dict[str, Any], alone: RunResult, tmp_path: Path
) -> None:
    page = make_page()
    if live.get("paused"):
        page.say(kind="step")
    watched = fly(tmp_path, page, **live)
    assert page.states, "the page was told nothing: this test would show nothing"
    assert watched.run["digest"] == alone.run["digest"]
    assert watched.run["deterministic"] is True
    assert watched.run["error"] is None
    assert [s["skipped"] for s in watched.run["sensors"].values()] == [
        s["skipped"] for s in alone.run["sensors"].values()
    ]


def test_a_pane_makes_the_run_draw_nothing(tmp_path: Path) -> None:
    """A camera without a consumer in the run stays undrawn, even if a page asks for it."""
    page = PageThread(["front/rgb"])
    watched = fly(tmp_path, page, mcap=False)
    assert watched.run["sensors"]["front"]["samples"] == 0
    assert not any("frames" in state for state in page.states)
    assert watched.run["digest"] == fly(tmp_path / "alone", mcap=False).run["digest"]


def test_the_watched_frames_are_the_runs_own(tmp_path: Path) -> None:
    page = PageThread(["front/depth"])
    fly(tmp_path, page)
    frames = [state["frames"]["front/depth"] for state in page.states if "frames" in state]
    assert frames
    assert all(frame["shape"] == [24, 32] and len(frame["data"]) == 4 * 24 * 32 for frame in frames)


def test_a_command_that_alters_the_run_is_recorded_and_reported(alone: RunResult, tmp_path: Path) -> None:
    def gust(page: PageThread, state: dict[str, Any]) -> None:
        if len(page.states) == 2:
            page.say(kind="wind", velocity_W_mps=[3.0, 0.0, 0.0])
            page.say(kind="inject", fault={"kind": "dropout", "sensor": "gps", "for_s": 1.0})

    page = PageThread(on_state=gust)
    altered = fly(tmp_path, page, pace=8.0)
    assert altered.run["deterministic"] is False
    assert altered.run["digest"] != alone.run["digest"]
    wind, fault = altered.run["by_hand"]
    assert wind["alters"]
    assert "3, 0, 0 m/s" in wind["what"]
    # Each is a message of its own: the second may come a tick later.
    assert wind["tick"] <= fault.pop("tick") <= wind["tick"] + 25
    assert fault == {"what": "fault: gps: dropout", "alters": True}
    told = [text for state in page.states for _, _, text in state["events"]]
    assert "gps: dropout began" in told


def test_stop_ends_the_run_with_everything_recorded(tmp_path: Path) -> None:
    def stop(page: PageThread, state: dict[str, Any]) -> None:
        page.say(kind="stop")

    page = PageThread(on_state=stop)
    stopped = fly(tmp_path, page, pace=5.0)
    assert stopped.run["error"] is None  # a run without a mission ends as a success when it is stopped
    assert stopped.run["by_hand"][-1]["what"] == "stop"
    assert page.others[-1]["kind"] == "end"
    assert page.others[-1]["run"]["status"] == "PASS"
