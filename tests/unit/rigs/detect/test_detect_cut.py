"""`detect` behind the client's interface, with a stand-in for the network (tests/worlds/detector_stand_in.py)."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.unit.rigs.detect.test_locate import HEIGHT, WIDTH, calibration
from tests.worlds.detector_stand_in import PERSON, StandIn

from hil_companion.catalog import make_cut  # isort: skip
from hil_companion.errors import CutError, OptionError  # isort: skip
from hil_companion.frame import Frame, Sample  # isort: skip

TOPICS = ("front/rgb", "front/depth", "front/segmentation", "front/instance", "truth")


def welcome(**changes: Any) -> Any:
    told = {"topics": {topic: {} for topic in TOPICS}, "sensors": {"front": calibration()}}
    return SimpleNamespace(**(told | changes))


def frame(
    number: int, people: dict[int, tuple[int, int, int, int]], *, depth_m: float = 12.0, size: Any = None
) -> Frame:
    """Make a frame with people by instance: x0, y0, x1, y1 of their visible part."""
    t_ns = number * 250_000_000
    shape = (HEIGHT, WIDTH) if size is None else size
    rgb, depth = np.full((*shape, 3), 80, np.uint8), np.full(shape, 40.0, np.float32)
    segmentation, instance = np.zeros(shape, np.uint8), np.zeros(shape, np.uint16)
    for one, (x0, y0, x1, y1) in people.items():
        place = np.s_[y0:y1, x0:x1]
        depth[y1 : y1 + 8, x0:x1] = depth_m  # the ground under the feet
        rgb[place], depth[place], segmentation[place], instance[place] = (200, 40, 40), depth_m, PERSON, one
    arrays = {"rgb": rgb, "depth": depth, "segmentation": segmentation, "instance": instance}
    samples = {
        f"front/{name}": Sample(f"front/{name}", number, t_ns, t_ns, {}, {name: array})
        for name, array in arrays.items()
    }
    values = {"p_WB": [0.0, 0.0, 10.0], "q_WB": [1.0, 0.0, 0.0, 0.0], "v_WB_W": [0.0, 0.0, 0.0]}
    samples["truth"] = Sample("truth", number, t_ns, t_ns, values, {})
    header = {"frame": number, "tick": number, "t_ns": t_ns, "t_sent_ns": 0, "dropped": 0}
    return Frame(header, samples, in_ring=False, t_received_ns=0)


def test_people_are_reported_with_range_place_and_number_and_saved(tmp_path: Path) -> None:
    cut = StandIn(depth="front/depth", localiser="truth", out=str(tmp_path / "left"))
    cut.start(welcome())
    boxes = {7: (150, 110, 160, 140), 9: (40, 80, 50, 110)}
    told = []
    for k in range(12):
        assert cut(frame(k, boxes)) is None  # it commands nothing
        assert cut.detections is not None
        told.append(cut.detections)
    assert [(d.topic, d.t_capture_ns, d.size_px) for d in told][2] == ("front/rgb", 500_000_000, (WIDTH, HEIGHT))
    assert {d.box_px for d in told[0].boxes} == {(150, 110, 160, 140), (40, 80, 50, 110)}
    for one in told[0].boxes:
        assert one.range_m == pytest.approx(12.0 * np.linalg.norm(np.array([*_ray(one.box_px), 1.0])), rel=1e-6)
    assert not told[0].objects  # no object is reported after one sighting
    assert told[11].objects is not None
    assert [one.sightings for one in told[11].objects] == [12, 12]
    assert told[11].as_map()["objects"][0][0] == 0
    assert cut.report["pictures"] == 12
    assert cut.report["objects"] == 2
    cut.stop()
    lines = [json.loads(line) for line in (tmp_path / "left" / "detections.jsonl").read_text().splitlines()]
    assert [len(line["boxes"]) for line in lines] == [2] * 12
    found = json.loads((tmp_path / "left" / "found.json").read_text())
    assert found[0]["label"] == "person"
    assert (tmp_path / "left" / "report.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "left" / "0001.jpg").stat().st_size > 1000


def _ray(box: tuple[float, float, float, float]) -> tuple[float, float]:
    return (0.5 * (box[0] + box[2]) - WIDTH / 2) / 200.0, (0.5 * (box[1] + box[3]) - HEIGHT / 2) / 200.0


def test_without_depth_ranges_come_from_the_ground_and_without_a_pose_there_are_no_places() -> None:
    by_ground = StandIn(localiser="truth")
    by_ground.start(welcome())
    by_ground(frame(1, {7: (150, 110, 160, 140)}))
    assert by_ground.detections is not None
    (one,) = by_ground.detections.boxes
    assert one.p_W[2] == pytest.approx(0.0, abs=1e-6)
    assert by_ground.report["range_from"] == "ground"
    blind = StandIn(localiser="none", depth="front/depth")
    blind.start(welcome())
    blind(frame(1, {7: (150, 110, 160, 140)}))
    assert blind.detections is not None
    (one,) = blind.detections.boxes
    assert one.p_W is None
    assert one.range_m is not None
    assert blind.report["boxes_without_place"] == 1


def test_a_frame_without_a_picture_is_no_news_and_another_session_begins_anew() -> None:
    cut = StandIn(localiser="truth", depth="front/depth")
    cut.start(welcome())
    for k in range(12):
        cut(frame(k, {7: (150, 110, 160, 140)}))
    quiet = frame(12, {})
    del quiet.samples["front/rgb"]
    cut(quiet)
    assert cut.detections is None
    assert cut.report["objects"] == 1
    cut.start(welcome())
    assert (cut.report["objects"], cut.report["pictures"]) == (0, 0)


@pytest.mark.parametrize(
    ("bench", "look", "words"),
    [
        ({"topics": {"imu": {}}}, None, "sends no 'front/rgb'"),
        ({"sensors": {}}, None, "no camera calibration of"),
        ({}, frame(1, {}, size=(100, 100)), "320 x 240"),
    ],
)
def test_an_unsuitable_bench_is_refused(bench: dict[str, Any], look: Frame | None, words: str) -> None:
    cut = StandIn(localiser="truth")
    if look is not None:
        cut.start(welcome(**bench))
    with pytest.raises(CutError, match=words):
        cut.start(welcome(**bench)) if look is None else cut(look)


def test_a_wrong_depth_topic_and_a_missing_truth_are_named() -> None:
    cut = StandIn(localiser="truth", depth="front/rgb")
    cut.start(welcome())
    with pytest.raises(CutError, match="not a depth picture"):
        cut(frame(1, {}))
    lost = frame(1, {})
    del lost.samples["truth"]
    cut = StandIn(localiser="truth")
    cut.start(welcome())
    with pytest.raises(CutError, match="needs the topic truth"):
        cut(lost)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("model=/nowhere/none.onnx", "none.onnx"),
        ("localiser=gps", "localiser 'gps'"),
        ("tiles=[0, 2]", "tiles"),
        ("camera=front", "camera 'front'"),
        ("objects=person", "a list of labels"),
        ("threshold=1.2", "threshold 1.2"),
        ("start=[0, 0]", "x, y, z and yaw"),
        ("camra=front/rgb", "did you mean 'camera'"),
    ],
)
def test_invalid_settings_are_refused_with_a_reason(setting: str, words: str) -> None:
    with pytest.raises(OptionError, match=words):
        make_cut("detect", [setting])
