"""The shipped bench of two vehicles over a street: the watcher sees the courier with camera, LiDAR and radar."""

from __future__ import annotations

from bisect import bisect_left
from pathlib import Path

import numpy as np
import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import read_messages
from sim.radar.processing.parameters import TrackerParameters
from sim.world_loader import load_world

pytestmark = pytest.mark.slow
BENCH = Path(__file__).resolve().parents[2] / "rigs" / "delivery_pair.yaml"
REACH_M = 0.6  # of the courier's bodies from its centre
# At the edge of the radar's view the courier's echoes are too weak for a new track.
BIRTH_SNR_DB = TrackerParameters().birth_snr_db
CONFIRMED_NS = (TrackerParameters().confirm_frames - 1) * 100_000_000  # at 10 frames a second


def vector(message, path: str, names: str = "xyz") -> np.ndarray:
    return np.array([message[f"{path}.{name}"] for name in names])


def distance_m(courier_W: np.ndarray, sensor: dict[str, np.ndarray]) -> float:
    return float(np.linalg.norm(courier_W - sensor["radar"]))


def records(message) -> dict[str, np.ndarray]:
    """The fields of a PointCloud2 by name."""
    kinds = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
    count = sum(key.endswith("].name") for key in message)
    names = [message[f"fields[{i}].name"] for i in range(count)]
    formats = [kinds[message[f"fields[{i}].datatype"]] for i in range(count)]
    offsets = [message[f"fields[{i}].offset"] for i in range(count)]
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": message["point_step"]})
    points = np.frombuffer(message["data"], dtype)
    return {name: points[name] for name in names}


def test_the_watcher_sees_the_courier_with_every_sensor(tmp_path):
    bench = load_bench(BENCH, settings=["autopilot.transport=loopback", "record.report=false", "duration_s=31"])
    run_bench(bench, tmp_path, quiet=True)
    drone = load_world(bench.scene).class_names.index("drone")
    times, places = [], []
    sensor: dict[str, np.ndarray] = {}
    seen, lidar_m, radar_m = [], [], []
    strong_ns = None  # from then on a track may be born
    for message in read_messages(tmp_path / "run.mcap"):
        topic, t_ns = message.topic, message.log_time_ns
        if topic == "/courier/truth/pose":
            times.append(t_ns)
            places.append(vector(message.decode(), "pose.position"))
        elif topic == "/watcher/radar/pose":
            sensor["radar"] = vector(message.decode(), "pose.position")
        elif topic == "/watcher/front/segmentation":
            pixels = np.frombuffer(message.decode()["data"], np.uint8)
            seen.append(int((pixels == drone).sum()))
        elif topic == "/watcher/radar/points" and "radar" in sensor and strong_ns is None:
            points = records(message.decode())
            near = np.abs(points["range_m"] - distance_m(places[bisect_left(times, t_ns) - 1], sensor)) < REACH_M
            if t_ns > 25_000_000_000 and (points["snr_db"][near] >= BIRTH_SNR_DB).any():
                strong_ns = t_ns
        elif topic == "/watcher/radar/tracks" and strong_ns is not None and t_ns - strong_ns > CONFIRMED_NS:
            tracks = records(message.decode())
            if t_ns < 28_000_000_000:
                assert len(tracks["x"])
                ranges_m = np.sqrt(tracks["x"] ** 2 + tracks["y"] ** 2 + tracks["z"] ** 2)
                true_m = distance_m(places[bisect_left(times, t_ns) - 1], sensor)
                radar_m.append(float(np.abs(ranges_m - true_m).min()))
        elif topic == "/watcher/lidar":
            points = records(message.decode())
            lidar_m.append(int((points["label"] == drone).sum()))
    assert sum(pixels >= 20 for pixels in seen) >= 20
    assert sum(points >= 1 for points in lidar_m) >= 10
    assert strong_ns is not None
    assert strong_ns < 26_000_000_000
    assert len(radar_m) >= 10
    assert max(radar_m) < REACH_M
    assert np.median(radar_m) < 0.1
