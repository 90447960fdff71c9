"""A known rotation and motion survive every format of logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.spatial.transform import Rotation

from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import LogFile, formats, read_log
from sim.physics.vehicle import load_vehicle
from tests.worlds.dataflash_file import DataFlashFile
from tests.worlds.flight_files import dataflash, ulog
from tests.worlds.flight_table import COLUMN_MAP, csv_file, table
from tests.worlds.known_motion import Motion, motion
from tests.worlds.ulog_file import ULogFile

X500 = load_vehicle("x500")
MOTION = motion(np.arange(0.0, 10.0, 0.01))


def check(log: FlightLog, *, start_s: float, angle_rad: float = 1e-6) -> None:
    """Compare every series of a log with the closed form at the log's own times."""

    def truth(series: Series | None) -> Motion:
        assert series is not None
        assert len(series) > 50
        return motion(series.t_s - start_s)

    assert log.pose is not None and log.velocity is not None and log.rate is not None  # noqa: PT018
    assert log.accel is not None and log.voltage is not None  # noqa: PT018
    np.testing.assert_allclose(log.pose.values[:, :3], truth(log.pose).p_WB, atol=2e-5)
    measured = Rotation.from_quat(log.pose.values[:, 3:], scalar_first=True)
    assert (measured.inv() * Rotation.from_matrix(truth(log.pose).R_WB)).magnitude().max() < angle_rad
    assert (np.einsum("ij,ij->i", log.pose.values[1:, 3:], log.pose.values[:-1, 3:]) > 0.9).all()
    np.testing.assert_allclose(log.velocity.values, truth(log.velocity).v_WB_W, atol=2e-6)
    np.testing.assert_allclose(log.rate.values, truth(log.rate).w_WB_B, atol=2e-6)
    np.testing.assert_allclose(log.accel.values, truth(log.accel).accel_B, atol=3e-6)
    np.testing.assert_allclose(log.motors.values, truth(log.motors).motors, atol=1e-3)
    np.testing.assert_allclose(log.voltage.values, 15.2, atol=1e-5)


def test_ulog(tmp_path: Path) -> None:
    log = read_log(LogFile(ulog(tmp_path / "a.ulg", MOTION), X500))
    check(log, start_s=5.0)
    assert log.estimated
    assert log.motors_kind == "command"


@pytest.mark.parametrize("factor", [0.3, 1.0])
def test_px4s_thrust_becomes_the_outputs_of_its_motors(tmp_path: Path, factor: float) -> None:
    log = ULogFile({"THR_MDL_FAC": factor})
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    for i, t_s in enumerate(MOTION.t_s):
        u = MOTION.motors[i]
        t = round(t_s * 1e6) + 1000
        log.add("actuator_motors", t, t, *(factor * u * u + (1.0 - factor) * u), *[float("nan")] * 8)
    read = read_log(LogFile(log.write(tmp_path / "a.ulg"), X500)).motors
    np.testing.assert_allclose(read.values, MOTION.motors, atol=1e-6)


def test_px4s_simulated_battery_is_not_the_vehicles(tmp_path: Path) -> None:
    file = LogFile(ulog(tmp_path / "a.ulg", MOTION, hardware="PX4_SITL"), X500)
    assert read_log(file).voltage is None
    assert "battery_status: is that of PX4's own simulated battery" in str(file.notes[0])


@pytest.mark.parametrize(("quaternions", "angle_rad"), [(True, 1e-6), (False, 2e-4)])  # angles are in 0.01 deg
def test_dataflash(tmp_path: Path, quaternions: bool, angle_rad: float) -> None:
    log = read_log(LogFile(dataflash(tmp_path / "a.bin", MOTION, quaternions=quaternions), X500))
    check(log, start_s=5.0, angle_rad=angle_rad)


def test_table(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(COLUMN_MAP)
    log = read_log(LogFile(csv_file(tmp_path / "a.csv", MOTION), X500, columns=tmp_path / "map.yaml"))
    check(log, start_s=0.0)


def test_positions_logged_less_often_than_attitudes(tmp_path: Path) -> None:
    log = read_log(LogFile(ulog(tmp_path / "a.ulg", MOTION, positions_every=10), X500))
    assert log.pose is not None
    assert len(log.pose) > 900  # the attitude's own times, up to the last position
    np.testing.assert_allclose(log.pose.values[:, :3], motion(log.pose.t_s - 5.0).p_WB, atol=1e-5)


def test_parquet_is_read_as_csv(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    header, values = table(MOTION)
    parquet.write_table(pyarrow.table(dict(zip(header, values.T, strict=True))), tmp_path / "a.parquet")
    (tmp_path / "map.yaml").write_text(COLUMN_MAP)
    check(read_log(LogFile(tmp_path / "a.parquet", X500, columns=tmp_path / "map.yaml")), start_s=0.0)


def test_all_formats_are_found() -> None:
    assert len(formats()) == 4


def slow_motors(path: Path, *, speeds_per_control: float) -> Path:
    """Write a log with motors at 10 Hz, and speeds of the ESCs at 100 Hz, in proportion to the commands."""
    log = ULogFile()
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    log.nested("esc_report", [("int32_t", "esc_rpm")])
    log.topic("esc_status", [("esc_report", "esc[4]")])
    for i, t_s in enumerate(MOTION.t_s):
        t, u = round(t_s * 1e6) + 1000, MOTION.motors[i]
        if i % 10 == 0:
            log.add("actuator_motors", t, t, *u, *[float("nan")] * 8)
        log.add("esc_status", t, *(round(speeds_per_control * x) for x in u))
    return log.write(path)


def test_esc_speeds_take_the_place_of_slow_outputs_if_they_lift_the_vehicle(tmp_path: Path) -> None:
    rpm = X500.rotor_constants.max_speed_radps * 30.0 / np.pi
    log = read_log(LogFile(slow_motors(tmp_path / "a.ulg", speeds_per_control=rpm), X500))
    assert log.motors_kind == "speed_radps"
    np.testing.assert_allclose(log.motors.values, 1000.0 * MOTION.motors, atol=0.1)
    file = LogFile(slow_motors(tmp_path / "b.ulg", speeds_per_control=0.4 * rpm), X500)
    assert read_log(file).motors_kind == "command"
    assert "actuator_motors: has 10 values per second" in str(file.notes[0])


def test_jumps_of_the_estimators_origin_are_taken_out(tmp_path: Path) -> None:
    """The estimate jumps by (+3, -2) m in NED at 4 s and by 1.5 m in height at 6 s; the path stays whole."""
    log = ULogFile()
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    log.topic("vehicle_attitude", [("uint64_t", "timestamp_sample"), ("float", "q[4]")])
    fields = [("float", n) for n in ("x", "y", "z", "vx", "vy", "vz", "delta_xy[2]", "delta_z")]
    counters = [("uint8_t", "xy_reset_counter"), ("uint8_t", "z_reset_counter")]
    log.topic("vehicle_local_position", [("uint64_t", "timestamp_sample"), *fields, *counters])
    p, v, q = MOTION.ned(MOTION.p_WB), MOTION.ned(MOTION.v_WB_W), MOTION.q_NF
    for i, t_s in enumerate(MOTION.t_s):
        t = round(t_s * 1e6) + 1000
        level, height = t_s >= 4.0, t_s >= 6.0
        jump = (3.0 * level, -2.0 * level, 1.5 * height)
        log.add("actuator_motors", t, t, *MOTION.motors[i], *[float("nan")] * 8)
        log.add("vehicle_attitude", t, t, *q[i])
        deltas = (3.0, -2.0, 1.5)  # PX4 keeps the last one in the message
        log.add("vehicle_local_position", t, t, *(p[i] + jump), *v[i], *deltas, int(level), int(height))
    file = LogFile(log.write(tmp_path / "a.ulg"), X500)
    pose = read_log(file).pose
    assert pose is not None
    np.testing.assert_allclose(pose.values[:, :3], motion(pose.t_s - 0.001).p_WB, atol=1e-5)
    assert "jumped 1 times, last at 4.00 s (xy_reset_counter)" in str(file.notes[0])


def mixed_dataflash(path: Path, *, limited: bool) -> tuple[Path, np.ndarray]:
    """Write outputs at 10 Hz and controllers' outputs at 100 Hz, mixed as ArduPilot does; return the true commands."""
    expo, low, high = 0.6, 0.15, 0.95
    log = DataFlashFile(
        {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "MOT_THST_EXPO": expo, "MOT_SPIN_MIN": low, "MOT_SPIN_MAX": high}
    )
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("RATE", "Qffff", "TimeUS,ROut,POut,YOut,AOut")
    t = MOTION.t_s
    controls = np.stack(
        [0.1 * np.sin(7.0 * t), 0.08 * np.sin(9.0 * t), 0.05 * np.sin(3.0 * t), 0.5 + 0.1 * np.sin(t)], 1
    )
    mixer = np.array([[-0.5, 0.5, 0.5, 1.0], [0.5, -0.5, 0.5, 1.0], [0.5, 0.5, -0.5, 1.0], [-0.5, -0.5, -0.5, 1.0]])
    thrust = controls @ mixer.T
    if limited:
        thrust = np.minimum(thrust, 0.5)
    x = (expo - 1.0 + np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * thrust)) / (2.0 * expo)
    commands = low + (high - low) * x
    for i, t_s in enumerate(t):
        t_us = round(t_s * 1e6) + 1000
        log.add("RATE", t_us, *controls[i])
        if i % 10 == 0:
            log.add("RCOU", t_us + 200, *(round(1000 + 1000 * u) for u in commands[i]))
    return log.write(path), commands


def test_controllers_outputs_give_ardupilots_motors_their_rate(tmp_path: Path) -> None:
    path, commands = mixed_dataflash(tmp_path / "a.bin", limited=False)
    file = LogFile(path, X500)
    log = read_log(file)
    np.testing.assert_allclose(log.motors.t_s, MOTION.t_s + 0.001, atol=1e-9)
    np.testing.assert_allclose(log.motors.values, commands, atol=1e-3)  # RCOU has whole microseconds
    assert not file.notes
    file = LogFile(mixed_dataflash(tmp_path / "b.bin", limited=True)[0], X500)
    assert len(read_log(file).motors) == 100
    assert "RCOU: has 10 values per second" in str(file.notes[0])


@pytest.mark.parametrize("simulated", [True, False])
def test_ardupilots_filters_are_those_that_it_runs(tmp_path: Path, simulated: bool) -> None:
    """Gyro and accelerometer at 400 Hz, logged at 200; SITL has the accelerometer's coefficients for 1000 Hz."""
    parameters = {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 20.0}
    log = DataFlashFile(parameters | ({"SIM_RATE_HZ": 400.0} if simulated else {}))
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("IMU", "QBffffffHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GHz,AHz")
    t = np.arange(0.0, 6.0, 0.0025)
    motion = np.sin(2 * np.pi * 7.0 * t)
    gyro = lfilter(*butter(2, 20.0, fs=400.0), motion)
    accel = lfilter(*butter(2, 20.0, fs=1000.0 if simulated else 400.0), motion)
    for i in range(0, len(t), 2):
        log.add("RCOU", round(t[i] * 1e6), *(round(1500 + 300 * motion[i]),) * 4)
        log.add("IMU", round(t[i] * 1e6), 0, gyro[i], 0.0, 0.0, accel[i], 0.0, -9.8, 400, 400)
    found = read_log(LogFile(log.write(tmp_path / "a.bin"), X500))
    assert found.rate is not None
    assert found.accel is not None
    inside = slice(200, -200)
    for series in (found.rate, found.accel):
        np.testing.assert_allclose(series.values[inside, 0], motion[::2][inside], atol=2e-3)
    np.testing.assert_allclose(found.motors.values[inside, 0], 0.5 + 0.3 * motion[::2][inside], atol=1e-3)


def test_commands_faster_than_the_band_of_the_readings_are_taken_out(tmp_path: Path) -> None:
    """Commands that change at 100 Hz, of which readings restored up to 50 Hz show nothing."""
    log = DataFlashFile({"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "INS_GYRO_FILTER": 20.0})
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("IMU", "QBffffffHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GHz,AHz")
    for i in range(2000):
        pwm = round(1500 + 200 * np.sin(0.005 * i) + (100 if i % 4 < 2 else -100))
        log.add("RCOU", 2500 * i, pwm, pwm, pwm, pwm)
        log.add("IMU", 2500 * i, 0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8, 400, 400)
    found = read_log(LogFile(log.write(tmp_path / "a.bin"), X500)).motors
    inside = slice(200, -200)
    wanted = 0.5 + 0.2 * np.sin(2.0 * found.t_s)
    np.testing.assert_allclose(found.values[inside, 0], wanted[inside], atol=2e-3)
