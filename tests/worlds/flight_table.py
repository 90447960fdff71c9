"""A flight's motion as a table in other units, NED and FRD, and the map of its columns."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tests.worlds.known_motion import Motion

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
