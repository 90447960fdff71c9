"""A moment of a past run: the newest recorded frame of each stream at that time."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_bridge.codecs.companion_view import MapView, View
from hil.apps.dash.past.past_runs import PastRuns
from hil.config import load_bench, save_bench
from hil.run.companion.view_log import VIEWS_EVERY_NS, ViewLog
from hil.run.recorder.recorder import Recorder
from signals.detections import Detection, Detections
from signals.samples import RadarSample
from tests.worlds.synthetic_flight import POSE, TICK_NS, cloud, image, make_flight

POINTS = np.dtype([("x_R", "<f4"), ("y_R", "<f4"), ("z_R", "<f4"), ("speed_mps", "<f4")])


def parsed(data: bytes | None) -> tuple[dict[str, Any], dict[str, tuple[dict[str, Any], bytes]]]:
    """Return the head, and (head, payload) of each stream. Asserts that no bytes are left over."""
    assert data is not None
    length = int.from_bytes(data[:4], "little")
    head, at, frames = json.loads(data[4 : 4 + length]), 4 + length, {}
    for frame in head["frames"]:
        frames[frame["stream"]] = frame, data[at : at + frame["length"]]
        at += frame["length"]
    assert at == len(data)
    assert (4 + length) % 4 == 0
    return head, frames


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> PastRuns:
    """One run: pictures and sweeps at ticks 5 and 20, detections at 6 and 21, maps from 0.5 s on."""
    folder = tmp_path_factory.mktemp("runs")
    run = folder / "flown"
    recorder = Recorder(run, mcap=True, tlog=False, tick_ns=TICK_NS)
    for tick in make_flight(40):
        recorder.truth(tick.truth)
        k = tick.truth.tick
        if k in (5, 20):
            recorder.sample("front", image(k, channels=("rgb", "depth")))
            recorder.sample("lidar", cloud(k, 100 * k))
            table = np.array([(k, 2.0, 3.0, -1.5)], POINTS)
            recorder.sample("radar", RadarSample(k, k * TICK_NS, k * TICK_NS, *POSE, {"points": table}))
        if k in (6, 21):
            box = Detection("person", 0.9, (4.0, 3.0, 8.0, 12.0), None, float(k))
            recorder.detected(k * TICK_NS, "eyes", Detections("front/rgb", (k - 1) * TICK_NS, (16, 12), (box,)))
    recorder.close("PASS")
    (run / "run.json").write_text(json.dumps({"status": "PASS", "companion": {"clients": {"eyes": {}, "feet": {}}}}))
    cells = MapView(2, 3, 0.5, (-1.0, -2.0), zlib.compress(bytes([0, 1, 2, 3, 0, 1])))
    log = ViewLog(run)
    for n in (1, 2):
        plan = np.array([[n, 0.0], [n, 1.0]], "<f4").tobytes()
        log.take("feet", View(n, n * VIEWS_EVERY_NS, (1.0, 2.0, 3.0), 0.0, (5.0, 6.0), plan, b"", cells))
    log.close()
    save_bench(load_bench(settings=["scene=city_park", "mission=null"]), run)
    return PastRuns(folder)


ALL = ["front/rgb", "lidar/points", "radar/points", "companion/feet/map"]


def test_the_track_lists_the_streams(runs: PastRuns) -> None:
    assert runs.track("flown")["streams"] == [*["front/depth", "front/rgb", "lidar/points", "radar/points"], ALL[3]]


def test_before_the_first_frame_a_moment_is_empty(runs: PastRuns) -> None:
    head, frames = parsed(runs.moments.at("flown", 4 * TICK_NS, ALL))
    assert (frames, head["boxes"]) == ({}, {})


@pytest.mark.parametrize(("at", "newest"), [(5, 5), (19, 5), (20, 20), (39, 20)])
def test_the_newest_frame_of_a_moment_is_shown(runs: PastRuns, at: int, newest: int) -> None:
    _, frames = parsed(runs.moments.at("flown", at * TICK_NS, ALL))
    sweep, points = frames["lidar/points"]
    assert sweep["t_ns"] == newest * TICK_NS
    assert (sweep["p"], sweep["q"]) == (list(POSE[0]), list(POSE[1]))
    assert points == cloud(newest, 100 * newest).points_L.tobytes()  # fewer than are thinned
    assert frames["radar/points"][0]["records"] == [{"x_R": newest, "y_R": 2.0, "z_R": 3.0, "speed_mps": -1.5}]
    assert frames["front/rgb"][0]["as"] == "image/jpeg"
    assert frames["front/rgb"][0]["shape"] == [12, 16, 3]
    assert frames["front/rgb"][1][:2] == b"\xff\xd8"


@pytest.mark.parametrize(("at", "speed"), [(5, None), (6, 6.0), (20, 6.0), (21, 21.0)])
def test_boxes_are_the_newest_of_a_moment(runs: PastRuns, at: int, speed: float | None) -> None:
    head, _ = parsed(runs.moments.at("flown", at * TICK_NS, ["front/rgb"]))
    words = [box[-1] for box in head["boxes"].get("front/rgb", {}).get("boxes", [])]
    assert words == ([] if speed is None else [f"person 0.90, {speed:+.1f} m/s"])
    assert parsed(runs.moments.at("flown", at * TICK_NS, ["front/depth"]))[0]["boxes"] == {}  # of another picture


def test_maps_are_the_newest_of_a_moment(runs: PastRuns) -> None:
    def plan(t_ns: int) -> Any:
        _, frames = parsed(runs.moments.at("flown", t_ns, ["companion/feet/map"]))
        return frames["companion/feet/map"][0]["plan"] if frames else None

    assert plan(VIEWS_EVERY_NS - 1) is None
    assert plan(VIEWS_EVERY_NS) == [[1, 0], [1, 1]]
    assert plan(10 * VIEWS_EVERY_NS) == [[2, 0], [2, 1]]
    frame, cells = parsed(runs.moments.at("flown", VIEWS_EVERY_NS, ["companion/feet/map"]))[1]["companion/feet/map"]
    assert cells == bytes([0, 1, 2, 3, 0, 1])
    assert frame["map"] == {"rows": 2, "columns": 3, "cell_m": 0.5, "origin": [-1, -2]}


def test_people_move_between_moments(runs: PastRuns) -> None:
    assert runs.moments.triangles("flown")
    first, later = (parsed(runs.moments.at("flown", t, []))[0]["actors"] for t in (0, 10_000_000_000))
    assert len(first) > 5
    assert first != later


@pytest.mark.parametrize("name", ["nobody", "../flown", "flown/..", ""])
def test_names_cannot_leave_the_folder_of_runs(runs: PastRuns, name: str) -> None:
    assert runs.moments.at(name, 0, ["front/rgb"]) is None
    assert runs.moments.triangles(name) is None


def test_unknown_streams_are_ignored(runs: PastRuns) -> None:
    odd = [
        "",
        "/",
        "imu",
        "../../etc/passwd",
        "companion//map",
        "front/pose",
        "truth/pose",
        "\x00",
        *map(str, range(99)),
    ]
    assert parsed(runs.moments.at("flown", 20 * TICK_NS, odd))[1] == {}


def test_a_damaged_recording_shows_nothing(runs: PastRuns, tmp_path: Path) -> None:
    (tmp_path / "cut").mkdir()
    whole = (runs.folder("flown") or Path()) / "run.mcap"
    (tmp_path / "cut" / "run.mcap").write_bytes(whole.read_bytes()[:-200])
    (tmp_path / "cut" / "run.json").write_text("[]")
    assert parsed(PastRuns(tmp_path).moments.at("cut", 20 * TICK_NS, ALL))[1] == {}
