"""A known rotation and motion survive every format of logs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hil.apps.identify.flight_log import FlightLog, Series
from hil.apps.identify.log_format import LogFile, formats, read_log
from sim.physics.vehicle import load_vehicle
from tests.worlds.flight_files import dataflash, ulog
from tests.worlds.known_motion import Motion, motion

X500 = load_vehicle("x500")
MOTION = motion(np.arange(0.0, 10.0, 0.01))
COLUMN_MAP = """
time: {column: t, unit: ms}
world: ned
body: frd
estimated: false
motors: {columns: [m1, m2, m3, m4], kind: command, range: [0, 65535]}
position: {columns: [x, y, z], unit: cm}
attitude: {quaternion: [qw, qx, qy, qz]}
velocity: {columns: [vx, vy, vz], unit: m/s}
rate: {columns: [p, q, r], unit: deg/s}
accel: {columns: [ax, ay, az], unit: g}
voltage: {column: bat, unit: mV}
"""


def table(m: Motion) -> tuple[list[str], np.ndarray]:
    header = [*"t m1 m2 m3 m4 x y z qw qx qy qz vx vy vz p q r ax ay az bat".split()]  # noqa: SIM905
    columns = [
        1e3 * m.t_s[:, None], 65535 * m.motors, 100 * m.ned(m.p_WB), m.q_NF, m.ned(m.v_WB_W),
        np.degrees(m.frd(m.w_WB_B)), m.frd(m.accel_B) / 9.80665, np.full((len(m.t_s), 1), 15200.0),
    ]  # fmt: skip
    return header, np.hstack(columns)


def csv_file(path: Path, m: Motion) -> Path:
    header, values = table(m)
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(values.tolist())
    return path


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
