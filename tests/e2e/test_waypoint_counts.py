"""Waypoints are counted alike in run.json, console, report, picture, `hil check` and dashboard."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from websockets.sync.client import connect

from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.config.missions.path import plan_points, planned_path
from hil.run.recorder.track import Track
from hil.run.report.figures import draw_path
from signals.words import counted
from tests.worlds.bench_process import Hil
from tests.worlds.patience import PATIENCE_S

BENCH = """tick_hz: 100
autopilot: {transport: loopback}
record: {mcap: false, tlog: false, report: true}
"""


def states_of(host: str) -> list[dict[str, Any]]:
    """Return the state of every update that a page gets, up to the end of the run."""
    states = []
    with connect(f"ws://{host}/live", open_timeout=PATIENCE_S) as page:
        while True:
            page.send('{"kind": "next"}')
            data = page.recv(PATIENCE_S)
            assert isinstance(data, bytes)
            update = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
            if "waypoints" in update["state"]:
                states.append(update["state"])
            if update["result"] is not None:
                return states


@pytest.mark.parametrize(
    ("settings", "end"),
    [
        ("mission: hop.waypoints\n", (1, 1)),
        pytest.param("mission: rigs/missions/rectangle.plan\nduration_s: 30\n", (1, 6), marks=pytest.mark.slow),
    ],
    ids=["pass", "fail"],
)
def test_every_place_shows_the_same_count(
    tmp_path: Path, settings: str, end: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    run = Hil(tmp_path, "run", "--dash", "--dash-port", "0", bench=BENCH + settings)
    states = states_of(run.host)
    console, errors = run.process.communicate(timeout=PATIENCE_S)
    assert run.process.returncode == (0 if end[0] == end[1] else 1), errors
    folder = tmp_path / "runs" / "latest"
    mission = json.loads((folder / "run.json").read_text())["mission"]
    assert (mission["reached"], mission["waypoints"]) == end
    text = f"{end[0]} of {end[1]}"
    in_flight = [int(n) for n in re.findall(rf"(\d+) of {end[1]} waypoints$", console, re.MULTILINE)]
    assert in_flight[0] == 0
    assert in_flight == sorted(in_flight)
    assert in_flight[-1] <= end[0]
    assert re.search(rf"^waypoints +{text}", console, re.MULTILINE)
    assert f"<td>Waypoints reached</td><td>{text}</td>" in (folder / "report.html").read_text()
    assert {state["waypoints"] for state in states} == {end[1]}
    assert states[-1]["reached"] == end[0]
    bench = load_bench(folder / "bench.yaml")
    assert bench.mission is not None
    axes = Figure().add_subplot()
    draw_path(axes, Track(bench.config.tick_ns).arrays(), plan_points(planned_path(bench.mission, bench.scene)))
    labels = [label for drawn in axes.texts for label in drawn.get_text().split(", ")]
    assert sorted(labels) == [*map(str, range(1, end[1] + 1)), "landing", "take-off"]
    assert run_command_line(["check", str(folder / "bench.yaml")]) == 0
    assert f", {counted(end[1], 'waypoint')}, " in capsys.readouterr().out.replace("\n", " ")
