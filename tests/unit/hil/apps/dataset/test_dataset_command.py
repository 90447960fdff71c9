"""`hil dataset` from end to end on a small scale: the tree is reproducible, and its contents are right."""

from __future__ import annotations

import errno
import gc
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rich.console import Console

from hil.apps.dataset.command import NO_OBJECTS, run_dataset
from hil.apps.dataset.engines import local
from hil.apps.dataset.engines.jobs import Job, JobResult
from hil.apps.dataset.engines.local import LocalWorkers
from hil.apps.dataset.formats.datasheet import LIMITS
from hil.apps.dataset.formats.radar_labels import read_radar_labels
from hil.apps.dataset.make import MakeOptions, make_dataset
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from hil.apps.dataset.storage import tree as tree_module
from hil.apps.dataset.storage.tables import Checkpoints
from hil.cli.app import run_command_line
from hil.run.recorder.mcap.cdr import decode
from hil.run.sensors.frame_stages import make_frames
from signals.errors import ConfigError, RecordingError
from signals.samples import TruthState
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from tests.worlds.patience import PATIENCE_S
from tests.worlds.small_dataset import BENCH, Crash, Inline, inline, journal_of, tiny_plan, tree_of

FRAMES = 23  # two whole batches and a part
EMPTY_JOURNAL_BYTES = 20_000  # more than the write-ahead log of an empty journal


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> DatasetPlan:
    return tiny_plan(tmp_path_factory.mktemp("bench"), frames=FRAMES)


@pytest.fixture(scope="module")
def whole(plan: DatasetPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole") / "set"
    result = make_dataset(plan, root, inline())
    assert result.frames == FRAMES
    return root


def table(path: Path) -> list[list[str]]:
    head, *rows = path.read_text().splitlines()
    assert head.startswith("#timestamp")
    return [row.split(",") for row in rows]


# The same tree by any number of workers and after any interruption.


def test_two_processes_make_the_same_tree(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    make_dataset(plan, tmp_path / "set", MakeOptions(workers=2, quiet=True))
    assert tree_of(tmp_path / "set") == tree_of(whole)


@pytest.mark.parametrize("crash_at", [1, *(pytest.param(at, marks=pytest.mark.slow) for at in (0, 2))])
def test_a_crashed_data_set_can_be_resumed(plan: DatasetPlan, whole: Path, tmp_path: Path, crash_at: int) -> None:
    root = tmp_path / "set"
    with pytest.raises(Crash):
        make_dataset(plan, root, replace(inline(), make_workers=partial(Inline, crash_at=crash_at)))
    assert json.loads((root / "dataset.json").read_text())["complete"] is False
    named = [row[1] for row in table(root / "mav0/cam0/data.csv")]
    assert all((root / "mav0/cam0/data" / name).is_file() for name in named)
    result = make_dataset(plan, root, inline(resume=True))
    assert result.kept_batches <= crash_at
    assert tree_of(root) == tree_of(whole)


def test_damage_is_found_and_repaired(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    root = tmp_path / "set"
    subprocess.run(["cp", "-a", str(whole), str(root)], check=True)
    pictures = sorted((root / "mav0/cam0/data").iterdir())
    pictures[1].unlink()
    pictures[12].write_bytes(pictures[12].read_bytes()[:-1])  # cut off
    records = journal_of(root)
    with open(root / "run.mcap", "r+b") as file:  # in the middle of the last chunk
        file.seek(records[2][1] + records[2][0].chunk.size // 2)
        file.write(b"\xff\x00\xff")
    assert make_dataset(plan, root, inline(resume=True)).kept_batches == 0
    assert tree_of(root) == tree_of(whole)
    assert make_dataset(plan, root, inline(resume=True)).kept_batches == 3
    assert tree_of(root) == tree_of(whole)


def test_a_data_set_is_extended_by_more_frames(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    root = tmp_path / "set"
    make_dataset(replace(plan, frames=12), root, inline())
    assert make_dataset(plan, root, inline(resume=True)).kept_batches == 1
    assert tree_of(root) == tree_of(whole)


@pytest.mark.slow
def test_kill_and_resume(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    root, bench = tmp_path / "set", tmp_path / "tiny.yaml"
    wal = root / "journal.sqlite3-wal"
    bench.write_text(BENCH)
    arguments = [str(bench), "--frames", str(FRAMES), "--workers", "2", "--out", str(root), "-q"]
    process = subprocess.Popen([sys.executable, "-m", "hil.cli", "dataset", *arguments])
    limit_s = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < limit_s:
        if wal.is_file() and wal.stat().st_size > EMPTY_JOURNAL_BYTES:
            break
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    for _ in range(200):  # the kernel ends the workers with their parent
        try:
            make_dataset(plan, root, inline(resume=True))
            break
        except RecordingError:  # still held by a worker
            time.sleep(0.02)
    assert tree_of(root) == tree_of(whole)


def test_a_full_disk_is_reported(
    plan: DatasetPlan, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "set"
    opened = 0

    def full(path: str, mode: str, **more: Any) -> Any:
        nonlocal opened
        opened += 1
        file = open(path, mode, **more)  # noqa: SIM115
        if opened < 180:
            return file
        file.write(b"half of it")
        file.close()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(tree_module, "open", full, raising=False)
        with pytest.raises(RecordingError, match=r"No space left on device.*--resume"):
            make_dataset(plan, root, inline())
    assert not list(root.rglob("*.part"))[1:]  # but the recording's
    make_dataset(plan, root, inline(resume=True))
    assert tree_of(root) == tree_of(whole)


def test_a_disk_that_fails_to_sync_is_reported(plan: DatasetPlan, tmp_path: Path) -> None:
    def broken(folder: Path) -> None:
        raise RecordingError(f"{folder}: the disk is gone")

    options = replace(inline(), make_checkpoints=partial(Checkpoints, period_s=0.0, sync=broken))
    with pytest.raises(RecordingError, match="the disk is gone"):
        make_dataset(replace(plan, frames=11), tmp_path / "set", options)


def test_without_shared_memory_a_data_set_can_be_resumed(
    plan: DatasetPlan, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A read-only /dev/shm has no place for the pool's semaphores."""

    def refused(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    gc.unfreeze()  # what tests/conftest.py has frozen
    with monkeypatch.context() as patch:
        patch.setattr(local, "ProcessPoolExecutor", refused)
        with pytest.raises(RecordingError, match=r"cannot be started \(Read-only file system\).*/dev/shm"):
            make_dataset(plan, tmp_path / "set", MakeOptions(workers=2, quiet=True))
    assert gc.get_freeze_count() == 0, "nothing is kept from being freed at exit"
    make_dataset(plan, tmp_path / "set", inline(resume=True))
    assert tree_of(tmp_path / "set") == tree_of(whole)


class KilledWorker:
    """A worker that is killed in its second batch."""

    def __call__(self, job: Job) -> JobResult:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


def test_a_killed_worker_is_reported(plan: DatasetPlan, tmp_path: Path) -> None:
    options = MakeOptions(workers=2, quiet=True, make_workers=lambda count, _: LocalWorkers(count, KilledWorker))
    with pytest.raises(RecordingError, match=r"SIGKILL.*memory.*--resume"):
        make_dataset(replace(plan, frames=11), tmp_path / "set", options)


def test_two_commands_at_a_time_are_refused(plan: DatasetPlan, tmp_path: Path) -> None:
    root = tmp_path / "set"

    class Second(Inline):
        def submit(self, job: Job) -> None:
            with pytest.raises(RecordingError, match="another `hil dataset`"):
                make_dataset(plan, root, inline(resume=True))
            raise Crash

    with pytest.raises(Crash):
        make_dataset(plan, root, replace(inline(), make_workers=Second))


# Contents.


def test_times_rise_and_fit_together(whole: Path) -> None:
    times = {folder.parent.name: [int(row[0]) for row in table(folder)] for folder in whole.glob("mav0/*/data.csv")}
    truth = times["state_groundtruth_estimate0"]
    assert set(times) >= {"cam0", "depth0", "normal0", "lidar0", "radar0", "range_doppler0", "imu0", "gps0"}
    for name, column in times.items():
        assert all(a < b for a, b in pairwise(column)), name
        assert all(len(str(t_ns)) == 19 for t_ns in column)
        assert set(column) <= set(truth), name
        assert truth[0] <= column[0]
        assert column[-1] <= truth[-1]
    assert times["imu0"] == truth
    assert len(times["cam0"]) == FRAMES
    assert times["cam0"] == times["radar0"] == times["range_doppler0"] == times["depth0"]
    assert set(times["lidar0"]) <= set(times["cam0"])
    assert len(times["lidar0"]) == (FRAMES + 1) // 2
    assert np.diff(truth).tolist() == [10_000_000] * (len(truth) - 1)


def test_the_sky_of_a_gps_has_a_table(tmp_path: Path) -> None:
    """With rain and a radar with bounces besides, which has no ghost in the first frames."""
    settings = ("sensors.gps.sky={}", "sensors.radar.bounces={}", "weather.rain_mm_per_h=20")
    make_dataset(tiny_plan(tmp_path / "bench", frames=4, settings=settings), tmp_path / "set", inline())
    head = (tmp_path / "set/mav0/sky0/data.csv").read_text().splitlines()[0]
    sky, gps = (table(tmp_path / f"set/mav0/{folder}/data.csv") for folder in ("sky0", "gps0"))
    used, spoofed = (head.split(",").index(f"{name} []") for name in ("used", "spoofed"))
    assert [(row[0], row[used], row[spoofed]) for row in sky] == [(row[0], row[-1], "0") for row in gps]
    assert {len(row) for row in sky} == {len(head.split(","))}
    assert "mav0/sky0/data.csv" in (tmp_path / "set/checksums.csv").read_text()


def test_every_file_in_a_table_is_there_and_no_other(whole: Path) -> None:
    for path in whole.glob("mav0/*/data"):
        assert [row[1] for row in table(path.parent / "data.csv")] == sorted(os.listdir(path)), path


def test_checksums_are_right(whole: Path) -> None:
    rows = (whole / "checksums.csv").read_text().splitlines()[1:]
    listed = {name: (int(size), int(crc, 16)) for name, size, crc in (row.split(",") for row in rows)}
    there = tree_of(whole)
    assert {name for name, what in there.items() if not isinstance(what, str)} == {
        *listed, "run.mcap", "checksums.csv", "dataset.json"
    }  # fmt: skip
    assert all(there[name] == values for name, values in listed.items())


def test_pictures_are_what_the_sensor_sees_from_the_ground_truth(plan: DatasetPlan, whole: Path) -> None:
    config = plan.config
    sensor = config.sensors["front"]
    path = whole / "mav0/state_groundtruth_estimate0/data.csv"
    rows = {int(row[0]): [float(x) for x in row[1:]] for row in table(path)}
    camera = make_sensor(
        Installation(
            "front",
            rate_hz=20,
            seed=config.seed,
            scene=plan.bench.scene,
            step_ns=config.tick_ns,
            frames=make_frames(plan.bench),
        ),
        kind="camera",
        overrides=sensor.parameters.model_dump(),
    )
    zero = (0.0, 0.0, 0.0)
    for row in table(whole / "mav0/cam0/data.csv")[::5]:
        t_ns = int(row[0])
        v = rows[t_ns]
        truth = TruthState(
            0, t_ns - EPOCH_NS, (v[0], v[1], v[2]), (v[3], v[4], v[5], v[6]), zero, zero, zero, zero, (), False
        )
        seen = camera.sample(truth, 0).channels  # type: ignore[union-attr]
        rgb = cv2.imread(str(whole / f"mav0/cam0/data/{row[1]}"))[:, :, ::-1]
        instance = cv2.imread(str(whole / f"mav0/instance0/data/{row[1]}"), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(whole / f"mav0/depth0/data/{row[1]}"), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(rgb, seen["rgb"])
        assert np.array_equal(instance, seen["instance"])
        near = (seen["depth"] < 65.0) & (depth > 0)
        assert np.abs(depth[near] * 0.001 - seen["depth"][near]).max() <= 0.00051


def test_voc_lists_and_links(whole: Path) -> None:
    sets = {path.stem: path.read_text().split() for path in (whole / "ImageSets/Main").iterdir()}
    assert set(sets) == {"train", "val", "test", "trainval"}
    stems = [*sets["train"], *sets["val"], *sets["test"]]
    assert len(stems) == len(set(stems)) == FRAMES  # too few for guards
    for stem in stems:
        assert (whole / f"JPEGImages/{stem}.png").is_file()
        assert (whole / f"Annotations/{stem}.xml").is_file()
        assert (whole / f"SegmentationClass/{stem}.png").read_bytes()[25] == 3  # a palette
    assert not os.path.isabs(os.readlink(whole / "JPEGImages"))


def test_coco_holds_what_voc_holds(whole: Path) -> None:
    everything = json.loads((whole / "annotations/instances_all.json").read_text())
    assert len(everything["images"]) == FRAMES
    voc = sum(path.read_text().count("<object>") for path in (whole / "Annotations").iterdir())
    assert len(everything["annotations"]) == voc
    assert all((whole / image["file_name"]).is_file() for image in everything["images"])
    parts = [json.loads((whole / f"annotations/instances_{s}.json").read_text()) for s in ("train", "val", "test")]
    assert sum(len(part["images"]) for part in parts) == FRAMES


def test_recording_is_read_by_its_own_library(plan: DatasetPlan, whole: Path) -> None:
    counts: dict[str, int] = {}
    with open(whole / "run.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        before = 0
        for _, channel, message in reader.iter_messages():
            assert message.log_time >= before
            before = message.log_time
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic == "/front/rgb":
                values = decode("sensor_msgs/CompressedImage", message.data)
                stamp = values["header.stamp.sec"] * 1_000_000_000 + values["header.stamp.nanosec"]
                assert values["data"] == (whole / f"mav0/cam0/data/{stamp}.png").read_bytes()
                assert values["format"] == "png"
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == sum(counts.values())
    sensors = json.loads((whole / "dataset.json").read_text())["samples"]
    for topic, sensor in {"/front/rgb": "front", "/lidar": "lidar", "/radar/raw": "radar", "/imu": "imu0"}.items():
        assert counts[topic] == sensors[sensor], topic
    assert counts["/truth/pose"] == sensors["state_groundtruth_estimate0"]
    assert counts["/tf_static"] == 3


def test_datasheet_mentions_few_frames(whole: Path) -> None:
    page = (whole / "index.html").read_text()
    assert "With only 23 frames" in page
    assert all(text.split(":")[0] in page for text in LIMITS)
    assert page.count("<figure>") == 8
    manifest = json.loads((whole / "dataset.json").read_text())
    assert manifest["complete"] is True
    assert sum(manifest["split"].values()) == FRAMES
    rows = (whole / "checksums.csv").read_bytes()
    assert manifest["files"] == rows.count(b"\n") - 1
    assert crc32(rows)
    assert manifest["checksums_sha256"] == hashlib.sha256(rows).hexdigest()
    assert not (whole / ".work").exists()


def test_lidar_and_radar_read_back(whole: Path) -> None:
    for row in table(whole / "mav0/lidar0/data.csv"):
        points = np.fromfile(whole / f"mav0/lidar0/data/{row[1]}", "<f4").reshape(-1, 4)
        labels = np.fromfile(whole / f"mav0/lidar0/labels/{row[0]}.label", "<u4")
        assert len(points) == len(labels) > 1000
        assert np.isfinite(points).all()
    for row in table(whole / "mav0/radar0/data.csv"):
        raw = np.load(whole / f"mav0/radar0/data/{row[1]}")
        power = np.load(whole / f"mav0/range_doppler0/data/{row[1]}")
        assert (raw.dtype, raw.shape) == (np.dtype("<u2"), (3, 64, 64))
        assert (power.dtype, power.shape) == (np.dtype("<f4"), (64, 32))
        labels = read_radar_labels((whole / f"mav0/radar0/labels/{row[0]}.csv").read_bytes())
        visible = cv2.imread(str(whole / f"mav0/instance0/data/{row[0]}.png"), cv2.IMREAD_UNCHANGED)
        assert {o.instance for _, o in labels} <= set(np.unique(visible).tolist())
        assert all(0.0 < o.nearest_m <= o.range_m < 12.0 for _, o in labels)
    assert (whole / "preview/radar-map.png").is_file()


def test_readers_of_other_libraries(whole: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed")
    coco = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
    trajectory = evo.read_euroc_csv_trajectory(str(whole / "mav0/state_groundtruth_estimate0/data.csv"))
    assert trajectory.check()[0]
    loaded = coco.COCO(str(whole / "annotations/instances_all.json"))
    for annotation in loaded.loadAnns(loaded.getAnnIds())[::7]:
        image = loaded.loadImgs(annotation["image_id"])[0]["file_name"]
        instance = cv2.imread(str(whole / f"mav0/instance0/data/{Path(image).name}"), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(loaded.annToMask(annotation) > 0, instance == annotation["instance_id"])


# Refusals.


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "0"], "must be 1 to"),
        (["--quality", "lo"], "is unknown: 'lo'"),
        (["--workers", "0"], "--workers: must be 1"),
        (["--resume"], "needs --out"),
        (["hil.yaml"], "has no camera, LiDAR or radar"),
        (["nowhere.yaml"], "nowhere.yaml"),
        (["--set", "dataset.trajectory.side_m=-3"], "dataset.trajectory.side_m"),
        (["--set", "dataset.trajectory=null"], "flies nothing"),
        (["--set", "sensors.front.exposure.auto=true"], "automatic exposure"),
        (["--set", "rig=mock_hitl", "--set", "autopilot.transport=pty"], "free-running"),
    ],
)
def test_refusals_are_one_line_and_status_2(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if "--resume" in arguments else ["--out", str(tmp_path / "set")]
    assert run_command_line(["dataset", *arguments, *out]) == 2
    text = capsys.readouterr().err
    assert message in text
    assert "Traceback" not in text
    assert not (tmp_path / "set").exists()


def test_a_folder_that_is_not_empty_is_refused(plan: DatasetPlan, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    with pytest.raises(ConfigError, match="not an empty folder"):
        make_dataset(plan, tmp_path, inline())
    with pytest.raises(ConfigError, match="holds no data set"):
        make_dataset(plan, tmp_path, inline(resume=True))
    assert os.listdir(tmp_path) == ["mine.txt"]


def test_another_data_set_cannot_be_resumed(whole: Path, tmp_path: Path) -> None:
    settings = ("seed=6", "sensors.gps.rate_hz=5", "dataset.formats=[boxes]")
    other = tiny_plan(tmp_path, frames=FRAMES - 1, settings=settings)
    before = tree_of(whole)
    with pytest.raises(ConfigError) as caught:
        make_dataset(other, whole, inline(resume=True))
    text = str(caught.value)
    assert "another seed: 5, now 6" in text
    assert "sensors.gps.rate_hz (10.0, now 5.0)" in text
    assert "has 23 frames, more than the 22 wanted now" in text
    remedy = "(continue it with the files and options it was made with, or name another folder with --out)"
    assert f"another dataset.formats ([], now ['boxes']) {remedy}" in text
    assert all(problem.hint for problem in caught.value.problems)
    assert tree_of(whole) == before


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sensors.front.mount_rpy_deg=[0,0,0]", "labelled objects"),
        ("sensors.front.mount_rpy_deg=[0,-90,0]", NO_OBJECTS),
        ("sensors.front.channels=[rgb]", "frames in"),
    ],
)
def test_pictures_without_any_object_are_told(setting: str, words: str, tmp_path: Path) -> None:
    text = StringIO()
    plan = tiny_plan(tmp_path, frames=2, settings=(setting,))
    result = run_dataset(Console(file=text, width=300), tmp_path / "set", inline(), lambda _: plan)
    manifest = json.loads((tmp_path / "set" / "dataset.json").read_text())
    assert (result.objects or 0) == manifest["objects"]
    assert (result.objects is None) == ("[rgb]" in setting)
    assert words in text.getvalue()
    assert ("warning" in text.getvalue()) == (words == NO_OBJECTS)
