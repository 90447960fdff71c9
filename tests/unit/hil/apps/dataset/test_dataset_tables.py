"""CSV, YAML, LiDAR, radar and the datasheet of a data set, read back."""

from __future__ import annotations

import html
import io
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from hil.apps.dataset.flight import FlightData
from hil.apps.dataset.formats import euroc
from hil.apps.dataset.formats.datasheet import Datasheet, datasheet_html
from hil.apps.dataset.formats.labels import Catalogue, ObjectLabel, PictureLabels
from hil.apps.dataset.formats.lidar_bin import CSV_HEADER, lidar_bin, lidar_csv, lidar_label
from hil.apps.dataset.formats.png import encode_png
from hil.apps.dataset.formats.previews import cloud_previews, radar_picture, visible_objects, with_boxes
from hil.apps.dataset.formats.radar_labels import radar_labels_csv, read_radar_labels
from hil.apps.dataset.formats.radar_npy import npy, radar_json
from hil.apps.dataset.formats.split import split_frames
from hil.apps.dataset.storage.tables import TABLES, TRUTH, Table, Tables
from hil.apps.dataset.storage.tree import Written
from hil.run.recorder.mcap.topics import columns_of
from signals.classes import Classes
from signals.errors import RecordingError
from signals.samples import (
    BaroSample,
    FlowSample,
    GpsSample,
    ImuSample,
    MagSample,
    OdometrySample,
    PointCloudSample,
    RangeSample,
    TruthState,
)
from sim.frame.camera_model import CameraModel
from sim.radar.chirp import Chirp
from sim.radar.ghost_objects import GhostEcho
from sim.radar.object_echoes import ObjectEcho
from sim.radar.recording import load_recording
from sim.radar.virtual_array import as_array

CHIRP = Chirp(center_frequency_hz=60e9, bandwidth_hz=1e9, samples=16, sample_rate_hz=1e6, chirps=4, repetition_s=500e-6)
MAP_CHIRP = Chirp(
    center_frequency_hz=60.8e9, bandwidth_hz=4e8, samples=64, sample_rate_hz=2e6, chirps=64, repetition_s=390.975e-6
)
CLASSES = Classes(("none", "tree"), ((0, 0, 0), (0, 200, 0)))


def truth(t_ns: int, x: float = 0.0) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    return TruthState(0, t_ns, (x, 1.5, -2.0), (0.5, -0.5, 0.5, 0.5), (0.1, 0.2, 0.3), zero, zero, zero, (), False)


def rows_of(text: str) -> tuple[list[str], list[list[float]]]:
    head, *rows = text.splitlines()
    return head.split(","), [[float(value) for value in row.split(",")] for row in rows]


def table_of(header: str, samples: list[Any], names: euroc.TableColumns, *, later_ns: int = 0) -> str:
    table = Table("data.csv", header)
    table.add_samples(columns_of(type(samples[0]), samples, later_ns), names)
    return "".join(table.waiting)


def test_truth_has_the_columns_of_euroc() -> None:
    head, rows = rows_of(table_of(euroc.TRUTH_HEADER, [truth(0), truth(4, 0.25)], euroc.TRUTH_COLUMNS))
    assert len(head) == 17
    assert head[0] == "#timestamp"
    assert head[4].startswith("q_RS_w")
    assert rows[1] == [4.0, 0.25, 1.5, -2.0, 0.5, -0.5, 0.5, 0.5, 0.1, 0.2, 0.3, *[0.0] * 6]


@pytest.mark.parametrize(
    ("sample", "row"),
    [
        (BaroSample(0, 5, 9, 101325.2, -0.125, 25.0), "5,101325.2,-0.125,25.0"),
        (MagSample(0, 5, 9, (2e-05, -0.0, 1.0)), "5,2e-05,-0.0,1.0"),
        (
            GpsSample(0, 5, 9, 47.1, 8.5, 400.25, (1.0, 2.0, 3.0), 0.8, 1.2, 3, 11),
            "5,47.1,8.5,400.25,1.0,2.0,3.0,0.8,1.2,3,11",
        ),
        (RangeSample(0, 5, 9, 1.5, 0.1, 12.0, 0.02, 87, (0.0, 0.0, -1.0)), "5,1.5,87"),
        (
            OdometrySample(0, 5, 9, (1.0, -2.5, 0.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, -0.25), 0.01, 0.003, 0.03),
            "5,1.0,-2.5,0.0,1.0,0.0,0.0,0.0,0.5,0.0,-0.25",
        ),
        (FlowSample(0, 5, 9, 4_000_000, (0.25, -1e-07), (0.0, 0.0, 0.0), 200, 1.5, 30.0), "5,4000000,0.25,-1e-07,200"),
    ],
)
def test_rows_of_other_sensors(sample: Any, row: str) -> None:
    header, columns = TABLES[type(sample)]
    assert table_of(header, [sample], columns) == f"{header}\n{row}\n"
    assert header.count(",") == row.count(",")


@pytest.mark.parametrize("times", [(-1,), (6, 6), (7, 6)])
def test_times_that_do_not_rise_are_no_table(times: tuple[int, ...]) -> None:
    with pytest.raises(RecordingError, match=f"data.csv: time must rise.*{times[-1]} ns follows"):
        table_of("#", [truth(t_ns) for t_ns in times], euroc.TRUTH_COLUMNS)


def test_numbers_are_written_as_python_writes_them() -> None:
    sample = ImuSample(0, 1_600_000_000_000_000_000, 7, (1 / 7, -0.0, 1e22), (5e-324, 5.0, 1e-7), 20.0)
    row = "1600000000000000002,5e-324,5.0,1e-07,0.14285714285714285,-0.0,1e+22"
    assert table_of("#", [sample], euroc.IMU_COLUMNS, later_ns=2) == f"#\n{row}\n"


def test_rows_wait_until_they_are_written_and_time_must_rise(tmp_path: Path) -> None:
    tables = Tables(tmp_path, {TRUTH: euroc.TRUTH_HEADER, "cam0": euroc.FILE_HEADER}, {})
    for t_ns in (5, 9):
        tables.add_flight(FlightData(columns_of(TruthState, [truth(t_ns)]), {}, []))
        tables.add_files(files_at(t_ns))
    assert tables.rows == {TRUTH: 2, "cam0": 2}
    tables.write_out(tables.take())
    assert (tmp_path / "mav0/cam0/data.csv").read_text() == "#timestamp [ns],filename\n5,5.png\n9,9.png\n"
    assert tables.take() == {}
    with pytest.raises(RecordingError, match=r"mav0/cam0/data.csv: time must rise.*9 ns follows 9"):
        tables.add_files(files_at(9))
    with pytest.raises(RecordingError, match=r"data.csv: time must rise.*8 ns follows 9"):
        tables.add_flight(FlightData(columns_of(TruthState, [truth(8)]), {}, []))


def files_at(t_ns: int) -> Any:
    return SimpleNamespace(
        files=(Written(f"mav0/cam0/data/{t_ns}.png", 0, 0), Written(f"Annotations/{t_ns}.xml", 0, 0))
    )


def test_sensor_yaml_reads_as_yaml_with_numbers() -> None:
    noise = {"gyroscope_noise_density": 1e-05, "gyroscope_random_walk": 2.5e-07, "accelerometer_noise_density": 0.002}
    text = euroc.sensor_yaml("imu", comment="an IMU: of a bench", T_BS=euroc.IDENTITY, rate_hz=250.0, more=noise)
    data = yaml.safe_load(text)
    given = {"sensor_type": "imu", "comment": "an IMU: of a bench", "rate_hz": 250.0}
    assert data == given | noise | {"T_BS": {"cols": 4, "rows": 4, "data": list(euroc.IDENTITY)}}
    with pytest.raises(RecordingError, match="16 numbers"):
        euroc.sensor_yaml("lidar", comment="", T_BS=(1.0,), rate_hz=10.0)


def test_depth_has_the_camera_s_calibration_and_its_own_scale() -> None:
    camera = CameraModel.from_opencv(320, 240, 160.0, 161.0, 159.5, 119.5)
    text = euroc.picture_yaml(
        camera, "depth", comment="depth: 1 mm", T_BS=euroc.IDENTITY, rate_hz=10.0, more={"step_m": 0.001}
    )
    data = yaml.safe_load(text)
    given = {"sensor_type": "depth", "comment": "depth: 1 mm", "step_m": 0.001}
    pinhole = {"intrinsics": [160.0, 161.0, 159.5, 119.5], "resolution": [320, 240]}
    lens = {"distortion_model": "radial-tangential", "distortion_coefficients": [0.0] * 4}
    assert data == data | given | pinhole | lens


def cloud(n: int = 200) -> PointCloudSample:
    rng = np.random.default_rng(2)
    return PointCloudSample(
        3,
        0,
        0,
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0, 0.0),
        rng.normal(size=(n, 3)).astype(np.float32),
        rng.random(n).astype(np.float32),
        rng.random(n).astype(np.float32),
        rng.integers(0, 16, n).astype(np.uint8),
        rng.integers(-1000, 1000, n).astype(np.int32),
        rng.integers(0, 200, n).astype(np.uint8),
    )


@pytest.mark.parametrize("n", [0, 1, 200])
def test_lidar_reads_back_bit_for_bit(n: int) -> None:
    sample = cloud(n)
    points = np.frombuffer(lidar_bin(sample), "<f4").reshape(-1, 4)
    assert np.array_equal(points[:, :3], sample.points_L)
    assert np.array_equal(points[:, 3], sample.intensity)
    instance = np.random.default_rng(3).integers(0, 65536, n).astype(np.uint16)
    labels = np.frombuffer(lidar_label(sample, instance), "<u4")
    assert np.array_equal(labels & 0xFFFF, sample.segmentation)
    assert np.array_equal(labels >> 16, instance)
    head, rows = rows_of(lidar_csv(sample, instance).decode())
    assert len(head) == len(CSV_HEADER.split(","))
    table = np.array(rows, np.float32).reshape(-1, 9)
    assert np.array_equal(table[:, :3], sample.points_L)
    assert np.array_equal(table[:, 3], sample.intensity)
    assert np.array_equal(table[:, 4], sample.range_m)
    columns = [sample.ring, sample.time_offset_ns, sample.segmentation, instance]
    assert np.array_equal(table[:, 5:].astype(int).T, columns)


def test_lidar_refusals() -> None:
    with pytest.raises(RecordingError, match="do not fit together"):
        lidar_bin(cloud()._replace(intensity=np.zeros(3, np.float32)))
    with pytest.raises(RecordingError, match="199 instances and 200 points do not fit together"):
        lidar_label(cloud(), np.zeros(199, np.uint16))


def test_radar_reads_back_and_its_settings_open_as_a_recording(tmp_path: Path) -> None:
    adc = np.arange(3 * 4 * 16, dtype=np.uint16).reshape(3, 4, 16)
    power = np.random.default_rng(0).random((4, 8)).astype(np.float32)
    assert np.array_equal(np.load(io.BytesIO(npy(adc))), adc)
    assert np.array_equal(np.load(io.BytesIO(npy(power))), power)
    assert npy(adc) == npy(adc.copy(order="F"))
    text = radar_json(CHIRP, as_array(((0.0, 0.0, 0.0),) * 3), rate_hz=10.0)
    assert json.loads(text)["range_doppler"]["zero_speed_row"] == 2
    (tmp_path / "raw.json").write_text(text)
    np.save(tmp_path / "raw.npy", adc[None])
    recording = load_recording(tmp_path / "raw.npy")
    assert recording.chirp.bandwidth_hz == pytest.approx(CHIRP.bandwidth_hz)
    assert recording.frame_repetition_s == pytest.approx(0.1)
    assert recording.rx_antennas == (1, 2, 3)


def page_text() -> str:
    sheet = Datasheet(
        title="park & <tree>",
        about=["a < b"],
        provenance={"scene": "park"},
        sensors=[("cam0", "mav0/cam0", "colour", "10", "100")],
        formats={},
        classes=CLASSES,
        class_pixels=[750, 250],
        class_objects={1: (3, 2, 1, 0)},
        split=split_frames(100),
        pictures=[("rgb", "png", encode_png(np.zeros((4, 4, 3), np.uint8)))],
    )
    return datasheet_html(sheet)


def test_datasheet_stands_alone_and_says_what_is_in_it() -> None:
    text = page_text()
    assert re.findall(r'(?:src|href)="(?!data:)', text) == []
    shown = html.unescape(re.sub("<[^>]*>", " ", text))
    for wanted in ("park & <tree>", "a < b", "mav0/cam0", "6 labelled objects", "75 %", "CC0-1.0", "validation"):
        assert wanted in " ".join(shown.split()), wanted
    assert text == page_text()


def test_previews_show_boxes_points_and_echoes() -> None:
    labels = PictureLabels(20, 10, (ObjectLabel(1, 1, 2, 3, 6, 8, 9, False, 0.0),), np.zeros(256, np.int64))
    marked = with_boxes(np.zeros((10, 20, 3), np.uint8), labels)
    assert marked.any(axis=2).sum() == 2 * 5 + 2 * 4
    assert marked[3, 2].tolist() == marked[8, 6].tolist() == [255, 255, 0]
    points = np.array([[39.9, 39.9, 0.0], [100.0, 0.0, 0.0]], np.float32)
    assert cloud_previews(points, np.array([1, 1], np.uint8), CLASSES)["cloud.png"][:4] == b"\x89PNG"


def test_labels_of_a_radar_with_bounces_name_paths_and_true_objects() -> None:
    objects = [ObjectEcho(1, 6.0, 5.5, 1.0, 0.2, -0.1, 50.0, 1e-12)]
    catalogue = Catalogue.of(CLASSES, [(i, 1) for i in (1, 2)])
    ghosts = [
        GhostEcho(objects[0]._replace(range_m=6.4), "out", 2),
        GhostEcho(objects[0]._replace(instance=9), "both ways", 2),  # of nothing that is labelled
    ]
    data = radar_labels_csv(objects, catalogue, ghosts)
    rows = [line.split(",") for line in data.decode().splitlines()]
    assert rows[0][-2:] == ["path", "mirror []"]
    assert [(row[0], row[3], *row[10:]) for row in rows[1:]] == [
        ("1", "6.0000", "direct", ""),
        ("1", "6.4000", "out", "2"),
    ]
    assert [o.range_m for _, o in read_radar_labels(data)] == [6.0]
    assert b"path" not in radar_labels_csv(objects, catalogue)


def test_radar_labels_read_back_and_visible_objects_are_marked() -> None:
    objects = [
        ObjectEcho(1, 6.0, 5.5, 1.0, 0.2, -0.1, 50.0, 1e-12),
        ObjectEcho(2, 9.0, 8.5, -4.0, -0.2, -0.1, 50.0, 1e-12),  # faster than the map: folded to 2.3 m/s
        ObjectEcho(3, 3.0, 3.0, -2.0, 0.0, 0.0, 50.0, 1e-12),  # hidden in noise
        ObjectEcho(4, 6.0, 6.0, 1.0, 0.0, 0.0, 0.5, 1e-15),  # in the cell of the first, but too weak
    ]
    catalogue = Catalogue.of(CLASSES, [(i, 1) for i in (1, 2, 3, 4)])
    data = radar_labels_csv(objects, catalogue)
    assert data == radar_labels_csv(objects, catalogue)
    rows = read_radar_labels(data)
    assert [o.instance for _, o in rows] == [1, 2, 3, 4]
    for (name, back), o in zip(rows, objects, strict=True):
        assert name == catalogue.classes.name(catalogue.class_of_instance[o.instance])
        assert back == pytest.approx(o, rel=1e-3)

    power = np.ones((64, 32), np.float32)
    power[32 + round(1.0 / MAP_CHIRP.speed_resolution_mps), round(6.0 / MAP_CHIRP.range_resolution_m)] = 50.0
    folded_mps = -4.0 + 2.0 * MAP_CHIRP.max_speed_mps
    power[32 + round(folded_mps / MAP_CHIRP.speed_resolution_mps), round(9.0 / MAP_CHIRP.range_resolution_m)] = 100.0
    found = visible_objects(power, objects, MAP_CHIRP)
    assert [(o.instance, round(level_db, 1)) for o, level_db in found] == [(1, 17.0), (2, 20.0)]
    unmarked, marked = (
        cv2.imdecode(np.frombuffer(radar_picture(power, shown, MAP_CHIRP), np.uint8), cv2.IMREAD_COLOR)
        for shown in ([], rows)
    )
    assert unmarked is not None
    assert marked is not None
    assert (unmarked != marked).any(axis=2).sum() > 300
