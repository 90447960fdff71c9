"""Pictures, point clouds and IMU samples reach a DDS of another maker (eProsima Fast DDS) without loss, bit for bit.

Needs Fast DDS with its headers and a compiler: `apt-get install g++ libfastrtps-dev`. Ten minutes in real time:

    HIL_ROS2_SECONDS=600 .venv/bin/pytest -s --timeout 1200 tests/e2e/ros2/test_fast_dds.py -k real_time
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import zlib
from pathlib import Path
from typing import NamedTuple

import pytest
from mcap.reader import make_reader

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.parts.links.ros2.dds_ports import free_domain
from hil.run.recorder.mcap.cdr import decode
from tests.worlds.patience import PATIENCE_S

pytest.importorskip("cyclonedds", reason="needs CycloneDDS: pip install 'hil-bench[ros2]'")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        shutil.which("g++") is None or not Path("/usr/include/fastdds").is_dir(),
        reason="needs Fast DDS: apt-get install g++ libfastrtps-dev",
    ),
]

TOPICS = {"/imu": "Imu", "/front/rgb": "Image", "/lidar": "PointCloud2"}
RATES_HZ = {"/imu": 250, "/front/rgb": 30, "/lidar": 10}
BENCH = """
scene: airfield
mission: null
duration_s: {seconds}
pace: {pace}
autopilot: {{transport: loopback}}
sensors:
  imu: {{preset: icm20689}}
  gps: {{preset: here_plus, rate_hz: 10}}
  baro: {{preset: ms5611, rate_hz: 50}}
  mag: {{preset: ist8310, rate_hz: 50}}
  front: {{kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 30, channels: [rgb]}}
  lidar: {{preset: vlp16, rate_hz: 10}}
record: {{mcap: true, images: {images}, tlog: false, report: false}}
ros2: {{domain: {domain}, topics: [/imu, /front/rgb, /lidar, /clock], {more}}}
"""


class Tally(NamedTuple):
    """Messages of one topic as the listener has counted them."""

    messages: int
    gaps: int
    first_ns: int
    last_ns: int
    least_step_ns: int
    most_step_ns: int
    crc_sum: int
    foreign: int


def compiled(folder: Path, name: str) -> Path:
    """Compile a program of this folder."""
    program = folder / name
    source = Path(__file__).with_name(f"{name}.cpp")
    command = ["g++", "-O2", "-std=c++17", "-o", str(program), str(source), "-lfastrtps", "-lfastcdr"]
    subprocess.run(command, check=True, capture_output=True)
    return program


@pytest.fixture(scope="module")
def listener(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("listener"), "listener")


def unused_domain() -> int:
    """Return a domain in which this machine has no participant."""
    domain = free_domain(range(60, 100))
    assert domain is not None
    return domain


def listen(
    listener: Path, tmp_path: Path, *options: str, best_effort: bool = False, **settings: object
) -> tuple[RunResult, dict[str, Tally]]:
    """Fly with a listener. Return the run and the listener's tallies."""
    domain = unused_domain()
    suffix = "=best_effort" if best_effort else ""
    topics = [f"{name}=sensor_msgs::msg::dds_::{kind}_{suffix}" for name, kind in TOPICS.items()]
    path = tmp_path / "bench.yaml"
    path.write_text(BENCH.format(domain=domain, **settings))
    with subprocess.Popen(
        [str(listener), str(domain), "3", *options, *topics], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            result = run_bench(load_bench(path), tmp_path / "run", quiet=True)
            assert result.run["error"] is None, result.run["error"]
            output, _ = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    rows = [line.split() for line in output.splitlines() if line.startswith("/")]
    tallies = {name: Tally(*map(int, rest)) for name, *rest in rows}
    for name, tally in tallies.items():
        print(name, tally)
    print(result.run.get("ros2"))
    return result, tallies


def recorded_crcs(path: Path) -> dict[str, tuple[int, int]]:
    """Return number of messages, and sum of the CRC-32 of the messages as they are sent, padded to 4 bytes."""
    found = dict.fromkeys(TOPICS, (0, 0))
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=list(TOPICS)):
            count, total = found[channel.topic]
            data = message.data + bytes(-len(message.data) % 4)
            found[channel.topic] = count + 1, total + zlib.crc32(data)
    return found


def test_fast_dds_receives_the_recorded_bytes(listener: Path, tmp_path: Path) -> None:
    wait_for = "wait_for: [/imu, /front/rgb, /lidar], wait_timeout_s: 60"
    result, tallies = listen(listener, tmp_path, seconds=3, pace="null", images="true", more=wait_for)
    assert result.run["error"] is None
    recorded = recorded_crcs(tmp_path / "run" / "run.mcap")
    for name, rate_hz in RATES_HZ.items():
        tally = tallies[name]
        assert (tally.messages, tally.gaps, tally.foreign) == (3 * rate_hz, 0, 0)
        assert (tally.messages, tally.crc_sum) == recorded[name]
    assert result.run["deterministic"]


def test_a_slow_subscriber_gets_every_picture(listener: Path, tmp_path: Path) -> None:
    """It keeps all messages, as a node with the history KEEP_ALL does, and takes 40 ms for each."""
    wait_for = "wait_for: [/imu, /front/rgb, /lidar], wait_timeout_s: 60"
    result, tallies = listen(
        listener, tmp_path, "--slow_ms", "40", seconds=0.4, pace="null", images="false", more=wait_for
    )
    assert result.run["error"] is None
    assert {name: tally.messages for name, tally in tallies.items()} == {"/imu": 100, "/front/rgb": 12, "/lidar": 4}


def test_nothing_is_lost_in_real_time(listener: Path, tmp_path: Path) -> None:
    seconds = int(os.environ.get("HIL_ROS2_SECONDS", "10"))
    measured = "HIL_ROS2_SECONDS" in os.environ  # on a quiet machine
    wait = "wait_for: [], wait_timeout_s: 60"
    result, tallies = listen(listener, tmp_path, seconds=seconds, pace=1, images="false", more=wait)
    assert result.run["error"] is None
    for name, rate_hz in RATES_HZ.items():
        tally = tallies[name]
        assert tally.gaps == 0, name
        # Discovery takes part of the first seconds; from then on every message comes.
        assert tally.messages >= (seconds - 3) * rate_hz
        sweep_s = 0.1 if name == "/lidar" else 0.0  # a cloud has the stamp of its sweep's begin
        assert tally.last_ns >= (seconds - 0.11 - sweep_s) * 1e9
        # Two clouds have the stamp 0: the first sweep began before the run.
        steps = {"/imu": (4, 4), "/front/rgb": (32, 36), "/lidar": (0, 100)}[name]
        assert (tally.least_step_ns, tally.most_step_ns) == (steps[0] * 10**6, steps[1] * 10**6)
    assert not measured or result.run["ros2"]["tick_us"]["mean"] <= 60.0


def test_a_subscriber_that_is_killed_while_it_is_waited_for_ends_the_run(listener: Path, tmp_path: Path) -> None:
    domain = unused_domain()
    path = tmp_path / "bench.yaml"
    more = "wait_for: [/imu], wait_timeout_s: 10"
    path.write_text(BENCH.format(domain=domain, seconds=60, pace="null", images="false", more=more))
    with subprocess.Popen(
        [str(listener), str(domain), "60", "/imu=sensor_msgs::msg::dds_::Imu_"], stdout=subprocess.PIPE, text=True
    ) as process:
        command = [sys.executable, "-m", "hil.cli.entry", "run", str(path), "--out", str(tmp_path / "run")]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as bench:
            assert process.stdout is not None
            # "ready" is too early: the bench may not yet have discovered what has discovered it.
            assert [process.stdout.readline() for _ in range(2)] == ["ready\n", "receiving\n"]
            process.send_signal(signal.SIGKILL)
            output, _ = bench.communicate(timeout=PATIENCE_S)
    assert bench.returncode == 3
    assert "the subscriber of /imu" in output


def test_a_teleop_with_plain_twists_flies_the_vehicle(tmp_path: Path) -> None:
    domain = unused_domain()
    path = tmp_path / "bench.yaml"
    path.write_text(BENCH.format(domain=domain, seconds=20, pace=1, images="false", more="control: true"))
    with subprocess.Popen([str(compiled(tmp_path, "teleop")), str(domain), "8"]) as teleop:
        try:
            result = run_bench(load_bench(path), tmp_path / "run", quiet=True)
        finally:
            teleop.kill()
    assert result.run["error"] is None
    assert result.run["ros2"]["set_points"] > 100
    with open(tmp_path / "run" / "run.mcap", "rb") as file:
        last = [message.data for _, _, message in make_reader(file).iter_messages(topics=["/truth/pose"])][-1]
    pose = decode("geometry_msgs/PoseStamped", last)
    assert pose["pose.position.z"] > 1.0
    assert pose["pose.position.x"] > 1.0  # the vehicle looks east
    assert abs(pose["pose.position.y"]) < 1.0
