"""The bench's own recording, run.mcap: what its autopilot commanded and what its vehicle truly did.

    motors      /actuators, from the first that is armed
    rate, accel the IMU's samples, with its noise and at its capture times
    pose        /truth/pose, and velocity /truth/velocity: as a motion capture would give them
    voltage     /battery

A run of several vehicles holds each one's topics; `--of NAME` chooses. The true rotor speeds stay in the recording: a
fit that is tested on a run must not see them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import MCAP0_MAGIC

from hil.apps.identify.columns_of_time import continuous_quaternions, series_of
from hil.apps.identify.flight_log import FlightLog, Series
from hil.apps.identify.log_format import Format, LogFile
from hil.run.recorder.reading import RecordedMessage, Recording
from signals.errors import RecordingError
from signals.time import NS_PER_S

_POSE, _VELOCITY, _ACTUATORS = "/truth/pose", "/truth/velocity", "/actuators"
_IMU_TYPE, _BATTERY = "sensor_msgs/Imu", "/battery"
_POSE_FIELDS = tuple(f"pose.position.{k}" for k in "xyz") + tuple(f"pose.orientation.{k}" for k in "wxyz")
_VECTOR_FIELDS = tuple(f"vector.{k}" for k in "xyz")
_GYRO_FIELDS = tuple(f"angular_velocity.{k}" for k in "xyz")
_ACCEL_FIELDS = tuple(f"linear_acceleration.{k}" for k in "xyz")


class _Rows:
    """Times and values of one series while a recording is read."""

    def __init__(self, fields: tuple[str, ...]) -> None:
        self._fields = fields
        self._t_s: list[float] = []
        self._values: list[list[float]] = []

    def add(self, message: dict[str, Any]) -> None:
        self._t_s.append(message["header.stamp.sec"] + message["header.stamp.nanosec"] / NS_PER_S)
        self._values.append([message[name] for name in self._fields])

    def series(self) -> Series | None:
        return series_of(np.array(self._t_s), np.array(self._values, np.float64)) if self._t_s else None


def _recognises(head: bytes, path: Path) -> bool:
    del path
    return head.startswith(MCAP0_MAGIC)


def _read(file: LogFile) -> FlightLog:
    rotors = len(file.vehicle.rotors)
    motors = _Rows(tuple(f"controls[{i}]" for i in range(rotors)))
    pose, velocity, voltage = _Rows(_POSE_FIELDS), _Rows(_VECTOR_FIELDS), _Rows(("voltage",))
    rate, accel = _Rows(_GYRO_FIELDS), _Rows(_ACCEL_FIELDS)
    rows = {_POSE: pose, _VELOCITY: velocity, _ACTUATORS: motors, _BATTERY: voltage}
    imu_topic, armed = "", False
    recording = _opened(file)
    file.topics.update(motors=_ACTUATORS, pose=_POSE, velocity=_VELOCITY, voltage=_BATTERY, rate="/imu", accel="/imu")
    try:
        for message in recording.messages():
            if message.type_name == _IMU_TYPE and message.topic in (imu_topic or message.topic, "/imu"):
                imu_topic = message.topic
                values = message.decode()
                rate.add(values)
                accel.add(values)
            elif message.topic == _ACTUATORS:
                values = _commands(message, rotors, file)
                armed = armed or bool(values["armed"])
                motors.add(values)
            elif message.topic in rows:
                rows[message.topic].add(message.decode())
    except RecordingError as error:
        raise file.refuse(f"cannot be read ({error})", "record the run again") from error
    if not recording.complete:
        at_s = recording.last_ns / NS_PER_S
        file.note(f"is cut off; its data end at {at_s:.2f} s", "a run that ended by itself closes its recording")
    commands = motors.series()
    if commands is None or not armed:
        hint = "fly it with record.mcap and an autopilot that arms"
        raise file.refuse("has no motor outputs of an armed vehicle", hint, topic=_ACTUATORS)
    pose_series = pose.series()
    if pose_series is not None:
        values_of_pose = pose_series.values
        values_of_pose[:, 3:] = continuous_quaternions(values_of_pose[:, 3:])
    return FlightLog(
        name=file.path.parent.name if file.path.name == "run.mcap" else file.path.stem,
        source=file.path,
        motors=commands,
        motors_kind="command",
        pose=pose_series,
        velocity=velocity.series(),
        rate=rate.series(),
        accel=accel.series(),
        voltage=voltage.series(),
        estimated=False,
        start_s=float(commands.t_s[0]),
        end_s=float(commands.t_s[-1]),
    )


def _opened(file: LogFile) -> Recording:
    try:
        names = Recording(file.path).scan().vehicles
    except RecordingError as error:
        raise file.refuse(f"cannot be read ({error})", "record the run again") from error
    if names and file.of not in names:
        message = f"holds the vehicles {', '.join(names)}" + (f", not {file.of!r}" if file.of else "")
        raise file.refuse(message, f"choose one: --of {names[0]}")
    return Recording(file.path, file.of if names else "")


def _commands(message: RecordedMessage, rotors: int, file: LogFile) -> dict[str, Any]:
    values = message.decode()
    if f"controls[{rotors - 1}]" not in values:
        text = f"has fewer controls than the {rotors} rotors of {file.vehicle.name!r}"
        raise file.refuse(text, "name the file of the vehicle that flew", topic=_ACTUATORS)
    if values["armed"] and values.get(f"controls[{rotors}]"):
        text = (
            f"commands rotor {rotors + 1} at {message.log_time_ns / NS_PER_S:.2f} s; {file.vehicle.name!r} has {rotors}"
        )
        raise file.refuse(text, "name the file of the vehicle that flew", topic=_ACTUATORS)
    return values


FORMAT = Format("the bench's run.mcap", _recognises, _read)
