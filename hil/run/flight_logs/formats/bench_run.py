"""The bench's own recording, run.mcap: what its autopilot commanded and what its vehicle truly did.

    motors      /actuators, from the first that is armed
    rate, accel the IMU's samples, with its noise and at its capture times
    pose        /truth/pose, and velocity /truth/velocity: as a motion capture would give them
    voltage     /battery
    set-points  what a companion, a ROS 2 node or a followed log commanded (offboard_set_points.py)

A run of several vehicles holds each one's topics; `--of NAME` chooses. The true rotor speeds stay in the recording: a
fit that is tested on a run must not see them.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from hil.run.flight_logs.columns_of_time import continuous_quaternions, series_of
from hil.run.flight_logs.flight_log import FlightLog, Series
from hil.run.flight_logs.log_format import Format, LogFile
from hil.run.flight_logs.offboard_set_points import RECEIVED, SENT, OffboardRows
from hil.run.recorder.mcap.cdr import MESSAGE_PREFIX, Layout, decode
from hil.run.recorder.reading import DAMAGE_ERRORS, RecordedMessage, Recording
from hil.run_files import MCAP_NAME
from signals.errors import RecordingError
from signals.time import NS_PER_S

_POSE, _VELOCITY, _ACTUATORS = "/truth/pose", "/truth/velocity", "/actuators"
_IMU_TYPE, _BATTERY = "sensor_msgs/Imu", "/battery"
_HEADER_FIELDS = ("header.stamp.sec", "header.stamp.nanosec")


class _Rows:
    """Messages of one topic, which become columns together: decoding them one by one takes ten times as long."""

    def __init__(self) -> None:
        self.type_name = ""
        self._data: list[bytes] = []
        self._times_ns: list[int] = []

    def add(self, message: RecordedMessage) -> None:
        self.type_name = message.type_name
        self._data.append(message.data)
        self._times_ns.append(message.log_time_ns)

    def __len__(self) -> int:
        return len(self._data)

    def columns(self) -> NDArray[Any]:
        """Return the messages as one structured array. Raises RecordingError for messages of different sizes."""
        first = decode(self.type_name, self._data[0])
        strings = {path: value for path, value in first.items() if isinstance(value, str)}
        elements = [path.partition("[")[0] for path in first if path.endswith("]")]
        layout = Layout(self.type_name, channel=0, strings=strings, lengths=Counter(elements))
        size = layout.size - MESSAGE_PREFIX.size
        for data, t_ns in zip(self._data, self._times_ns, strict=True):
            if len(data) != size:
                raise RecordingError(f"{self.type_name} at {t_ns / NS_PER_S:.2f} s: has {len(data)} bytes, not {size}")
        fields = {name: item for name, item in (layout.dtype.fields or {}).items() if not name.startswith("$")}
        record = np.dtype(
            {
                "names": list(fields),
                "formats": [item[0] for item in fields.values()],
                "offsets": [item[1] - MESSAGE_PREFIX.size for item in fields.values()],
                "itemsize": size,
            }
        )
        return np.frombuffer(b"".join(self._data), record)

    def series(self, *names: str) -> Series | None:
        """Return the values of these fields at the times of the messages' stamps; None without messages."""
        if not self._data:
            return None
        columns = self.columns()
        t_s = columns[_HEADER_FIELDS[0]] + columns[_HEADER_FIELDS[1]] / NS_PER_S
        values = [columns[name].reshape(len(t_s), -1).astype(np.float64) for name in names]
        return series_of(t_s, np.hstack(values))


def _recognises(head: bytes, path: Path) -> bool:
    del path
    return head.startswith(MCAP0_MAGIC)


def _read(file: LogFile) -> FlightLog:
    file.topics.update(motors=_ACTUATORS, pose=_POSE, velocity=_VELOCITY, voltage=_BATTERY, rate="/imu", accel="/imu")
    recording = _opened(file)
    rows = {name: _Rows() for name in (_POSE, _VELOCITY, _ACTUATORS, _BATTERY)}
    imus: dict[str, _Rows] = {}
    offboard = OffboardRows()
    try:
        for message in recording.messages():
            if message.topic in rows:
                rows[message.topic].add(message)
            elif message.topic in (SENT, RECEIVED):
                offboard.add(message)
            elif message.type_name == _IMU_TYPE:
                imus.setdefault(message.topic, _Rows()).add(message)
        imu = imus.get("/imu") or next(iter(imus.values()), _Rows())
        commands = _commands(rows[_ACTUATORS], file)
        pose = rows[_POSE].series("pose.position", "pose.orientation")
        velocity, voltage = rows[_VELOCITY].series("vector"), rows[_BATTERY].series("voltage")
        rate, accel = imu.series("angular_velocity"), imu.series("linear_acceleration")
    except DAMAGE_ERRORS as error:
        raise file.refuse(f"cannot be read ({error})", "record the run again") from error
    except RecordingError as error:
        raise file.refuse(f"cannot be read ({error})", "record the run again") from error
    if not recording.complete:
        at_s = recording.last_ns / NS_PER_S
        file.note(f"is cut off; its data end at {at_s:.2f} s", "a run that ended by itself closes its recording")
    if pose is not None:
        xyzw = pose.values[:, 3:]
        pose = Series(pose.t_s, np.hstack([pose.values[:, :3], continuous_quaternions(xyzw[:, [3, 0, 1, 2]])]))
    return FlightLog(
        name=file.path.parent.name if file.path.name == MCAP_NAME else file.path.stem,
        source=file.path,
        motors=commands,
        motors_kind="command",
        pose=pose,
        velocity=velocity,
        rate=rate,
        accel=accel,
        voltage=voltage,
        estimated=False,
        start_s=float(commands.t_s[0]),
        end_s=float(commands.t_s[-1]),
        set_points=offboard.set_points(pose),
    )


def _opened(file: LogFile) -> Recording:
    try:
        names = Recording(file.path).scan().vehicles
    except RecordingError as error:
        raise file.refuse(f"cannot be read ({error})", "record the run again") from error
    if names and file.of not in names:
        message = f"holds the vehicles {', '.join(names)}" + (f", not {file.of!r}" if file.of else "")
        raise file.refuse(message, f"choose one: --of {names[0]}, or follow.of of a run")
    return Recording(file.path, file.of if names else "")


def _commands(rows: _Rows, file: LogFile) -> Series:
    """Return the commands of the vehicle's rotors. Raises ConfigError if they are not this vehicle's."""
    count, vehicle = len(file.vehicle.rotors), file.vehicle.name
    columns = rows.columns() if len(rows) else None
    commands = rows.series("controls")
    if columns is None or commands is None or not columns["armed"].any():
        hint = "fly it with record.mcap and an autopilot that arms"
        raise file.refuse("has no motor outputs of an armed vehicle", hint, topic=_ACTUATORS)
    further = commands.values[:, count : count + 1]
    if commands.values.shape[1] < count or not commands.values[:, :count].any(axis=0).all() or further.any():
        used = int(np.count_nonzero(commands.values.any(axis=0)))
        text = f"commands {used} rotors, and the vehicle {vehicle!r} has {count}"
        raise file.refuse(text, "name the file of the vehicle that flew", topic=_ACTUATORS)
    return Series(commands.t_s, np.ascontiguousarray(commands.values[:, :count]))


FORMAT = Format("the bench's run.mcap", _recognises, _read)
