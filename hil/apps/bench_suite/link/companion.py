"""Companion benchmark: flights in lockstep with a companion that receives all its sensors in every frame.

Each frame holds new samples of RGB, depth and segmentation at 320x240, a LiDAR sweep of 16x900, IMU, GPS and the true
state: camera, LiDAR and GPS run at the frames' 100 Hz, the IMU at the ticks' 250 Hz. The client is `echo` in its own
process, the autopilot is the mock over a loopback. The frame rate is per second of wall-clock time, which includes
flight, rendering, digest of every sample, link and client.

A flight with the client `record` checks that the received arrays equal those in the bench's MCAP.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.companion.settings import Arrangement
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.frame_series import cloud_records
from hil.run.recorder.reading import read_messages
from hil.run.recorder.reading_frames import IMAGE, capture_ns, image
from hil.run_files import BENCH_NAME, MCAP_NAME
from signals.errors import HilError
from signals.samples import PointCloudSample

ARRANGEMENTS: tuple[Arrangement, ...] = get_args(Arrangement)
CASE = "companion, frame by frame"
_CLOUD = "sensor_msgs/PointCloud2"
_RATE_HZ = 100
_MIN_RATE_HZ = 100.0  # by the wall clock, on two cores
_MAX_OVERHEAD_MS = 4.0  # p99
_BENCH = f"""scene: airfield
mission: {Path(__file__).resolve().parents[4] / "rigs" / "missions" / "rectangle.plan"}
autopilot: {{transport: loopback}}
record: {{tlog: false, report: false}}
sensors:
  imu: {{preset: icm20689}}
  gps: {{preset: here_plus, rate_hz: {_RATE_HZ}}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag: {{preset: ist8310, rate_hz: 50}}
  front:
    kind: camera
    resolution: [320, 240]
    fov_deg: 90
    rate_hz: {_RATE_HZ}
    channels: [rgb, depth, segmentation]
    mount_m: [0.12, 0, 0]
  lidar:
    preset: vlp16
    rate_hz: {_RATE_HZ}
    pattern: {{kind: spinning, columns: 900, firing_ns: 0, elevation_deg: {list(range(-15, 16, 2))}}}
"""


def measure_flights(result: BenchmarkResult, folder: Path, status: ShowStatus, *, seconds: float) -> None:
    """Fly `seconds` of simulated time in each arrangement. Raises HilError if a flight ends as ERROR."""
    status("received arrays, compared with the recording")
    differing, compared = differing_arrays(folder, seconds=0.4)
    for arrangement in ARRANGEMENTS:
        status(f"frames to a companion, {arrangement}")
        run = _fly(folder / arrangement, arrangement, seconds, "echo", mcap=False)
        client = run["companion"]["clients"]["echo"]
        fps = client["frames"] / run["wall_s"]
        overhead = client["overhead_ms"]
        times = ("t1_ms", "t2_ms", "t3_ms", "overhead_ms")
        details = {
            "frames": client["frames"],
            "dropped": client["dropped"],
            "frames_per_s": fps,
            "mb_per_s": client["bytes"] / run["wall_s"] / 1e6,
            "bytes_per_frame": client["bytes"] / max(1, client["frames"]),
            "arrays_compared": compared,
            "load_average": os.getloadavg()[0],  # shows other load on the machine
            **{f"{name}_{q}": client[name][q] for name in times for q in client[name]},
        }
        result.rows.append(Row(CASE, arrangement, differing + client["dropped"], "arrays", 1.0 / fps, details))
        result.checks += [
            Check(
                f"companion, {arrangement}: frames per second, rendering included",
                fps,
                ">=",
                _MIN_RATE_HZ,
                "1/s",
                "speed",
            ),
            Check(
                f"companion, {arrangement}: link overhead, p99", overhead["p99"], "<=", _MAX_OVERHEAD_MS, "ms", "speed"
            ),
            Check(f"companion, {arrangement}: frames dropped", client["dropped"], "<=", 0, "frames"),
        ]
    result.checks.append(Check("companion: arrays that differ from the recording", differing, "<=", 0, "arrays"))


def _fly(
    out: Path,
    arrangement: Arrangement,
    seconds: float,
    client: str,
    *,
    mcap: bool,
    settings: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    out.mkdir(parents=True)
    companion = {
        "start": [client],
        "rate_hz": _RATE_HZ,
        "arrangement": arrangement,
        "port": 0,
        "settings": dict(settings or {}),
    }
    bench = out / BENCH_NAME
    bench.write_text(_BENCH + f"duration_s: {seconds}\ncompanion: {json.dumps(companion)}\n", encoding="utf-8")
    run = run_bench(load_bench(bench, settings=[f"record.mcap={str(mcap).lower()}"]), out / "run", quiet=True).run
    if run["error"] is not None:
        raise HilError(f"companion, {arrangement}: {run['error']['message']}")
    return run


def differing_arrays(folder: Path, *, seconds: float) -> tuple[int, int]:
    """Return how many received pictures and clouds differ from the bench's recording, and how many were compared.

    Raises HilError if the flight ends as ERROR or the client recorded no arrays.
    """
    out, received = folder / "compared", folder / "compared" / "client"
    _fly(out, "shared_memory", seconds, "record", mcap=True, settings={"out": str(received)})
    pictures: dict[tuple[str, int], NDArray[Any]] = {}
    clouds: dict[int, tuple[int, bytes]] = {}  # by number of the sweep: when it began, and its points
    for message in read_messages(out / "run" / MCAP_NAME):
        if message.type_name == IMAGE:
            t_ns, picture = image(message)
            pictures[message.topic.strip("/"), t_ns] = picture
        elif message.type_name == _CLOUD:
            values = message.decode()
            clouds[message.sequence] = capture_ns(values), bytes(values["data"])
    differing = compared = 0
    for line in (received / "frames.jsonl").read_text(encoding="utf-8").splitlines():
        for sample in json.loads(line)["samples"]:
            t_ns = sample["t_capture_ns"]
            arrays = {name: np.load(received / file) for name, file in sample["arrays"].items()}
            if sample["topic"] == "lidar":
                compared += len(arrays)
                begin_ns, points = clouds.get(sample["seq"], (t_ns, b""))
                differing += 0 if _cloud(sample, arrays, t_ns - begin_ns) == points else len(arrays)
            elif arrays:
                compared += 1
                (array,) = arrays.values()
                differing += not np.array_equal(pictures.get((sample["topic"], t_ns), np.empty(0)), array)
    if compared == 0:
        raise HilError(f"{received}: the client recorded no arrays")
    return differing, compared


def _cloud(sample: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], sweep_ns: int) -> bytes:
    stamps = (sample["seq"], sample["t_capture_ns"], sample["t_available_ns"])
    pose = (sample["values"]["p_WL"], sample["values"]["q_WL"])
    in_order = (arrays[name] for name in PointCloudSample._fields if name in arrays)
    return cloud_records(PointCloudSample._make((*stamps, *pose, *in_order)), sweep_ns).tobytes()
