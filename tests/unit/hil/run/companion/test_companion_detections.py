"""Detections: validated by client and bench, kept with their answer, recorded and shown."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from firmware_bridge.codecs.companion import Done, decode_client
from firmware_bridge.codecs.companion_detections import detections_from_map, detections_map
from firmware_bridge.codecs.errors import CodecError
from hil.run.feed.companion_views import boxes_of
from hil.run.recorder.recorder import Recorder
from signals.detections import Detection, Detections, FoundObject
from tests.worlds.scripted_bench import CLIENT

from hil_companion.link import protocol  # isort: skip
from hil_companion import Detections as ClientDetections  # isort: skip
from hil_companion import Found  # isort: skip
from hil_companion.detect.decode import Detection as Seen  # isort: skip
from hil_companion.errors import CutError  # isort: skip

assert CLIENT
TIMES: dict[str, Any] = {"t_received_ns": 1, "t_sent_ns": 2, "t2_ns": 0, "desired": None, "finished": False}
PERSON = Detection("person", 0.75, (10.0, 20.0, 30.5, 60.0), 12.5, -1.25, (3.0, 4.0, 0.5))
CAR = Detection("vehicle", 0.5, (0.0, 0.0, 8.0, 4.0))
OBJECT = FoundObject(3, "person", 9_000_000, (3.0, 4.0, 0.5), (0.5, 0.0, 0.0), 7, 0.4)
SEEN = Detections("front/rgb", 8_000_000, (320, 240), (PERSON, CAR), (OBJECT,))


def values(**changes: Any) -> dict[str, Any]:
    return detections_map(SEEN) | changes


def test_detections_arrive_unchanged() -> None:
    boxes = [Seen("person", PERSON.box_px, 0.75, 12.5, -1.25, (3.0, 4.0, 0.5)), Seen("vehicle", CAR.box_px, 0.5)]
    found = [Found(3, "person", 9_000_000, (3.0, 4.0, 0.5), (0.5, 0.0, 0.0), 7, 0.4)]
    mine = ClientDetections("front/rgb", 8_000_000, (320, 240), boxes, found)
    message = decode_client(protocol.message("done", frame=3, detections=mine.as_map(), **TIMES))
    assert isinstance(message, Done)
    assert message.detections == SEEN
    silent = decode_client(protocol.message("done", frame=3, **TIMES))
    assert isinstance(silent, Done)
    assert silent.detections is None


@pytest.mark.parametrize(
    ("wrong", "names"),
    [
        (values(boxes=[["person", math.nan, 0, 0, 1, 1, None, None, None]]), "boxes"),
        (values(boxes=[["person", 1.5, 0, 0, 1, 1, None, None, None]]), "score"),
        (values(boxes=[["person", 0.5, 5, 0, 1, 1, None, None, None]]), "corners swapped"),
        (values(boxes=[["person", 0.5, 0, 0, 1, math.inf, None, None, None]]), "finite"),
        (values(boxes=[["per\x00son", 0.5, 0, 0, 1, 1, None, None, None]]), "label"),
        (values(boxes=[["person", 0.5, 0, 0, 1, 1, -1.0, None, None]]), "range"),
        (values(boxes=[["person", 0.5, 0, 0, 1, 1, None, None, [1.0, 2.0]]]), "three numbers"),
        (values(boxes=[["person", 0.5, 0, 0]]), "9 entries"),
        (values(boxes=[["person", 0.5, 0, 0, 1, 1, None, None, None]] * 129), "at most 128"),
        (values(boxes=None), "boxes"),
        (values(size_px=[0, 240]), "size_px"),
        (values(topic=7), "topic"),
        (values(objects=[[1, "person", 5, [0, 0, 0], [0, 0, 0], 1, 0.5]] * 2), "same number"),
        (values(objects=[[1, "person", 5, [0, 0, 0], [0, 0, 0], 1, -0.5]]), "sigma"),
        (values(more=1), "unknown"),
        ("people", "not a map"),
    ],
)
def test_invalid_detections_are_refused(wrong: Any, names: str) -> None:
    with pytest.raises(CodecError, match=names):
        decode_client(protocol.message("done", frame=3, detections=wrong, **TIMES))


def test_a_cut_gets_an_error_for_invalid_detections_and_the_best_boxes_are_sent() -> None:
    with pytest.raises(CutError, match="score"):
        ClientDetections("front/rgb", 0, (4, 3), [Seen("person", (0, 0, 1, 1), math.nan)]).as_map()
    inside_out, no_box = Seen("person", (5, 0, 1, 1), 0.5), Seen("person", (5, 0, 7), 0.5)  # type: ignore[arg-type]
    too_sure, behind = Seen("person", (0, 0, 1, 1), 1.5), Seen("person", (0, 0, 1, 1), 0.5, -2.0)
    for wrong in (["a box"], [inside_out], [no_box], [too_sure], [behind], [Seen("person", None, 0.5)], 7):  # type: ignore[arg-type]
        with pytest.raises(CutError, match="detections"):
            ClientDetections("front/rgb", 0, (4, 3), wrong).as_map()  # type: ignore[arg-type]
    with pytest.raises(CutError, match="detections"):
        ClientDetections("front/rgb", 0, 7).as_map()  # type: ignore[arg-type]
    many = [Seen("person", (0.0, 0.0, 1.0, 1.0), i / 400) for i in range(400)]
    kept = detections_from_map(ClientDetections("front/rgb", 0, (4, 3), many).as_map()).boxes
    assert [box.score for box in kept] == [i / 400 for i in range(399, 271, -1)]


def test_official_readers_see_the_boxes(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=4_000_000)
    recorder.detected(12_000_000, "detect", SEEN)
    recorder.detected(16_000_000, "detect", Detections("front/rgb", 16_000_000, (320, 240)))
    digest = recorder.digest
    recorder.close("PASS")
    with open(tmp_path / "run.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        read = [(c.topic, m.log_time, ros) for _, c, m, ros in reader.iter_decoded_messages()]
    boxes = [(t, ros) for topic, t, ros in read if topic == "/companion/detect/boxes"]
    assert [t for t, _ in boxes] == [12_000_000, 16_000_000]
    person, car = boxes[0][1].detections
    assert (person.bbox.center.position.x, person.bbox.center.position.y) == (20.25, 40.0)
    assert (person.bbox.size_x, person.bbox.size_y) == (20.5, 40.0)
    result = person.results[0]
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("person", 0.75)
    assert result.pose.pose.position.y == 4.0
    assert person.header.frame_id == "world"
    assert math.isnan(car.results[0].pose.pose.position.x)
    assert boxes[1][1].detections == []
    whole = next(ros for topic, _, ros in read if topic == "/companion/detect/detections")
    assert (whole.width, whole.height, whole.topic) == (320, 240, "front/rgb")
    assert (whole.detections[0].range_m, whole.detections[0].radial_speed_mps) == (12.5, -1.25)
    assert (whole.objects[0].number, whole.objects[0].sightings, whole.objects[0].velocity.x) == (3, 7, 0.5)
    overlay = next(ros for topic, _, ros in read if topic == "/companion/detect/overlay")
    corners = [(p.x, p.y) for p in overlay.points[0].points]
    assert corners == [(10.0, 20.0), (30.5, 20.0), (30.5, 60.0), (10.0, 60.0)]
    assert (overlay.points[0].type, overlay.texts[1].text) == (2, "vehicle 0.50")
    quiet = Recorder(tmp_path / "quiet", mcap=False, tlog=False, tick_ns=4_000_000)
    assert quiet.digest == digest  # detections are not part of the digest


def test_the_page_gets_boxes_of_the_pictures_it_shows() -> None:
    assert boxes_of({"front/rgb": SEEN}, ["lidar/points"]) == {}
    shown = boxes_of({"front/rgb": SEEN}, ["front/rgb"])["front/rgb"]
    assert shown["boxes"][0] == [10 / 320, 20 / 240, 30.5 / 320, 60 / 240, "person 0.75, 12.5 m, -1.2 m/s"]
    assert shown["boxes"][1][4] == "vehicle 0.50"
