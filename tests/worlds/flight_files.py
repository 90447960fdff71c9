"""A flight's motion as PX4 and ArduPilot log it, turned to NED and FRD by matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hil.run.flight_logs.flight_log import FlightLog
from tests.worlds.dataflash_file import DataFlashFile
from tests.worlds.known_motion import Motion
from tests.worlds.ulog_file import ULogFile

START_US = 5_000_000


def us(t_s: float) -> int:
    return START_US + round(t_s * 1e6)


def ulog(
    path: Path, m: Motion, *, positions_every: int = 1, hardware: str = "PX4_FMU_V6X", set_points: bool = False
) -> Path:
    """Write a motion as PX4 logs it: messages later than their samples."""
    log = ULogFile({"SYS_AUTOSTART": 4001})
    log.info("ver_hw", hardware)
    log.topic("actuator_motors", [("uint64_t", "timestamp_sample"), ("float", "control[12]")])
    log.topic(
        "sensor_combined",
        [("float", "gyro_rad[3]"), ("int32_t", "accelerometer_timestamp_relative"), ("float", "accelerometer_m_s2[3]")],
    )
    log.topic("vehicle_attitude", [("uint64_t", "timestamp_sample"), ("float", "q[4]")])
    log.topic(
        "vehicle_local_position",
        [("uint64_t", "timestamp_sample"), *(("float", n) for n in ("x", "y", "z", "vx", "vy", "vz"))],
    )
    log.topic("battery_status", [("float", "voltage_v")])
    log.topic("wind", [("float", "windspeed_north"), ("float", "windspeed_east")])
    vectors = [("float", f"{name}[3]") for name in ("position", "velocity", "acceleration")]
    log.topic("trajectory_setpoint", [*vectors, ("float", "yaw"), ("float", "yawspeed")])
    gyro, accel = m.frd(m.w_WB_B), m.frd(m.accel_B)
    p, v, q = m.ned(m.p_WB), m.ned(m.v_WB_W), m.q_NF
    for i, t_s in enumerate(m.t_s):
        t = us(t_s)
        log.add("actuator_motors", t + 3000, t, *m.motors[i], *[float("nan")] * 8)
        log.add("sensor_combined", t, *gyro[i], 0, *accel[i])
        log.add("vehicle_attitude", t + 2000, t, *q[i])
        if i % positions_every == 0:
            log.add("vehicle_local_position", t + 4000, t, *p[i], *v[i])
            log.add("battery_status", t, 15.2)
        if set_points and i % 10 == 0:
            log.add("trajectory_setpoint", t, *p[i], *v[i], *[float("nan")] * 3, 0.25, 0.0)
            log.add("wind", t, 3.0, -1.5)
    return log.write(path)


def dataflash(path: Path, m: Motion, *, quaternions: bool = True, set_points: bool = False) -> Path:
    log = DataFlashFile(
        {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0, **{f"SERVO{i + 1}_FUNCTION": 33.0 + i for i in range(4)}}
    )
    log.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    log.message("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.message("XKF1", "QBccCffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD")
    log.message("BAT", "QBf", "TimeUS,I,Volt")
    if quaternions:
        log.message("XKQ", "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4")
    log.message("ATT", "Qffff", "TimeUS,DesYaw,Roll,Pitch,Yaw")
    log.message("XKF2", "QBcc", "TimeUS,C,VWN,VWE")
    for axis in "NED":
        log.message(f"PSC{axis}", "Qff", f"TimeUS,TP{axis},DV{axis}")
    gyro, accel = m.frd(m.w_WB_B), m.frd(m.accel_B)
    p, v, q = m.ned(m.p_WB), m.ned(m.v_WB_W), m.q_NF
    w, x, y, z = q.T
    roll = np.degrees(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    pitch = np.degrees(np.arcsin(2 * (w * y - z * x)))
    yaw = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) % 360.0
    for i, t_s in enumerate(m.t_s):
        t = us(t_s)
        log.add("RCOU", t, *(round(1100 + 800 * u) for u in m.motors[i]))
        for instance in (0, 1):  # the second IMU must not be mixed with the first
            log.add("IMU", t, instance, *(gyro[i] + instance), *(accel[i] + instance))
        angles = (round(100 * roll[i]), round(100 * pitch[i]), round(100 * yaw[i]))
        log.add("XKF1", t, 0, *angles, *v[i], *p[i])
        log.add("BAT", t, 0, 15.2)
        if quaternions:
            log.add("XKQ", t, 0, *q[i])
        if set_points and i % 10 == 0:
            log.add("ATT", t, np.degrees(0.25), 0.0, 0.0, 0.0)
            log.add("XKF2", t, 0, 300, -150)
            for k, axis in enumerate("NED"):
                log.add(f"PSC{axis}", t, p[i, k], v[i, k])
    return log.write(path)


def motion_of(log: FlightLog) -> Motion:
    """Return the motion of a log whose series have the same times."""
    assert log.pose is not None and log.velocity is not None  # noqa: PT018
    assert log.rate is not None and log.accel is not None  # noqa: PT018
    R = Rotation.from_quat(log.pose.values[:, 3:], scalar_first=True).as_matrix()
    p, v, w, f = log.pose.values[:, :3], log.velocity.values, log.rate.values, log.accel.values
    return Motion(log.motors.t_s, p, R, v, w, f, log.motors.values)
