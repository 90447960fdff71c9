"""Faults and gusts written into a bench file happen at their simulated time, are recorded, and change the flight."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import RunResult
from hil.run.recorder.reading import read_messages
from signals.errors import ConfigError
from tests.unit.hil.config.missions.test_missions_script import events
from tests.worlds.bench_files import flown

BENCH = """
rig: mock
tick_hz: 100
mission: {mission}
duration_s: {seconds}
autopilot: {{transport: loopback}}
record: {{report: false, tlog: false}}
{what}
"""
MISSION = Path(__file__).resolve().parents[2] / "rigs/missions/rectangle.plan"


def fly(tmp_path: Path, what: str, *, seconds: int) -> RunResult:
    return flown(tmp_path, BENCH.format(mission=MISSION, what=what, seconds=seconds))


def test_a_lost_rotor_is_recorded_and_brings_the_vehicle_down(tmp_path: Path) -> None:
    result = fly(tmp_path, "faults: {rotors: [{kind: stuck, rotor: 0, at_s: 20.001}]}", seconds=23)
    assert (pytest.approx(20.01), "rotor 0: stuck at 0 rad/s") in events(result)  # the first tick at or after
    assert result.status in ("FAIL", "ERROR")
    assert result.run["mission"]["completed"] is False
    heights = [
        m.decode()["pose.position.z"] for m in read_messages(result.out / "run.mcap") if m.topic == "/truth/pose"
    ]
    assert heights[20 * 100] > 8.0
    assert min(heights[20 * 100 :]) < 2.0
    assert any(reason.startswith("crashed: impact at ") for reason in result.run["verdict"]["reasons"])


@pytest.mark.slow
def test_a_hexarotor_lands_with_five_rotors(tmp_path: Path) -> None:
    """The rotor stops at the height of the mission, 10 m; the autopilot is not told."""
    what = "vehicle: hexa_x\nfaults: {rotors: [{kind: stuck, rotor: 2, at_s: 45}]}\nlimits: {altitude_error_m: null}"
    result = fly(tmp_path, what, seconds=150)
    assert (pytest.approx(45.0), "rotor 2: stuck at 0 rad/s") in events(result)
    assert result.status == "PASS", result.run["verdict"]
    assert result.run["mission"]["landing_speed_mps"] < 1.0
    assert result.run["mission"]["landed_tilt_deg"] < 10.0


def test_a_gust_front_is_recorded_and_changes_the_flight(tmp_path: Path) -> None:
    calm = fly(tmp_path, "wind: {steady_W_mps: [0, 0, 0]}", seconds=28)
    gust = "{at_s: 22, velocity_W_mps: [0, 8, 0], rise_s: 0.5, hold_s: 4, fall_s: 0.5}"
    gusty = fly(tmp_path, f"wind: {{gusts: [{gust}]}}", seconds=28)
    told = [text for t, text in events(gusty) if t == pytest.approx(22.0)]
    assert told == ["gust of (0, 8, 0) m/s (east, north, up) rises for 0.5 s, over at 27 s"]
    assert (pytest.approx(27.0), "gust is over") in events(gusty)
    assert gusty.run["mission"]["max_cross_track_m"] > 1.5 * calm.run["mission"]["max_cross_track_m"]
    assert gusty.run["digest"] != calm.run["digest"]


def test_sensor_faults_are_recorded_and_change_the_flight(tmp_path: Path) -> None:
    what = """
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  lidar: {preset: tfmini, rate_hz: 50}
  flow: {preset: px4flow, rate_hz: 20}
faults:
  sensors:
    - {kind: dropout, sensor: gps, at_s: 8, until_s: 10}
    - {kind: offset, sensor: imu, field: gyro_radps, axis: x, at_s: 11, until_s: 12, value: 0.02}
"""
    result = fly(tmp_path, what, seconds=13)
    told = events(result)
    for t, text in (
        (8.0, "gps: dropout began"),
        (10.0, "gps: dropout ended"),
        (11.0, "imu: offset began"),
        (12.0, "imu: offset ended"),
    ):
        assert (pytest.approx(t), text) in told
    counts: dict[str, int] = {}
    silent = []
    for m in read_messages(result.out / "run.mcap"):
        counts[m.topic] = counts.get(m.topic, 0) + 1
        if m.topic == "/gps" and 8.12 < m.log_time_ns * 1e-9 < 10.0:
            silent.append(m.log_time_ns)
    assert silent == []
    assert counts["/gps"] == pytest.approx(110, abs=3)
    assert counts["/lidar"] == 650
    assert counts["/flow"] == 260
    assert result.run["error"] is None


def test_impossible_faults_are_reported_with_their_line(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(
        "rig: mock\n"
        "vehicle: iris\n"
        "physics:\n"
        "  effects: {battery: true}\n"
        "  step_us: 3000\n"
        "faults:\n"
        "  rotors:\n"
        "    - {kind: efficiency, rotor: 5, at_s: 1, factor: 0.5}\n"
        "  sensors:\n"
        "    - {kind: freeze, sensor: gsp, at_s: 1}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_bench(file)
    lines = str(caught.value).splitlines()
    assert len(lines) == 4, lines
    for number, words in ((4, "no battery"), (5, "must divide the tick"), (8, "names rotor 5"), (10, "'gsp'")):
        assert any(f"bench.yaml:{number}: " in line and words in line for line in lines), (number, lines)
