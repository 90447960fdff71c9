"""`hil bench ros2`: cost of a ROS 2 node with subscribers for the run, and its effect on the run.

A flight with a camera at 30 Hz, a LiDAR at 10 Hz and an IMU at 250 Hz is made in turns alone and with subscribers of
all three in a process of their own, as fast as it goes and in real time. In the table, the error is the share of those
flights whose digest differs from that of the flight alone; the time is the processor time that a tick costs more in the
run's own thread, 0 for the flight alone. `tests/e2e/ros2` shows that nothing is lost on the way.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.parts.links.ros2.dds_ports import free_domain
from signals.errors import ConfigError, HilError

TITLE = "ROS 2: cost of a node with subscribers for the run"
_TYPES = {"/imu": "sensor_msgs/Imu", "/front/rgb": "sensor_msgs/Image", "/lidar": "sensor_msgs/PointCloud2"}
_RATES_HZ = {"/imu": 250, "/front/rgb": 30, "/lidar": 10}
_SETTINGS = [
    "scene=airfield",
    "autopilot.transport=loopback",
    "record={mcap: true, images: false, tlog: false, report: false}",
    "sensors.front={kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 30, channels: [rgb]}",
    "sensors.lidar={preset: vlp16, rate_hz: 10}",
]
_PACES = {"as fast as it goes": "null", "in real time": "1"}
_START_S = 60.0


def missing() -> str:
    """Return why this machine cannot run the benchmark, "" if it can."""
    return "" if find_spec("cyclonedds") else "needs the package cyclonedds: pip install 'hil-bench[ros2]'"


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Fly with and without subscribers. Raises HilError if a flight fails, ConfigError without cyclonedds."""
    if missing():
        raise ConfigError.at("hil bench ros2", missing())
    result = BenchmarkResult(time_label="cost of a tick [s]")
    rounds, seconds = (1, 8) if quick else (3, 30)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        status("alone")
        alone = _fly(folder / "alone", [f"duration_s={seconds}"])
        result.rows.append(Row("camera, LiDAR and IMU", "alone", 0.0, "digests that differ", 0.0))
        for method, pace in _PACES.items():
            costs_us, differing, least_share = [], 0, 1.0
            for k in range(rounds):
                status(f"{method}, flight {k + 1} of {rounds}")
                run = _fly_followed(folder / "followed", [f"duration_s={seconds}", f"pace={pace}"])
                costs_us.append(run["ros2"]["tick_us"]["mean"])
                differing += run["digest"] != alone["digest"]
                sent = run["ros2"]["topics"]
                least_share = min(least_share, *(sent[topic] / (rate * seconds) for topic, rate in _RATES_HZ.items()))
            cost_us = min(costs_us)  # other load on the machine can only add to it
            result.rows.append(
                Row(
                    "camera, LiDAR and IMU",
                    method,
                    differing / rounds,
                    "digests that differ",
                    1e-6 * cost_us,
                    {"tick_us": costs_us},
                )
            )
            result.checks += [
                Check(f"cost of a tick, {method}", cost_us, "<=", 60.0, "us", "speed"),
                Check(f"different digests, {method}", differing, "<=", 0, "digests"),
                Check(f"share of the samples sent, {method}", least_share, ">=", 0.99, ""),
            ]
    if quick:
        result.left_out.append("22 of 30 s of each flight, two of three flights")
    return result


def _fly(folder: Path, settings: list[str]) -> dict[str, Any]:
    return run_bench(load_bench(settings=[*_SETTINGS, *settings]), folder, quiet=True).flown()


def _fly_followed(folder: Path, settings: list[str]) -> dict[str, Any]:
    """Fly with subscribers; return run.json."""
    context = multiprocessing.get_context("spawn")
    domain = free_domain(range(100, 200))
    if domain is None:
        raise HilError("every DDS domain from 100 to 199 is in use on this machine")
    ready, over = context.Event(), context.Event()
    subscriber = context.Process(target=subscribe, args=(domain, ready, over), daemon=True)
    subscriber.start()
    try:
        if not ready.wait(_START_S):
            raise HilError(f"the subscribers did not start within {_START_S:g} s")
        return _fly(folder, [*settings, f"ros2.domain={domain}", f"ros2.topics=[{', '.join(_TYPES)}]"])
    finally:
        over.set()
        subscriber.join()


def subscribe(domain: int, ready: Any, over: Any) -> None:
    """Subscribe to all three topics until the flight is over. The readers keep the newest messages."""
    from hil.run.parts.links.ros2.node import Node

    node = Node(domain, "lo", name="listener")
    for topic, type_name in _TYPES.items():
        node.subscription(topic, type_name)
    node.announce()
    ready.set()
    over.wait()
    node.close()
