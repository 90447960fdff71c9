"""Flights with a companion: all that it wants in every frame, drawn, sent and answered in lockstep.

Each frame holds RGB, depth and segmentation at 320x240, a LiDAR's turn of 16x900, IMU, GPS and the true state, all new
in it: camera, LiDAR and GPS run at the 100 Hz of the frames, the IMU at the 250 Hz of the ticks. The client is `echo`
in a process of its own; the autopilot is the mock on a loopback. Frames per second are those of the flight by the wall
clock: flight, drawing, digest of every sample, link and client.

That what arrives is what was sampled is seen in a flight with `record` as the client, against the bench's own MCAP.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.companion.settings import Arrangement
from hil.bench import run_bench
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.config import load_bench
from hil.recorder.frame_series import cloud_records
from hil.recorder.reading import read_messages
from hil.recorder.reading_frames import IMAGE, capture_ns, image
from hil.recorder.recorder import MCAP_NAME
from hil.signals.errors import HilError
from hil.signals.samples import PointCloudSample

ARRANGEMENTS: tuple[Arrangement, ...] = get_args(Arrangement)
CASE = "companion, frame by frame"
_CLOUD = "sensor_msgs/PointCloud2"
_RATE_HZ = 100
_FRAMES_PER_S = 100.0  # by the wall clock, on two cores
_OVERHEAD_MS = 4.0  # p99
_BENCH = f"""scene: airfield
mission: {Path(__file__).resolve().parents[2] / "rigs" / "missions" / "rectangle.plan"}
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


def measure_flights(result: BenchmarkResult, folder: Path, say: Callable[[str], None], *, seconds: float) -> None:
    """`seconds` of simulated time in each arrangement. HilError where a flight ends as ERROR."""
    say("what a companion gets, against the recording")
    differ, compared = differing_arrays(folder, seconds=0.4)
    for arrangement in ARRANGEMENTS:
        say(f"frames to a companion, {arrangement}")
        run = _fly(folder / arrangement, arrangement, seconds, "echo", mcap=False)
        told = run["companion"]["clients"]["echo"]
        fps = told["frames"] / run["wall_s"]
        overhead = told["overhead_ms"]
        details = {
            "frames": told["frames"],
            "dropped": told["dropped"],
            "frames_per_s": fps,
            "mb_per_s": told["bytes"] / run["wall_s"] / 1e6,
            "bytes_per_frame": told["bytes"] / max(1, told["frames"]),
            "arrays_compared": compared,
            "load_average": os.getloadavg()[0],  # other work on the machine shows
            **{f"{name}_{q}": told[name][q] for name in ("t1_ms", "t2_ms", "t3_ms", "overhead_ms") for q in told[name]},
        }
        result.rows.append(Row(CASE, arrangement, differ + told["dropped"], "arrays", 1.0 / fps, details))
        result.checks += [
            Check(f"companion, {arrangement}: frames per second, drawing included", fps, ">=", _FRAMES_PER_S, "1/s"),
            Check(f"companion, {arrangement}: link overhead, p99", overhead["p99"], "<=", _OVERHEAD_MS, "ms"),
            Check(f"companion, {arrangement}: frames dropped", told["dropped"], "<=", 0, "frames"),
        ]
    result.checks.append(Check("companion: arrays that differ from the recording", differ, "<=", 0, "arrays"))


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
    bench = out / "bench.yaml"
    bench.write_text(_BENCH + f"duration_s: {seconds}\ncompanion: {json.dumps(companion)}\n", encoding="utf-8")
    run = run_bench(load_bench(bench, settings=[f"record.mcap={str(mcap).lower()}"]), out / "run", quiet=True).run
    if run["error"] is not None:
        raise HilError(f"companion, {arrangement}: {run['error']['message']}")
    return run


def differing_arrays(folder: Path, *, seconds: float, arrangement: Arrangement = "shared_memory") -> tuple[int, int]:
    """Pictures and clouds that the client did not get as the bench recorded them; and how many were compared."""
    out, got = folder / "compared", folder / "compared" / "client"
    _fly(out, arrangement, seconds, "record", mcap=True, settings={"out": str(got)})
    pictures: dict[tuple[str, int], NDArray[Any]] = {}
    clouds: dict[int, bytes] = {}
    for message in read_messages(out / "run" / MCAP_NAME):
        if message.type_name == IMAGE:
            t_ns, picture = image(message)
            pictures[message.topic.strip("/"), t_ns] = picture
        elif message.type_name == _CLOUD:
            values = message.decode()
            clouds[capture_ns(values)] = bytes(values["data"])
    differ = compared = 0
    for line in (got / "frames.jsonl").read_text(encoding="utf-8").splitlines():
        for sample in json.loads(line)["samples"]:
            t_ns = sample["t_capture_ns"]
            arrays = {name: np.load(got / file) for name, file in sample["arrays"].items()}
            if sample["topic"] == "lidar":
                compared += len(arrays)
                differ += 0 if _cloud(sample, arrays) == clouds.get(t_ns) else len(arrays)
            elif arrays:
                compared += 1
                (array,) = arrays.values()
                differ += not np.array_equal(pictures.get((sample["topic"], t_ns), np.empty(0)), array)
    if compared == 0:
        raise HilError(f"{got}: the client recorded no arrays")
    return differ, compared


def _cloud(sample: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    stamps = (sample["seq"], sample["t_capture_ns"], sample["t_available_ns"])
    pose = (sample["values"]["p_WL"], sample["values"]["q_WL"])
    in_order = (arrays[name] for name in PointCloudSample._fields if name in arrays)
    return cloud_records(PointCloudSample._make((*stamps, *pose, *in_order))).tobytes()
