"""3-D labels of a data set: KITTI and nuScenes by their own definitions and, where installed, by their own kits.

The flight is in the air, tilted and turning; people walk. Boxes themselves: tests/reference/test_object_labels.py.
"""

from __future__ import annotations

import csv
import errno
import json
import math
import os
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.dataset import label_form
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.split import split_frames
from hil.apps.dataset.label_forms import nuscenes
from hil.apps.dataset.label_forms.kitti import occluded
from hil.apps.dataset.make import make_dataset
from hil.apps.dataset.plan import DatasetPlan, make_plan
from hil.apps.dataset.storage.tree import TreeWriter
from hil.data_set_files import LABEL_FORMATS
from signals.classes import Classes
from signals.errors import ConfigError, RecordingError
from tests.worlds.small_dataset import Crash, Inline, inline, tiny_plan, tree_of

BENCH = """
rig: mock
tick_hz: 100
scene: city_park
seed: 5
duration_s: 60
autopilot: {transport: loopback}
dataset: {trajectory: {preset: circle, side_m: 12, height_m: 3, speed_mps: 3}, FORMATS}
randomize:
  people: {count: [12, 12], within_m: 15, clear_m: 4}
sensors:
  imu:   {preset: icm20689}
  gps:   {preset: here_plus, rate_hz: 10}
  baro:  {preset: ms5611, rate_hz: 50}
  mag:   {preset: ist8310, rate_hz: 50}
  front: {kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 10,
          channels: [rgb, segmentation, instance, depth], mount_m: [0.1, 0, 0.05], mount_rpy_deg: [0, 15, 10]}
  lidar: {preset: vlp16, rate_hz: 5, subsweeps: 4, mount_m: [0, 0, 0.08], mount_rpy_deg: [0, 0, 90]}
"""
FORMATS = "formats: [kitti, nuscenes]"
FRAMES = 31  # with guard frames between the sets
NOISE_M = 5 * 0.03 + 0.002
WALKED_M = 0.2 * 2.5  # within a sweep
TYPES = {"person": "Pedestrian", "vehicle": "Car", "bicycle": "Cyclist"}
LISTS = {"train": ["train"], "val": ["validation"], "test": ["test"], "trainval": ["train", "validation"]}
Array = NDArray[Any]


def bench(formats: str = FORMATS) -> str:
    return BENCH.replace("FORMATS", formats)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> DatasetPlan:
    return tiny_plan(tmp_path_factory.mktemp("bench"), frames=FRAMES, bench=bench())


@pytest.fixture(scope="module")
def whole(plan: DatasetPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole") / "set"
    make_dataset(plan, root, inline())
    return root


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table by the names of its columns, without their units."""
    names, *rows = csv.reader(path.read_text().splitlines())
    return [dict(zip((name.partition(" [")[0] for name in names), row, strict=True)) for row in rows]


def test_only_new_files_come_with_the_labels(whole: Path, tmp_path: Path) -> None:
    plain = tiny_plan(tmp_path / "bench", frames=FRAMES, bench=bench("formats: []"))
    make_dataset(plain, tmp_path / "set", inline())
    ours, theirs = tree_of(whole), tree_of(tmp_path / "set")
    differs = {path for path, content in theirs.items() if ours.get(path) != content}
    assert differs <= {"bench.yaml", "checksums.csv", "dataset.json", "index.html", "journal.sqlite3", "run.mcap"}
    added = {path.split("/")[0] for path in ours.keys() - theirs.keys()}
    assert added == {"mav0", "kitti", "nuscenes", "preview"}
    assert {path for path in ours.keys() - theirs.keys() if path.startswith("preview")} == {
        "preview/front-boxes3d.png",
        "preview/lidar-above.png",
    }


def test_a_killed_data_set_is_resumed_to_the_same_tree(plan: DatasetPlan, whole: Path, tmp_path: Path) -> None:
    root = tmp_path / "set"
    with pytest.raises(Crash):
        make_dataset(plan, root, replace(inline(), make_workers=partial(Inline, crash_at=2)))
    make_dataset(plan, root, inline(resume=True))
    assert tree_of(root) == tree_of(whole)


def calibration(path: Path) -> dict[str, Array]:
    rows = [line.split(": ") for line in path.read_text().splitlines()]
    return {name: np.array(values.split(), float).reshape(3, -1) for name, values in rows}


def kitti_frames(whole: Path) -> list[str]:
    return sorted(path.stem for path in (whole / "kitti/training/label_2").iterdir())


def homogeneous(points: Array) -> Array:
    return np.hstack([points, np.ones((len(points), 1))])


def rectified(whole: Path, name: str) -> tuple[Array, Array, Array, dict[str, Array]]:
    """Return the points of a sweep in the rectified camera's frame, their instances and classes; the calibration."""
    folder = whole / "kitti/training"
    P = calibration(folder / f"calib/{name}.txt")
    points = np.fromfile(folder / f"velodyne/{name}.bin", "<f4").reshape(-1, 4)
    labels = np.fromfile(folder / f"labels/{name}.label", "<u4")
    assert len(points) == len(labels) > 1000
    in_camera = homogeneous(points[:, :3].astype(float)) @ P["Tr_velo_to_cam"].T
    return in_camera @ P["R0_rect"].T, labels >> 16, labels & 0xFFFF, P


def test_kitti_by_its_definition(whole: Path) -> None:
    """Every label is one line of 15 fields; the points of each object lie in the box that its label describes."""
    names = kitti_frames(whole)
    frames = [int(name) for name in names]
    assert frames == list(range(frames[0], FRAMES, 2))  # sweeps come with every second picture
    found = checked = 0
    for row in csv.reader((whole / "kitti/timestamps.csv").read_text().splitlines()[1:]):
        name, t_ns = row
        picture = cv2.imread(str(whole / f"kitti/training/image_2/{name}.png"))
        assert picture is not None
        assert picture.shape == (240, 320, 3)
        points, instance, _, P = rectified(whole, name)
        boxes = rows_of(whole / f"mav0/cam0/boxes/{t_ns}.csv")
        lines = (whole / f"kitti/training/label_2/{name}.txt").read_text().splitlines()
        assert len(lines) == len(boxes) > 0
        for line, box in zip(lines, boxes, strict=True):
            kind, *fields = line.split(" ")
            truncated, hidden, alpha, left, top, right, bottom, h, w, length, x, y, z, ry = map(float, fields)
            assert kind == TYPES.get(box["class"], box["class"])
            assert truncated == float(box["truncation"])
            assert hidden == occluded(float(box["occlusion"]))
            assert 0 <= left <= right <= 319
            assert 0 <= top <= bottom <= 239
            assert math.remainder(ry - math.atan2(x, z) - alpha, 2 * math.pi) == pytest.approx(0, abs=2e-6)
            # The kit's corners: x = +-l/2, z = +-w/2, y = 0 (bottom), -h (top), turned by ry about y, then moved.
            turn = np.array([[math.cos(ry), 0, math.sin(ry)], [0, 1, 0], [-math.sin(ry), 0, math.cos(ry)]])
            mine = points[instance == int(box["instance"])]
            local = (mine - [x, y, z]) @ turn
            margin = NOISE_M + (WALKED_M if box["class"] == "person" else 0.0)
            assert (np.abs(local[:, 0]) <= 0.5 * length + margin).all(), line
            assert (np.abs(local[:, 2]) <= 0.5 * w + margin).all(), line
            assert ((local[:, 1] <= margin) & (local[:, 1] >= -h - margin)).all(), line
            checked += len(mine)
            corners = np.array([[i * length / 2, j * h, k * w / 2] for i in (-1, 1) for j in (-1, 0) for k in (-1, 1)])
            corners = corners @ turn.T + [x, y, z]
            if (corners[:, 2] > 0).all():
                image = homogeneous(corners) @ P["P2"].T
                u, v = image[:, 0] / image[:, 2], image[:, 1] / image[:, 2]
                assert u.min() <= left + 1e-3
                assert u.max() >= right - 1e-3
                assert v.min() <= top + 1e-3
                assert v.max() >= bottom - 1e-3
            found += 1
    assert found > 100
    assert checked > 1000


def test_kitti_points_fall_on_the_pixels_of_their_instance(whole: Path) -> None:
    """P2 R0_rect Tr_velo_to_cam leads each point to a pixel that shows its instance, away from edges."""
    compared = wrong = 0
    times = dict(csv.reader((whole / "kitti/timestamps.csv").read_text().splitlines()[1:]))
    for name, t_ns in times.items():
        points, instance, class_id, P = rectified(whole, name)
        shown = cv2.imread(str(whole / f"mav0/instance0/data/{t_ns}.png"), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(whole / f"mav0/depth0/data/{t_ns}.png"), cv2.IMREAD_UNCHANGED)
        classes = cv2.imread(str(whole / f"mav0/segmentation0/data/{t_ns}.png"), cv2.IMREAD_UNCHANGED)
        ahead = points[:, 2] > 0.5
        image = homogeneous(points[ahead]) @ P["P2"].T
        at = np.rint(image[:, :2] / image[:, 2:]).astype(int)
        for (u, v), z, i, c in zip(at, points[ahead, 2], instance[ahead], class_id[ahead], strict=True):
            if 2 <= u < 318 and 2 <= v < 238:
                near = shown[v - 2 : v + 3, u - 2 : u + 3]
                if (near == near[0, 0]).all() and abs(depth[v, u] * 0.001 - z) < 0.3:
                    compared += 1
                    wrong += near[0, 0] != i or classes[v, u] != c
    assert compared > 2000
    assert wrong <= 1e-3 * compared  # a person may walk on within a sweep


def test_kitti_lists_are_those_of_the_split(whole: Path) -> None:
    sets = dict(csv.reader((whole / "split.csv").read_text().splitlines()[1:]))
    listed = {}
    for file, kinds in LISTS.items():
        listed[file] = (whole / f"kitti/ImageSets/{file}.txt").read_text().split()
        assert listed[file] == [name for name in kitti_frames(whole) if sets[str(int(name))] in kinds]
    assert listed["train"]
    assert listed["test"]


def tables_of(whole: Path) -> dict[str, dict[str, Any]]:
    folder = whole / "nuscenes/v1.0-hil"
    tables = {}
    for path in folder.iterdir():
        rows = json.loads(path.read_text())
        tables[path.stem] = {row["token"]: row for row in rows}
        assert len(tables[path.stem]) == len(rows)  # each token once
    return tables


def matrix(q: list[float]) -> Array:
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def test_nuscenes_by_its_schema(whole: Path) -> None:
    """All 13 tables; every token leads somewhere; chains lead from first to last and back; counts are right."""
    t = tables_of(whole)
    assert set(t) == {
        *("attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample"),
        *("sample_annotation", "sample_data", "scene", "sensor", "visibility"),
    }
    for table, keys in {
        "sample": {"scene_token": "scene"},
        "sample_data": {
            "sample_token": "sample",
            "ego_pose_token": "ego_pose",
            "calibrated_sensor_token": "calibrated_sensor",
        },
        "sample_annotation": {
            "sample_token": "sample",
            "instance_token": "instance",
            "visibility_token": "visibility",
        },
        "instance": {
            "category_token": "category",
            "first_annotation_token": "sample_annotation",
            "last_annotation_token": "sample_annotation",
        },
        "scene": {"log_token": "log", "first_sample_token": "sample", "last_sample_token": "sample"},
        "calibrated_sensor": {"sensor_token": "sensor"},
    }.items():
        for row in t[table].values():
            for key, other in keys.items():
                assert row[key] in t[other], (table, key)
    for table in ("sample", "sample_data", "sample_annotation"):
        for token, row in t[table].items():
            assert not row["next"] or t[table][row["next"]]["prev"] == token
            assert not row["prev"] or t[table][row["prev"]]["next"] == token
    for instance, row in t["instance"].items():
        token, count = row["first_annotation_token"], 1
        while t["sample_annotation"][token]["next"]:
            assert t["sample_annotation"][token]["instance_token"] == instance
            token, count = t["sample_annotation"][token]["next"], count + 1
        assert (token, count) == (row["last_annotation_token"], row["nbr_annotations"])
    for row in t["sample_annotation"].values():
        assert all(token in t["attribute"] for token in row["attribute_tokens"])
    for row in t["sample_data"].values():
        assert (whole / "nuscenes" / row["filename"]).is_file()
        sample = t["sample"][row["sample_token"]]
        assert not row["is_key_frame"] or row["timestamp"] == sample["timestamp"]
    assert sum(row["nbr_samples"] for row in t["scene"].values()) == len(t["sample"]) == len(kitti_frames(whole))
    assert sum(not row["is_key_frame"] for row in t["sample_data"].values()) > 10
    assert all((whole / "nuscenes" / row["filename"]).is_file() for row in t["map"].values())


def test_nuscenes_counts_the_points_in_its_boxes(whole: Path) -> None:
    """From the sensor's axes over the ego frame to the global one, by the tables alone."""
    t = tables_of(whole)
    channel = {token: t["sensor"][row["sensor_token"]]["channel"] for token, row in t["calibrated_sensor"].items()}
    of_sample: dict[str, list[Any]] = {}
    for row in t["sample_annotation"].values():
        of_sample.setdefault(row["sample_token"], []).append(row)
    boxes = points_in_boxes = 0
    for data in t["sample_data"].values():
        if channel[data["calibrated_sensor_token"]] != "LIDAR_TOP":
            continue
        points = np.fromfile(whole / "nuscenes" / data["filename"], "<f4").reshape(-1, 5)
        assert 0.0 <= points[:, 3].min() <= points[:, 3].max() <= 255.0
        assert set(points[:, 4].astype(int)) <= set(range(16))
        world = points[:, :3].astype(float)
        for frame in (t["calibrated_sensor"][data["calibrated_sensor_token"]], t["ego_pose"][data["ego_pose_token"]]):
            world = world @ matrix(frame["rotation"]).T + frame["translation"]
        for row in of_sample[data["sample_token"]]:
            w, length, h = row["size"]
            local = (world - row["translation"]) @ matrix(row["rotation"])
            inside = int((np.abs(local) <= [length / 2, w / 2, h / 2]).all(axis=1).sum())
            assert abs(inside - row["num_lidar_pts"]) <= 1  # on a face, to the rounding of a float32
            boxes, points_in_boxes = boxes + 1, points_in_boxes + inside
    assert boxes > 300
    assert points_in_boxes > 3000


def test_nuscenes_annotates_what_picture_and_sweep_show(whole: Path) -> None:
    t = tables_of(whole)
    per_sample: dict[int, int] = {}
    for row in t["sample_annotation"].values():
        t_us = t["sample"][row["sample_token"]]["timestamp"]
        per_sample[t_us] = per_sample.get(t_us, 0) + 1
    levels = {"1": 0, "2": 0, "3": 0, "4": 0}
    for t_us, count in per_sample.items():
        seen = rows_of(whole / f"mav0/cam0/boxes/{t_us * 1000}.csv")
        swept = rows_of(whole / f"mav0/lidar0/boxes/{t_us * 1000}.csv")
        assert count == len({row["instance"] for row in (*seen, *swept)})
        labels = np.fromfile(whole / f"mav0/lidar0/labels/{t_us * 1000}.label", "<u4")
        for row in swept:
            mine = labels[labels >> 16 == int(row["instance"])]
            assert len(mine) == int(row["points"])
        for row in seen:
            share = (1 - float(row["occlusion"])) * (1 - float(row["truncation"]))
            if min(abs(share - edge) for edge in (0.4, 0.6, 0.8)) > 1e-3:
                levels[nuscenes.visibility_token(share)] += 1
    written = {"1": 0, "2": 0, "3": 0, "4": 0}
    for row in t["sample_annotation"].values():
        written[row["visibility_token"]] += 1
    assert written["4"] >= levels["4"] > 20
    found = [token for row in t["sample_annotation"].values() for token in row["attribute_tokens"]]
    moving = {t["attribute"][token]["name"] for token in found}
    assert {"pedestrian.moving", "pedestrian.standing"} <= moving


def test_scenes_end_with_the_set_and_with_the_flight() -> None:
    """A piece without a sample is no scene; a long gap is another flight."""
    sets = ["train"] * 6 + ["guard"] + ["test"] * 3
    times_s = [0.0, 0.1, 0.2, 9.0, 9.1, 9.2, 9.3, 9.4, 9.5, 9.6]
    at = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    frames = [label_form.AnnotatedFrame(i, round(t * 1e9), *at, i not in (6, 8)) for i, t in enumerate(times_s)]
    found = [
        (scene.name, [f.frame for f in scene.frames], [f.frame for f in scene.samples])
        for scene in nuscenes.scenes(frames, sets, 2_000_000_000)
    ]
    assert found == [
        ("train-0001", [0, 1, 2], [0, 1, 2]),
        ("train-0002", [3, 4, 5], [3, 4, 5]),
        ("test-0003", [7, 8, 9], [7, 9]),
    ]
    assert list(nuscenes.scenes([], sets, 1)) == []


@pytest.mark.parametrize(("share", "level"), [(0.0, "1"), (0.399, "1"), (0.4, "2"), (0.6, "3"), (0.8, "4"), (1.0, "4")])
def test_levels_of_visibility_are_those_of_the_schema(share: float, level: str) -> None:
    assert nuscenes.visibility_token(share) == level


def test_nuscenes_devkit_reads_it(whole: Path) -> None:
    kit = pytest.importorskip("nuscenes.nuscenes")
    from nuscenes.utils.data_classes import LidarPointCloud  # type: ignore[import-not-found]
    from nuscenes.utils.geometry_utils import points_in_box  # type: ignore[import-not-found]

    loaded = kit.NuScenes("v1.0-hil", str(whole / "nuscenes"), verbose=False)
    colours = set(loaded.colormap)
    assert {row["name"] for row in loaded.category} - colours == {"vehicle.drone"}
    assert {row["class"] for row in loaded.instance} > {"person", "tree", "building"}
    boxes = seen = 0
    for sample in loaded.sample:
        path, found, _ = loaded.get_sample_data(sample["data"]["LIDAR_TOP"])
        points = LidarPointCloud.from_file(path).points[:3]
        rows = {row["instance"]: row for row in rows_of(whole / f"mav0/lidar0/boxes/{sample['timestamp'] * 1000}.csv")}
        for box in found:
            annotation = loaded.get("sample_annotation", box.token)
            assert abs(int(points_in_box(box, points).sum()) - annotation["num_lidar_pts"]) <= 1
            boxes += 1
        truth = {tuple(round(float(row[k]), 3) for k in "xyz"): row for row in rows.values()}
        for box in loaded.get_boxes(sample["data"]["LIDAR_TOP"]):
            row = truth.get(tuple(round(float(v), 3) for v in box.center))
            if row is not None:
                size = [float(row[k]) for k in ("width", "length", "height")]
                assert np.abs(np.subtract(box.wlh, size)).max() < 2e-6
                turn = box.orientation.yaw_pitch_roll[0] - float(row["heading"])
                assert abs(math.remainder(turn, 2 * math.pi)) < 2e-6
        _, in_picture, K = loaded.get_sample_data(sample["data"]["CAM_FRONT"])
        assert np.abs(K[0, 2] - 159.5) < 1e-9
        seen += len(in_picture)
    assert boxes > 300
    assert seen > 100


def test_kitti_readers_read_it(whole: Path) -> None:
    """pykitti's calibration and points."""
    utils = pytest.importorskip("pykitti.utils")
    names = kitti_frames(whole)
    for name in names:
        path = whole / f"kitti/training/calib/{name}.txt"
        read, own = utils.read_calib_file(str(path)), calibration(path)
        assert set(read) == set(own)
        assert all(np.array_equal(read[key], own[key].ravel()) for key in own)
        velodyne = utils.load_velo_scan(str(whole / f"kitti/training/velodyne/{name}.bin"))
        assert velodyne.shape[1] == 4
        assert np.isfinite(velodyne).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("  lidar:", "  # lidar:"), "needs a LiDAR, for kitti and nuscenes"),
        (("segmentation, instance, depth", "depth"), "needs a camera that shows classes and instances"),
        (("mount_m: [0.1", "distortion: {model: brown_conrady, k1: -0.05}, mount_m: [0.1"), "distortion of the camera"),
    ],
)
def test_what_a_form_needs_is_said_before_the_flight(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    text = bench()
    assert change[0] in text
    with pytest.raises(ConfigError, match=message):
        tiny_plan(tmp_path, frames=5, bench=text.replace(*change))


def test_boxes_alone_need_neither(tmp_path: Path) -> None:
    bent = "distortion: {model: brown_conrady, k1: -0.05}, mount_m: [0.1"
    text = bench("formats: [boxes]").replace("mount_m: [0.1", bent)
    without_lidar = "\n".join(line for line in text.splitlines() if not line.startswith("  lidar:"))
    root = tmp_path / "set"
    make_dataset(tiny_plan(tmp_path / "bench", frames=3, bench=without_lidar), root, inline())
    assert len(list((root / "mav0/cam0/boxes").iterdir())) == 3
    assert not (root / "kitti").exists()
    assert not (root / "nuscenes").exists()
    text = text.replace("segmentation, instance, depth", "depth")
    root = tmp_path / "lidar"
    make_dataset(tiny_plan(tmp_path / "bench", frames=3, bench=text), root, inline())
    assert rows_of(next((root / "mav0/lidar0/boxes").iterdir()))


def test_a_form_is_one_file() -> None:
    assert LABEL_FORMATS == ("boxes", "kitti", "nuscenes")
    for name in LABEL_FORMATS[1:]:
        form = import_module(f"hil.apps.dataset.label_forms.{name}").Form
        assert issubclass(form, label_form.LabelForm)
        assert name in form.contents.lower()


def test_names_of_forms_are_checked(tmp_path: Path) -> None:
    def planned(*formats: str) -> DatasetPlan:
        return make_plan(None, frames=1, quality=None, seed=None, settings=(), work=lambda: tmp_path, formats=formats)

    with pytest.raises(ConfigError, match="--format") as error:
        planned("kiti", "coco")
    assert "is unknown: 'kiti'" in str(error.value)
    assert "kitti" in str(error.value)
    assert "coco: it is always written" in str(error.value)
    assert planned("kitti", "kitti", "nuscenes").formats == {"kitti", "nuscenes"}
    assert planned().formats == frozenset()


def test_a_full_disk_at_the_links_says_how_to_go_on(
    plan: DatasetPlan, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.symlink

    def full(target: str, path: Any, **more: Any) -> None:
        if "image_2" in str(path):
            raise OSError(errno.ENOSPC, "No space left on device")
        real(target, path, **more)

    root = tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setattr(label_form.os, "symlink", full)
        with pytest.raises(RecordingError, match=r"image_2.*cannot be written \(No space left on device\).*--resume"):
            make_dataset(plan, root, inline())
    make_dataset(plan, root, inline(resume=True))
    assert tree_of(root) == tree_of(whole)


def test_no_sweep_with_a_picture_ends_with_a_message(plan: DatasetPlan, tmp_path: Path) -> None:
    alone = label_form.AnnotatedFrame(0, 0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), False)
    catalogue = Catalogue.of(Classes(("none",), ((0, 0, 0),)), [])
    forms = label_form.forms_of(plan, catalogue)
    files = label_form.finish_forms(forms, TreeWriter(tmp_path), split_frames(1), lambda: [alone])
    with pytest.raises(RecordingError, match=r"no frame has a sweep of lidar at the same time.*--frames"):
        list(files)
