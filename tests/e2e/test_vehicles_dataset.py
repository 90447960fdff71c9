"""Data set of one vehicle of a bench with several: it sees the other as in a run of that bench, bit for bit."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.dataset.batch_maker import BatchMakerFactory
from hil.apps.dataset.make import MakeOptions, make_dataset
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan, make_plan
from hil.apps.dataset.storage.tree import TreeWriter
from hil.apps.radar.sources import open_source, pictures_at
from hil.cli.app import run_command_line
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import read_messages
from signals.errors import ConfigError, HilError, RecordingError
from tests.worlds.hop_flights import HOP
from tests.worlds.small_dataset import Crash, Inline, inline, tree_of

BENCH = """
rig: mock
tick_hz: 100
scene: city_park
mission: hop.waypoints
seed: 5
duration_s: 12
autopilot: {transport: loopback}
record: {report: false, tlog: false}
start: {yaw_deg: 90}
vehicles:
  front: {}
  rear:
    limits: {max_cross_track_m: null}
    sensors:
      imu:    {preset: icm20689}
      gps:    {preset: here_plus, rate_hz: 10}
      baro:   {preset: ms5611, rate_hz: 50}
      mag:    {preset: ist8310, rate_hz: 50}
      camera: {kind: camera, resolution: [96, 64], fov_deg: 60, rate_hz: 10, mount_m: [0.1, 0, 0.05],
               channels: [rgb, depth, segmentation, instance]}
      lidar:  {preset: vlp16, rate_hz: 5, subsweeps: 3}
      radar:  {preset: bgt60tr13c, frame: camera, rate_hz: 10, outputs: [raw]}
formation: {shape: column, spacing_m: 3, heading_deg: 90}
"""
FRAMES = 13  # a whole batch and a part


def plan_of(folder: Path, *, frames: int = FRAMES, vehicle: str | None = "rear", text: str = BENCH) -> DatasetPlan:
    (folder / "hop.waypoints").write_text(HOP)
    (folder / "bench.yaml").write_text(text)
    file = folder / "bench.yaml"
    return make_plan(file, vehicle=vehicle, frames=frames, quality=None, seed=None, settings=(), work=lambda: folder)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> DatasetPlan:
    return plan_of(tmp_path_factory.mktemp("pair"))


@pytest.fixture(scope="module")
def whole(plan: DatasetPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole") / "set"
    make_dataset(plan, root, inline())
    return root


@pytest.fixture(scope="module")
def run(plan: DatasetPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    run_bench(load_bench(plan.bench.files["mission"].parent / "bench.yaml"), out, quiet=True)
    return out


def samples(recording: Path, prefix: str, shift_ns: int) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the decoded messages of the cameras, LiDARs and radars by topic and time of capture."""
    found = {}
    for message in read_messages(recording):
        topic = message.topic.removeprefix(prefix)
        if message.topic.startswith(prefix) and topic.split("/")[1] in ("camera", "lidar", "radar"):
            data = message.decode()
            t_ns = data["header.stamp.sec"] * 10**9 + data["header.stamp.nanosec"]
            found[topic, t_ns + shift_ns] = {key: value for key, value in data.items() if not key.startswith("header.")}
    return found


def pixels(message: dict[str, Any], like: NDArray[Any]) -> NDArray[Any]:
    """Return the pixels of an Image in the form of the PNG `like`; depth [m] in steps of 1 mm."""
    kinds = {"32FC1": "<f4", "16UC1": "<u2", "mono16": "<u2"}
    array = np.frombuffer(message["data"], kinds.get(message["encoding"], "u1")).reshape(like.shape)
    if message["encoding"] != "32FC1":
        return array
    return np.where(np.isfinite(array), np.clip(np.rint(array * 1000.0), 0, 65535), 0).astype(np.uint16)


def test_every_sample_is_that_of_a_run(whole: Path, run: Path) -> None:
    made, flown = samples(whole / "run.mcap", "", -EPOCH_NS), samples(run / "run.mcap", "/rear", 0)
    topics = {topic for topic, _ in made}
    assert {"/camera/rgb", "/camera/depth", "/camera/instance", "/lidar", "/radar/raw"} <= topics
    for key, message in made.items():
        if "format" not in message:
            assert message == flown[key], key
            continue
        png = cv2.imdecode(np.frombuffer(bytes(message["data"]), np.uint8), cv2.IMREAD_UNCHANGED)
        assert png is not None
        picture = png[:, :, ::-1] if png.ndim == 3 else png
        recorded = pixels(flown[key], picture)
        if key[0] == "/camera/depth":
            assert np.abs(recorded.astype(int) - picture)[(recorded > 0) & (recorded < 65535)].max() <= 1
        else:
            assert (recorded == picture).all(), key


def test_the_other_vehicle_is_an_object_with_its_own_instance(whole: Path) -> None:
    manifest = json.loads((whole / "dataset.json").read_text())
    assert manifest["made_from"]["vehicle"] == "rear"
    (instance,) = manifest["other_vehicles"].values()
    coco = json.loads((whole / "annotations/instances_all.json").read_text())
    (drone,) = (category["id"] for category in coco["categories"] if category["name"] == "drone")
    boxes = [row for row in coco["annotations"] if row["category_id"] == drone]
    assert len(boxes) == FRAMES  # one in each picture, and never the vehicle itself
    assert {row["instance_id"] for row in boxes} == {instance}
    assert min(row["area"] for row in boxes) >= 10
    labels = [np.fromfile(path, "<u4") & 0xFFFF for path in (whole / "mav0/lidar0/labels").iterdir()]
    assert sum(int((sweep == drone).sum()) for sweep in labels) > 20
    tables = [path.read_text() for path in (whole / "mav0/radar0/labels").iterdir()]
    assert all(f"{instance},{drone},drone," in text for text in tables)
    pose = next(message for message in read_messages(whole / "run.mcap") if message.topic == "/front/truth/pose")
    ours, theirs = (
        (whole / f"mav0/state_groundtruth_{name}/data.csv").read_text().splitlines()[1].split(",")
        for name in ("estimate0", "front")
    )
    assert ours[0] == theirs[0] == str(pose.log_time_ns)
    assert float(theirs[2]) == pose.decode()["pose.position.y"] == pytest.approx(float(ours[2]) + 3.0, abs=0.3)
    assert "Recorded by the vehicle rear" in (whole / "index.html").read_text()


def test_hil_radar_reads_its_recording(whole: Path) -> None:
    source = open_source(whole, preset=None, texts=())
    assert source.count == FRAMES
    t_ns = next(source.frames).t_ns
    bgr = cv2.imread(str(whole / f"mav0/cam0/data/{t_ns}.png"))
    assert bgr is not None
    assert (pictures_at(source, {t_ns})[t_ns] == bgr[:, :, ::-1]).all()


def test_two_workers_and_spawned_ones_make_the_same_tree(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    make_dataset(plan, tmp_path / "set", MakeOptions(workers=2, quiet=True))
    assert tree_of(tmp_path / "set") == tree_of(whole)
    factory = BatchMakerFactory(None, plan.frames, plan.quality, TreeWriter(whole), vehicle="rear")
    loaded = factory().plan  # as in a process that is not forked
    assert loaded.config == load_bench(whole / "bench.yaml", flown=False).vehicles["rear"].config
    assert (loaded.vehicle, set(loaded.other_vehicles)) == ("rear", {"front"})


@pytest.mark.slow
def test_it_is_made_again_from_its_own_bench_and_resumed(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    with pytest.raises(Crash):
        make_dataset(plan, tmp_path / "set", replace(inline(), make_workers=partial(Inline, crash_at=1)))
    again = make_plan(
        whole / "bench.yaml",
        vehicle="rear",
        frames=FRAMES,
        quality=None,
        seed=None,
        settings=(),
        work=lambda: tmp_path,
    )
    make_dataset(again, tmp_path / "set", inline(resume=True))
    # These quote the names of the bench's files, which are others in the folder of a data set.
    quoting = {"dataset.json", "index.html", "checksums.csv", "mav0/body.yaml"}
    made, first = tree_of(tmp_path / "set"), tree_of(whole)
    assert {name for name in first if made.get(name) != first[name]} <= quoting
    assert set(made) == set(first)


def test_other_settings_of_a_vehicle_are_named_when_resuming(whole: Path, tmp_path: Path) -> None:
    changed = plan_of(tmp_path, text=BENCH.replace("fov_deg: 60", "fov_deg: 61"))
    with pytest.raises(ConfigError, match=r"made with another rear\.sensors\.camera\.fov_deg \(60\.0, now 61\.0\)"):
        make_dataset(changed, whole, inline(resume=True))


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        (None, r"has several vehicles \(front, rear\).*--vehicle NAME; with a camera, LiDAR or radar: rear"),
        ("reer", r"--vehicle: is unknown: 'reer'; the vehicles are front, rear \(did you mean 'rear'\?\)"),
        ("front", r"bench\.yaml: front: has no camera, LiDAR or radar"),
    ],
)
def test_a_vehicle_that_cannot_record_is_refused(vehicle: str | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        plan_of(tmp_path, vehicle=vehicle)


def test_the_only_vehicle_has_no_name(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_command_line(["dataset", "--vehicle", "rear", "--out", str(tmp_path / "set")]) == 2
    assert "--vehicle: has no meaning" in capsys.readouterr().err


def test_companions_of_any_vehicle_are_refused(tmp_path: Path) -> None:
    text = BENCH.replace("front: {}", "front: {companion: {clients: 1}}")
    with pytest.raises(ConfigError, match=r"bench\.yaml: front: has companions"):
        plan_of(tmp_path, text=text)


@pytest.mark.slow
def test_a_mission_with_an_end_is_flown_again_by_all(tmp_path: Path) -> None:
    """The other vehicle starts again too: it is in the same direction in the first picture of both flights."""
    root = tmp_path / "set"
    make_dataset(plan_of(tmp_path, frames=60), root, inline())
    coco = json.loads((root / "annotations/instances_all.json").read_text())
    times = [int(Path(image["file_name"]).stem) for image in coco["images"]]
    first = next(i for i in range(1, 60) if times[i] - times[i - 1] > 2 * 10**9)
    drone = next(category["id"] for category in coco["categories"] if category["name"] == "drone")
    boxes = {row["image_id"]: row["bbox"] for row in coco["annotations"] if row["category_id"] == drone}
    assert len(boxes) == 60
    before, after = (boxes[coco["images"][i]["id"]] for i in (0, first))
    # The centre: the box itself also changes with the attitude, and each flight has noise of its own.
    for axis in (0, 1):
        assert after[axis] + after[axis + 2] / 2 == pytest.approx(before[axis] + before[axis + 2] / 2, abs=1.5)


@pytest.mark.slow
def test_a_parked_vehicle_is_seen_and_a_lost_recorder_is_an_error(tmp_path: Path) -> None:
    parked = BENCH.replace("front: {}", "front: {mission: null}")
    made = make_dataset(plan_of(tmp_path, frames=2, text=parked), tmp_path / "parked", inline())
    assert made.frames == 2
    dies = BENCH.replace("limits:", "autopilot: {on_loss: go_on, faults: {die_at_s: 6}}\n    limits:")
    with pytest.raises(HilError, match=r"^rear: ") as error:
        make_dataset(plan_of(tmp_path, text=dies), tmp_path / "lost", inline())
    assert not isinstance(error.value, RecordingError)
