"""`hil run --print-command`: the line that starts a SITL by hand, and its defaults file."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware_bridge.autopilots.px4.px4_sitl import airframe_and_params
from hil.run.autopilot import installation_of, start_command
from signals.errors import ConfigError, RecordingError
from tests.worlds.bench_files import elsewhere, load

__all__ = ["elsewhere"]
RIG = "rig: ardupilot_sitl\n"


def options(line: str) -> dict[str, str]:
    words = shlex.split(line)
    first = next(i for i, word in enumerate(words) if word.startswith("--"))
    return dict(zip(words[first::2], words[first + 1 :: 2], strict=True))


def test_ardupilot_gets_home_defaults_and_ports(tmp_path: Path) -> None:
    bench = load(RIG + "autopilot: {start: false}\nstart: {p_W: [100.0, 0.0, 0.0], yaw_deg: 30}\n")
    line = start_command(bench, tmp_path / "a folder")
    assert line.startswith("arducopter -w --model JSON:127.0.0.1 ")
    pairs = options(line)
    latitude, longitude, altitude, heading = map(float, pairs["--home"].split(","))
    assert latitude == pytest.approx(47.397742, abs=1e-6)
    assert (longitude - 8.545594) * 111_320.0 * 0.677 == pytest.approx(100.0, rel=0.01)
    assert altitude == pytest.approx(488.0 + bench.vehicle.standing_height_m, abs=0.01)
    assert heading == pytest.approx(60.0, abs=1e-3)
    assert "--serial0" not in pairs  # it listens on TCP 5760, where the bench connects
    text = Path(pairs["--defaults"]).read_text()
    assert Path(pairs["--defaults"]) == (tmp_path / "a folder" / "bench.parm").resolve()
    for name in ("FRAME_CLASS 1", "WPNAV_RADIUS 50", "SIM_RATE_HZ 400", "SCHED_LOOP_RATE 200", "MOT_THST_HOVER 0.6"):
        assert f"\n{name}" in text


def test_ardupilot_uses_the_range_finder_of_the_bench(tmp_path: Path) -> None:
    text = RIG + "autopilot: {start: false}\nmission: null\nsensors: {imu: {preset: icm20689}"
    for sensors, used in ((", down: {preset: tfmini, rate_hz: 50}}\n", True), ("}\n", False)):
        start_command(load(text + sensors), tmp_path)
        lines = (tmp_path / "bench.parm").read_text().splitlines()
        told = ("RNGFND1_TYPE 100.0", "RNGFND1_ORIENT 25.0", "RNGFND1_MIN 0.3", "RNGFND1_MAX 12.0")
        assert [line in lines for line in told] == [used] * 4


def test_ardupilot_is_told_where_the_range_finder_looks(tmp_path: Path) -> None:
    sensors = RIG + "autopilot: {start: false}\nmission: null\nsensors:\n  imu: {preset: icm20689}\n  eye: "
    start_command(load(sensors + "{preset: tfmini, rate_hz: 50, mount_rpy_deg: [0, 0, -90]}\n"), tmp_path)
    # MAV_SENSOR_ROTATION_YAW_90: to the right
    assert "RNGFND1_ORIENT 2.0" in (tmp_path / "bench.parm").read_text().splitlines()
    tilted = "{preset: tfmini, rate_hz: 50, mount_rpy_deg: [0, 60, 0]"
    with pytest.raises(ConfigError, match=r"sensors\.eye\.mount_rpy_deg cannot be \[0.0, 60.0, 0.0\].*RNGFND1_ORIENT"):
        load(sensors + tilted + "}\n")
    load(sensors + tilted + ", autopilot: false}\n")
    load(sensors.replace(RIG, "rig: px4_sitl\n") + tilted + "}\n")  # DISTANCE_SENSOR says any direction


def test_ardupilot_with_another_port_instance_and_build(tmp_path: Path) -> None:
    keys = "{start: false, instance: 3, mavlink_port: 'udp:14999', binary: /opt/copter}"
    line = start_command(load(RIG + f"autopilot: {keys}\n"), tmp_path)
    assert line.startswith("/opt/copter -w ")
    pairs = options(line)
    assert pairs["--instance"] == "3"
    assert pairs["--serial0"] == "udpclient:127.0.0.1:14999"
    assert pairs["--serial2"] == "none"


def test_px4(tmp_path: Path) -> None:
    sensors = "sensors: {imu: {preset: icm20689}, gps: null, baro: null, mag: null}\n"
    bench = load("rig: px4_sitl\ntick_hz: 500\nautopilot: {start: false, instance: 2}\n" + sensors)
    line = start_command(bench, tmp_path)
    assert line == "PX4_SIM_MODEL=none_iris PX4_PARAM_IMU_INTEG_RATE=500 PX4_PARAM_SDLOG_MODE=-1 px4 -i 2 -d etc"
    assert not list(tmp_path.glob("bench.parm"))


def told_delays(tmp_path: Path, more: str) -> dict[str, str]:
    """Return the parameters of delays of a bench with a GPS and `more` sensors and settings."""
    text = "rig: px4_sitl\nsensors:\n  gps: {preset: f9p}\n  baro: null\n  mag: null\n"
    words = start_command(load(text + more), tmp_path).split()
    return dict(word.removeprefix("PX4_PARAM_").split("=") for word in words if "_DELAY" in word)


def gps_delay(ms: str) -> dict[str, str]:
    """Return the delay of the GPS under the names of all versions of PX4."""
    names = ("EKF2_GPS_DELAY", "SENS_GPS0_DELAY", "SENS_GPS1_DELAY", "SENS_GNSS0_DELAY", "SENS_GNSS1_DELAY")
    return dict.fromkeys(names, ms)


def test_px4_is_told_how_old_the_samples_of_the_sensors_are(tmp_path: Path) -> None:
    assert told_delays(tmp_path, "autopilot: {start: false}\n") == gps_delay("80")
    more = "  eye: {preset: tfmini, rate_hz: 50}\n  flow: {preset: pmw3901, rate_hz: 50}\n"
    more += "  vision: {kind: external_vision, rate_hz: 30, latency_s: 0.045}\n"
    assert told_delays(tmp_path, more + "autopilot: {start: false}\n") == gps_delay("80") | {
        "EKF2_RNG_DELAY": "10",
        "EKF2_OF_DELAY": "10",
        "EKF2_EV_DELAY": "45",
    }
    own = "autopilot: {start: false, airframe: iris}\n"
    assert told_delays(tmp_path, own) == gps_delay("80")  # the sensors are the bench's, whatever the airframe
    mast = "  mast: {preset: m8n, rate_hz: 5, autopilot: false}\n"
    assert told_delays(tmp_path, mast + own) == gps_delay("80")


def test_px4_looks_back_as_far_as_its_slowest_sensor_needs(tmp_path: Path) -> None:
    def horizon(latency_s: float) -> str | None:
        vision = f"  vision: {{kind: external_vision, rate_hz: 30, latency_s: {latency_s}}}\n"
        told = told_delays(tmp_path, vision + "autopilot: {start: false}\n")
        assert told["EKF2_EV_DELAY"] == f"{1e3 * latency_s:g}"
        return told.get("EKF2_DELAY_MAX")

    assert horizon(0.144) is None  # PX4's default of 200 ms is enough
    assert horizon(0.148) == "205"
    assert horizon(0.25) == "332.5"


def test_parameters_of_the_bench_go_over_those_of_its_sensors() -> None:
    bench = load("rig: px4_sitl\nautopilot: {start: false}\n")
    of_sensors = installation_of(bench, np.zeros(13))
    settings = of_sensors.settings.model_copy(update={"params": {"EKF2_GPS_DELAY": 110.0}})
    assert airframe_and_params(of_sensors)[1]["EKF2_GPS_DELAY"] == 100.0
    assert airframe_and_params(replace(of_sensors, settings=settings))[1]["EKF2_GPS_DELAY"] == 110.0


def test_others_and_a_folder_that_cannot_be_written_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--print-command: only works with a SITL, which the autopilot 'mock' is not"):
        start_command(load("rig: mock\n"), tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"bench\.parm: cannot be written"):
        start_command(load(RIG + "autopilot: {start: false}\n"), tmp_path / "file")
