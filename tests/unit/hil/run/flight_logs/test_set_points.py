"""Set-points of every format of logs: known numbers in, the same numbers out in W; NaN where nothing was commanded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.run.flight_logs.flight_log import FlightLog
from hil.run.flight_logs.log_format import LogFile, read_log
from hil.run.flight_logs.set_points import GAP_S, SetPoints, commanded_at, unwrapped_at
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.dataflash_file import DataFlashFile
from tests.worlds.followed_log import line, write_log
from tests.worlds.ulog_file import ULogFile

X500 = load_vehicle("x500")
NAN = float("nan")
XYZ = ("x", "y", "z")


def points_of(log: FlightLog) -> SetPoints:
    assert log.set_points is not None
    return log.set_points


def px4_log(vehicle_type: int = 1) -> ULogFile:
    """Return a log with motors and, from 2 s on, a position whose origin jumps by (1, 2, 3) m at 3 s."""
    log = ULogFile({})
    log.topic("actuator_motors", [("float", "control[12]")])
    log.topic("vehicle_status", [("uint8_t", "vehicle_type")])
    log.topic(
        "vehicle_local_position",
        [
            *(("float", name) for name in (*XYZ, "vx", "vy", "vz", "delta_xy[2]", "delta_z")),
            ("uint8_t", "xy_reset_counter"),
            ("uint8_t", "z_reset_counter"),
        ],
    )
    log.topic(
        "trajectory_setpoint",
        [*(("float", f"{name}[3]") for name in ("position", "velocity", "acceleration")), ("float", "yawspeed")],
    )
    log.topic("vehicle_local_position_setpoint", [("float", n) for n in (*XYZ, "vx", "vy", "vz", "yaw")])
    log.add("vehicle_status", 1_000_000, vehicle_type)
    for i in range(200):
        t_us = 2_000_000 + 10_000 * i
        jumped = i >= 100
        log.add("actuator_motors", t_us, *[0.7] * 4, *[NAN] * 8)
        shift = (1.0, 2.0, 3.0) if jumped else (0.0, 0.0, 0.0)
        deltas = (1.0, 2.0, 3.0) if jumped else (0.0, 0.0, 0.0)
        log.add("vehicle_local_position", t_us, *shift, 0.0, 0.0, 0.0, *deltas, int(jumped), int(jumped))
    return log


def test_px4_set_points_turn_to_enu_and_lose_the_jumps_of_the_origin(tmp_path: Path) -> None:
    log = px4_log()
    log.add("trajectory_setpoint", 2_500_000, 10.0, 20.0, -5.0, 1.0, 2.0, -3.0, 0.1, 0.2, -0.3, 0.7)
    log.add("trajectory_setpoint", 3_500_000, 11.0, 22.0, -2.0, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
    log.add("trajectory_setpoint", 3_600_000, *[NAN] * 10)  # nothing commanded
    points = points_of(read_log(LogFile(log.write(tmp_path / "a.ulg"), X500)))
    assert points.topic == "trajectory_setpoint"
    assert points.t_s == pytest.approx([2.5, 3.5])
    # After the jump by (1, 2, 3) m in NED the same place has other numbers.
    assert points.p_W == pytest.approx(np.array([[20.0, 10.0, 5.0], [20.0, 10.0, 5.0]]))
    assert points.v_W[0] == pytest.approx([2.0, 1.0, 3.0])
    assert points.a_W[0] == pytest.approx([0.2, 0.1, 0.3])
    assert np.isnan(points.v_W[1]).all()
    assert points.yaw_rate_radps[0] == pytest.approx(-0.7)  # clockwise is negative here
    assert np.isnan(points.yaw_rad).all()


def test_px4_velocities_of_the_controller_count_only_without_a_position(tmp_path: Path) -> None:
    log = px4_log()
    log.add("vehicle_local_position_setpoint", 2_500_000, 1.0, NAN, -5.0, 0.5, 0.6, 0.7, 0.5 * np.pi)
    points = points_of(read_log(LogFile(log.write(tmp_path / "a.ulg"), X500)))
    assert points.topic == "vehicle_local_position_setpoint"
    np.testing.assert_allclose(points.p_W, [[NAN, 1.0, 5.0]])
    np.testing.assert_allclose(points.v_W, [[0.6, NAN, NAN]], rtol=1e-6)
    assert points.yaw_rad == pytest.approx([0.0], abs=1e-6)  # east


def test_log_of_a_fixed_wing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"vehicle_status.vehicle_type: is the log of a fixed-wing aircraft \(name"):
        read_log(LogFile(px4_log(vehicle_type=2).write(tmp_path / "a.ulg"), X500))


def ardupilot_log(axes: str = "NED", firmware: bytes = b"ArduCopter V4.6.0") -> DataFlashFile:
    log = DataFlashFile({f"SERVO{i + 1}_FUNCTION": 33.0 + i for i in range(4)})
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("ATT", "Qffff", "TimeUS,DesYaw,Roll,Pitch,Yaw")
    log.message("XKF2", "QBcc", "TimeUS,C,VWN,VWE")
    log.message("MSG", "QN", "TimeUS,Message")
    for axis in axes:
        log.message(f"PSC{axis}", "Qffff", f"TimeUS,TP{axis},P{axis},DV{axis},TV{axis}")
    log.add("MSG", 1_000_000, firmware[:16])
    for i in range(20):
        t_us = 1_000_000 + 100_000 * i
        log.add("RCOU", t_us, *[1500] * 4)
        log.add("ATT", t_us + 20_000, (350.0 + 2.0 * i) % 360.0, 0.0, 0.0, 0.0)
        log.add("XKF2", t_us, 0, 150, -250)
        for k, axis in enumerate(axes):
            log.add(f"PSC{axis}", t_us, 10.0 * (k + 1) + 0.5 * i, 0.0, 0.25 * (k + 1), 99.0)
    return log


def test_ardupilot_set_points_are_targets_without_the_controller_s_correction(tmp_path: Path) -> None:
    log = read_log(LogFile(ardupilot_log().write(tmp_path / "a.bin"), X500))
    points = points_of(log)
    assert points.topic == "PSCN, PSCE, PSCD, ATT.DesYaw"
    n = np.arange(20.0)
    assert points.t_s == pytest.approx(1.0 + 0.1 * n)
    assert points.p_W == pytest.approx(np.stack([20.0 + 0.5 * n, 10.0 + 0.5 * n, -30.0 - 0.5 * n], axis=1))
    assert points.v_W[7] == pytest.approx([0.5, 0.25, -0.75])
    assert np.isnan(points.a_W).all()
    # Yaw from north, 20 ms before its own sample, through north without a jump.
    heading = np.radians(350.0 - 360.0 + 2.0 * n - 0.4)
    turned = np.unwrap(points.yaw_rad[1:])
    assert turned - turned[0] == pytest.approx(-(heading[1:] - heading[1]))
    assert points.yaw_rate_radps[5] == pytest.approx(-np.radians(20.0))  # 2 degrees in 0.1 s
    assert log.wind is not None
    assert log.wind.values[3] == pytest.approx([-2.5, 1.5])


def test_ardupilot_axis_that_no_controller_held_is_not_commanded(tmp_path: Path) -> None:
    points = points_of(read_log(LogFile(ardupilot_log("D").write(tmp_path / "a.bin"), X500)))
    assert np.isnan(points.p_W[:, :2]).all()
    assert points.p_W[0, 2] == pytest.approx(-10.0)


def test_log_of_a_plane_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="MSG: is the log of a plane"):
        read_log(LogFile(ardupilot_log(firmware=b"ArduPlane V4.5.1").write(tmp_path / "a.bin"), X500))


def test_table_has_set_points_by_its_map(tmp_path: Path) -> None:
    log, columns = write_log(tmp_path, line(5.0, 10.0, 40.0), 40.0, heading_rad=-1.0)
    points = points_of(read_log(LogFile(log, X500, columns)))
    assert points.topic == "sx, sy, sz, syaw"
    at = int(np.argmin(np.abs(points.t_s - 10.0)))
    assert points.p_W[at] == pytest.approx([100.0, -50.0, 12.0])
    assert points.yaw_rad[at] == pytest.approx(-1.0)
    assert np.isnan(points.v_W).all()
    log, columns = write_log(tmp_path, line(5.0, 10.0, 40.0), 40.0, velocities=True)
    points = points_of(read_log(LogFile(log, X500, columns)))
    assert points.v_W[np.argmin(np.abs(points.t_s - 5.0))] == pytest.approx([0.0, 0.0, 1.0])  # 5 m in 5 s


def test_commanded_values_are_linear_between_samples_and_unknown_in_a_gap() -> None:
    at_s = np.array([1.0, 1.5, 4.0, 4.5])
    values = np.array([[0.0], [1.0], [6.0], [NAN]])
    t_s = np.array([0.5, 1.0, 1.25, 1.5, 2.0, 4.0, 4.25, 4.6, 9.0])
    found = commanded_at(t_s, at_s, values)[:, 0]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, NAN, 6.0, NAN, NAN, NAN])
    assert GAP_S == 1.0


def test_angle_takes_the_shorter_way_round() -> None:
    at_s, angle = np.array([0.0, 0.5]), np.array([3.0, -3.0])
    (found,) = unwrapped_at(np.array([0.25]), at_s, angle)
    assert found == pytest.approx(np.pi)
