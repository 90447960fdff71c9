"""A detector in the loop: its detections are recorded and judged, live and from the trace alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run_files import TRACE_NAME
from tests.worlds.hop_flights import ROOT

BENCH = """
rig: mock
tick_hz: 100
scene: radar_range
mission: {mission}
duration_s: 16
autopilot: {{transport: loopback}}
record: {{report: false, tlog: false}}
search: {{camera: front, visible_px: 30, max_error_m: 1.0, max_worst_error_m: 1.0, max_false: 0, max_doubles: 0}}
companion:
  start: ["tests.worlds.detector_stand_in:StandIn"]
  rate_hz: 5
  port: 0
  settings: {{depth: front/depth, radar: radar/points}}
sensors:
  imu: {{preset: icm20689}}
  gps: {{preset: here_plus, rate_hz: 10}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag: {{preset: ist8310, rate_hz: 50}}
  front: {{preset: camera_320x240, rate_hz: 5, channels: [rgb, depth, segmentation, instance]}}
  radar: {{preset: bgt60tr13c, frame: front, rate_hz: 5, outputs: [points]}}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("detect")
    path = folder / "bench.yaml"
    path.write_text(BENCH.format(mission=ROOT / "rigs" / "missions" / "radar_hover.plan"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        return run_bench(load_bench(path), folder / "run", quiet=True)


def boxes(out: Path) -> list[tuple[int, bytes, Any]]:
    with open(out / "run.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = ["/companion/StandIn/detections"]
        return [(m.log_time, m.data, ros) for _, _, m, ros in reader.iter_decoded_messages(topics=topics)]


def test_a_walking_person_is_detected_located_and_recorded(flown: RunResult) -> None:
    run = flown.run
    assert run["error"] is None, run["error"]
    search = run["search"]
    assert (search["client"], search["visible"], search["found"], search["false_objects"]) == ("StandIn", 1, 1, 0)
    judged = {row["name"]: row for row in run["verdict"]["rows"] if row["limit"] is not None}
    for name in ("found_share", "search_error_m", "worst_search_error_m", "false_objects", "double_objects"):
        assert judged[name]["ok"], judged[name]
    seen = boxes(flown.out)
    assert len(seen) == 80
    with_box = [ros.detections[0] for _, _, ros in seen if ros.detections]
    assert len(with_box) > 20
    assert all(d.label == "person" and 0.5 < d.range_m < 9.0 for d in with_box)
    speeds = [abs(d.radial_speed_mps) for d in with_box if d.radial_speed_mps == d.radial_speed_mps]
    assert speeds
    assert max(speeds) < 4.0
    assert (flown.out / "people.json").is_file()
    left = flown.out / "companion_StandIn"
    assert (left / "detections.jsonl").is_file()
    assert (left / "report.png").is_file()


def test_the_trace_brings_the_same_boxes_and_the_same_judgement(flown: RunResult, tmp_path: Path) -> None:
    trace = f"companion.trace={flown.out / TRACE_NAME}"
    again = run_bench(load_bench(flown.out / "bench.yaml", settings=[trace]), tmp_path / "again", quiet=True)
    assert again.run["error"] is None, again.run["error"]
    assert again.run["digest"] == flown.run["digest"]
    assert again.run["search"] == flown.run["search"]
    assert [row[:2] for row in boxes(again.out)] == [row[:2] for row in boxes(flown.out)]  # byte by byte
