"""The parts of `hil dataset` that need no pictures: courses, flights, batches, splits, the journal, progress."""

from __future__ import annotations

import io
import math
import sqlite3
import tempfile
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hil.apps.dataset.finish import split_of
from hil.apps.dataset.flight import FlightData, fly_for_frames
from hil.apps.dataset.formats.coco import CocoPicture
from hil.apps.dataset.formats.split import GUARD, SETS
from hil.apps.dataset.make import FrameProgress
from hil.apps.dataset.moments import Batch, Moment
from hil.apps.dataset.plan import make_plan
from hil.apps.dataset.storage.journal import BatchRecord, Journal, StoredChunk
from hil.apps.dataset.storage.tree import JOURNAL, Written
from hil.apps.dataset.trajectory import course, waypoints_text
from hil.config.missions import Geopoint, load_mission
from hil.config.schema import Trajectory
from hil.run.recorder.mcap.mcap_file import ChunkFacts
from signals.errors import ConfigError, HilError, RecordingError
from sim.scene.scene import Site
from tests.worlds.small_dataset import journal_of, tiny_plan

SITE = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)

MISSION = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.397742\t8.545594\t488\t1
1\t0\t3\t22\t0\t0\t0\t0\t47.397742\t8.545594\t2.5\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.397742\t8.545594\t2.5\t1
3\t0\t3\t16\t0\t0\t0\t0\t47.397742\t8.5456338\t2.5\t1
4\t0\t3\t21\t0\t0\t0\t0\t47.397742\t8.5456338\t0\t1
"""


@pytest.mark.parametrize("preset", ["square", "circle", "figure_eight", "survey"])
def test_courses_are_as_large_and_as_high_as_asked(preset: str, tmp_path: Path) -> None:
    trajectory = Trajectory.model_validate({"preset": preset, "side_m": 12.0, "height_m": 5.0, "speed_mps": 2.0})
    points = course(trajectory)
    assert points[0] == (0.0, 0.0)
    width = max(x for x, _ in points) - min(x for x, _ in points)
    assert width == pytest.approx(12.0, rel=0.02)
    path = tmp_path / "a.waypoints"
    path.write_text(waypoints_text(trajectory, SITE))
    mission = load_mission(path, site=Geopoint(SITE.latitude_deg, SITE.longitude_deg, SITE.altitude_m))
    assert [item.command for item in mission.items[:2]] == [22, 178]
    assert mission.items[-1].command == 177
    jump = mission.items[-1]
    assert (jump.param1, jump.param2) == (2, -1)  # back to the first waypoint, for ever
    assert mission.items[2].alt_m == 5.0
    north_m = math.radians((mission.items[4].lat_degE7 - mission.items[2].lat_degE7) / 1e7) * 6.37e6
    assert north_m == pytest.approx(points[2][1], abs=0.05)


def test_recording_begins_at_the_first_waypoint_and_in_the_air(tmp_path: Path) -> None:
    settings = ("dataset.trajectory.height_m=3",)
    plan = make_plan(None, frames=13, quality=None, seed=None, settings=settings, work=lambda: tmp_path)
    taken: list[tuple[Batch, FlightData]] = []
    fly_for_frames(plan, lambda batch, part: taken.append((batch, part)))
    assert [batch.frames for batch, _ in taken] == [10, 3]
    assert [batch.first_frame for batch, _ in taken] == [0, 10]
    moments = [moment for batch, _ in taken for moment in batch.moments]
    assert all(2.0 < moment.truth.p_WB[2] < 4.5 for moment in moments)
    frames = [moment for moment in moments if moment.frame >= 0]
    assert [moment.frame for moment in frames] == list(range(13))
    gaps = [b.truth.tick - a.truth.tick for a, b in pairwise(frames)]
    assert set(gaps) == {12, 13}  # 20 Hz on 250 Hz
    first_seq = frames[0].due[0].seq
    assert first_seq == frames[0].truth.tick * 20 // 250  # the number that `hil run` would give it
    sweeps = [due for moment in moments for due in moment.due if due.sensor == "lidar"]
    assert all(due.previous is not None for due in sweeps)
    truths = [t_ns for _, part in taken for t_ns in part.truths["t_ns"]]
    assert (truths[0], truths[-1]) == (frames[0].truth.t_ns, frames[-1].truth.t_ns)
    assert truths == list(range(truths[0], truths[-1] + 1, 4_000_000))
    gps = [t_ns for _, part in taken for t_ns in part.samples["gps"].columns["t_capture_ns"]]
    assert truths[0] <= gps[0] < gps[-1] <= truths[-1]
    assert len(gps) >= 6


def test_a_crash_ends_the_data_set_unless_it_is_wanted(tmp_path: Path) -> None:
    falls = ("dataset.trajectory.height_m=3", "faults.rotors=[{kind: stuck, rotor: 0, at_s: 17, speed_radps: 0}]")
    plan = make_plan(None, frames=200, quality=None, seed=None, settings=falls, work=lambda: tmp_path)
    with pytest.raises(HilError, match=r"crashed: .*`crash: null`"):
        fly_for_frames(plan, lambda _batch, _data: None)


def test_a_mission_with_an_end_is_flown_again(tmp_path: Path) -> None:
    (tmp_path / "short.waypoints").write_text(MISSION)
    settings = ("dataset.trajectory=null", f"mission={tmp_path}/short.waypoints", "dataset.record=trajectory")
    plan = tiny_plan(tmp_path, frames=10**6, settings=settings)
    frames: list[Moment] = []

    def until_the_second_flight(batch: Batch, part: FlightData) -> None:
        frames.extend(moment for moment in batch.moments if moment.frame >= 0)
        if frames[-1].truth.t_ns - frames[0].truth.t_ns > len(frames) * 200_000_000:
            raise _Enough
        assert set(part.truths["tick"] * 4_000_000) >= {frames[-1].truth.t_ns}  # times of the first flight

    with pytest.raises(_Enough):
        fly_for_frames(plan, until_the_second_flight)
    times = [moment.truth.t_ns for moment in frames]
    gaps = [b - a for a, b in pairwise(times)]
    assert min(gaps) > 0
    assert sum(gap > 2_000_000_000 for gap in gaps) == 1  # one landing and one take-off between
    assert sum(gap <= 52_000_000 for gap in gaps) == len(gaps) - 1
    seqs = [due.seq for moment in frames for due in moment.due if due.sensor == "front"]
    assert all(a < b for a, b in pairwise(seqs))
    assert [moment.frame for moment in frames] == list(range(len(frames)))


class _Enough(Exception):
    pass


def test_a_flight_without_frames_is_reported(tmp_path: Path) -> None:
    plan = tiny_plan(tmp_path, frames=3, settings=("dataset.record=trajectory", "duration_s=2"))
    with pytest.raises(RecordingError, match=r"gave no frame within its 2 s.*first waypoint"):
        fly_for_frames(plan, lambda _batch, _part: None)


@pytest.mark.parametrize("frames", [1, 2, 3, 10, 29, 30, 31, 100, 500, 1234])
def test_splits_are_sound_for_any_number_of_frames(frames: int) -> None:
    split = split_of(frames, 2)
    assert len(split.set_by_frame) == frames
    assert split.counts["train"] > 0
    if frames >= 3:
        assert all(split.counts[name] > 0 for name in SETS)
    if frames >= 30:
        for a, b in pairwise(split.set_by_frame):
            assert a == b or GUARD in (a, b)  # never neighbours


def record(index: int) -> BatchRecord:
    chunk = StoredChunk(9, 1, ChunkFacts(8, "", 7, 7, 5, 6, {300: 8}, {300: 1}), ((300, "/a", "sensor_msgs/Image"),))
    picture = CocoPicture(index + 1, '{"id":1}', ('{"a":"\\n"}', '{"b":2}'))
    files = (Written(f"a/{index}.png", 3, 4),)
    return BatchRecord(index, index, 1, 77, files, {"x": 1}, (5,), ({3: 2},), {3: 9}, chunk, (picture,))


@settings(max_examples=60)
@given(st.floats(0.0, 1.0, exclude_max=True), st.booleans())
@example(0.49401890155887346, False)  # in SQLite's own description of the table
def test_a_journal_cut_off_or_damaged_anywhere_yields_no_wrong_row(
    tmp_path_factory: pytest.TempPathFactory, where: float, cut: bool
) -> None:
    root = tmp_path_factory.mktemp("journal")
    path = root / JOURNAL
    whole = [(record(index), 1000 * index) for index in range(3)]
    fill(path, whole)
    assert journal_of(root) == whole
    data = path.read_bytes()
    at = int(where * len(data))
    path.write_bytes(data[:at] if cut else data[:at] + bytes([data[at] ^ 0x41]) + data[at + 1 :])
    found = journal_of(root)
    assert found == whole[: len(found)]
    fill(path, whole)
    assert journal_of(root) == whole


def test_a_row_that_was_changed_ends_the_journal(tmp_path: Path) -> None:
    fill(tmp_path / JOURNAL, [(record(index), 1000 * index) for index in range(3)])
    with sqlite3.connect(tmp_path / JOURNAL) as db:
        db.execute("UPDATE batch SET record = replace(record, '\"b\"', '\"c\"') WHERE number = 1")
    db.close()
    assert journal_of(tmp_path) == [(record(0), 0)]


def fill(path: Path, entries: list[tuple[BatchRecord, int]]) -> None:
    journal = Journal(path)
    for entry, offset in entries:
        journal.append(entry, offset)
    journal.close()


def test_progress_shows_rate_and_time_left() -> None:
    now = [0.0]
    stream = io.StringIO()
    with FrameProgress(500, quiet=False, stream=stream, clock=lambda: now[0]) as progress:
        now[0] = 3.0  # taking off
        progress.show(10)
        now[0] = 4.0
        progress.show(110)  # too early for another line
        now[0] = 9.0
        progress.show(250)
    lines = stream.getvalue().splitlines()
    assert lines == ["10 of 500 frames", "250 of 500 frames, 40.0 frames/s, 6 s left"]


def test_frames_are_those_of_the_camera_that_can_be_labelled(tmp_path: Path) -> None:
    more = (
        "sensors.first={kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 5, channels: [rgb, depth]}",
        "sensors.front.rate_hz=10",
    )
    plan = tiny_plan(tmp_path, frames=3, settings=more)
    assert (plan.reference, plan.labelled) == ("front", "front")
    assert (plan.folder("front", "rgb"), plan.folder("first", "depth")) == ("cam0", "depth1")
    plan = tiny_plan(tmp_path, frames=3, settings=(*more, "sensors.front.channels=[rgb, segmentation]"))
    assert (plan.reference, plan.labelled) == ("front", None)
    none = ("sensors.front=null", "sensors.radar=null")
    assert tiny_plan(tmp_path, frames=3, settings=none).reference == "lidar"


@pytest.mark.parametrize("setting", ["foxglove.port=0", "ros2.domain=0"])
def test_nobody_follows_the_flights_of_a_data_set(tmp_path: Path, setting: str) -> None:
    key = setting.partition("=")[0]
    with pytest.raises(ConfigError, match=rf"has {key}, and nobody can follow .*--set {key}=null"):
        tiny_plan(tmp_path, frames=3, settings=(setting,))


@pytest.mark.parametrize("quality", ["low", "high", "cinematic"])
def test_qualities_change_how_cameras_draw(quality: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        plan = make_plan(None, frames=1, quality=quality, seed=None, settings=(), work=lambda: Path(folder))
    front = plan.config.sensors["front"].parameters
    assert front.shadows is (quality != "low")
    assert front.resolution == ((640, 480) if quality == "cinematic" else (320, 240))
    assert plan.quality == quality
