"""PX4's ULog (.ulg), read with pyulog.

    motors      actuator_motors (0 to 1, NaN when stopped), else actuator_outputs by the functions of the outputs,
                else esc_status (rpm)
    rate, accel sensor_combined (each sample of the IMU in use), else vehicle_angular_velocity
    pose        vehicle_attitude and vehicle_local_position; velocity from the latter
    voltage     battery_status
    set-points  trajectory_setpoint (ulog_set_points.py), wind the estimator's

actuator_motors are shares of thrust: the outputs x follow from T = f x^2 + (1 - f) x with f = THR_MDL_FAC
(mixer_module/functions/FunctionMotors.hpp). PX4's motor i is the rotor i of the vehicle file (`CA_ROTORi_*`). Times are
those of the sample from which a value was computed (`timestamp_sample`) where the topic has it, otherwise of the
message: a motor's command otherwise seems as late as the controller took to compute it.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.columns_of_time import pose_of, series_of
from hil.run.flight_logs.flight_log import FlightLog, MotorsKind, Series
from hil.run.flight_logs.log_format import Format, LogFile
from hil.run.flight_logs.message_columns import MessageColumns
from hil.run.flight_logs.ned import enu_from_ned, flu_from_frd, q_WB_from_q_NF
from hil.run.flight_logs.rotor_model import wrench
from hil.run.flight_logs.ulog_set_points import TOPICS as _SET_POINT_TOPICS
from hil.run.flight_logs.ulog_set_points import ulog_other_vehicle, ulog_set_points, ulog_wind
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.vehicle import Vehicle

_MAGIC = b"ULog\x01\x12\x35"
_TOPICS = (
    *("actuator_motors", "actuator_outputs", "esc_status", "sensor_combined", "vehicle_angular_velocity"),
    *("vehicle_acceleration", "vehicle_attitude", "vehicle_local_position", "battery_status"),
    *_SET_POINT_TOPICS,
)
_FIRST_MOTOR = 101  # output function of motor 1 (PWM_MAIN_FUNC1 and the like)
_MOST_OUTPUTS = 16
_US = 1e-6
_RADPS_PER_RPM = 2.0 * math.pi / 60.0
_MOTORS_HINT = "log actuator_motors at its full rate: SDLOG_PROFILE with bit 3 (system identification), and fly again"
_LEAST_MOTOR_HZ = 45.0  # below it a motor's lag, typically 0.02 to 0.05 s, hides between two samples
_SHORTEST_GAP_MS = 20.0
_RESETS: tuple[
    tuple[str, tuple[str, ...], int], ...
] = (  # counter of the estimator's resets, the last one's distances, first axis
    ("xy_reset_counter", ("delta_xy[0]", "delta_xy[1]"), 0),
    ("z_reset_counter", ("delta_z",), 2),
)


class _Topics:
    """Columns of the topics of one log, by name and instance."""

    def __init__(self, datasets: Sequence[Any], file: LogFile) -> None:
        self._data = {
            (d.name, d.multi_id): MessageColumns(d.data, file, d.name)
            for d in datasets
            if len(d.data.get("timestamp", ()))
        }

    def __call__(self, name: str, instance: int = 0) -> MessageColumns | None:
        return self._data.get((name, instance))


def _recognises(head: bytes, path: Path) -> bool:
    return head.startswith(_MAGIC) or path.suffix == ".ulg"


def _read(file: LogFile) -> FlightLog:
    try:
        from pyulog import ULog
    except ImportError as error:
        raise file.refuse("is a ULog, and pyulog is not installed", 'pip install "hil-bench[identify]"') from error
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it finds at a damaged end
            log = ULog(str(file.path), list(_TOPICS))
    except Exception as error:  # pyulog raises bare exceptions, IndexError and struct.error
        raise file.refuse(f"is no readable ULog ({error})", "copy it from the vehicle again") from error
    topics = _Topics(log.data_list, file)
    if log.file_corruption:
        hint = "copy it from the card again; what comes before is used"
        file.note(f"is cut off or damaged; its data end at {log.last_timestamp * _US:.2f} s", hint)
    _note_dropouts(file, log.dropouts)
    if other := ulog_other_vehicle(topics):
        hint = "name the log of a multirotor"
        raise file.refuse(f"is the log of {other}", hint, topic="vehicle_status.vehicle_type")
    motors, kind = _motors(file, topics, log.initial_parameters)
    rate, accel = _imu(file, topics)
    attitude, position, velocity = _state(file, topics)
    moved_s, moved_N = _moved_by_resets(topics)
    battery = topics("battery_status")
    voltage = None if battery is None else series_of(_times(battery), battery[_voltage_field(battery)])
    if voltage is not None and str(log.msg_info_dict.get("ver_hw", "")).startswith("PX4_SITL"):
        file.note("is that of PX4's own simulated battery", "it is not used", topic="battery_status")
        voltage = None
    pose = pose_of(attitude, position, velocity) if attitude is not None and position is not None else None
    return FlightLog(
        name=file.path.stem,
        source=file.path,
        motors=motors,
        motors_kind=kind,
        pose=pose,
        velocity=velocity,
        rate=rate,
        accel=accel,
        voltage=voltage,
        estimated=True,
        start_s=float(motors.t_s[0]),
        end_s=float(motors.t_s[-1]),
        set_points=ulog_set_points(topics, moved_s, moved_N),
        wind=ulog_wind(topics),
    )


def _note_dropouts(file: LogFile, dropouts: Sequence[Any]) -> None:
    """Report the stretches that the logger says it lost; the gaps in the series are found later."""
    lost = [d for d in dropouts if d.duration > _SHORTEST_GAP_MS]
    if lost:
        worst = max(lost, key=lambda d: d.duration)
        message = (
            f"lost {len(lost)} stretches, the longest of {worst.duration / 1e3:.2f} s at {worst.timestamp * _US:.2f} s"
        )
        file.note(message, "log fewer topics, or on a faster card", topic="dropouts")


def _times(data: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Return the times of the samples [s]; those of the messages where the sample's is missing or 0."""
    published = data["timestamp"].astype(np.float64)
    sampled = data.get("timestamp_sample")
    if sampled is not None:
        return np.where(sampled > 0, sampled.astype(np.float64), published) * _US
    return published * _US


def _columns(data: dict[str, NDArray[Any]], name: str, count: int) -> NDArray[np.float64] | None:
    names = [f"{name}[{i}]" for i in range(count)]
    if any(n not in data for n in names):
        return None
    return np.stack([data[n].astype(np.float64) for n in names], axis=1)


def _motors(file: LogFile, topics: _Topics, parameters: dict[str, Any]) -> tuple[Series, MotorsKind]:
    rotors = len(file.vehicle.rotors)
    found = _commands(file, topics, rotors, float(parameters.get("THR_MDL_FAC", 0.0)))
    kind: MotorsKind = "command"
    topic = "actuator_motors"
    if found is None:
        topic, found = "actuator_outputs", _outputs(topics, parameters, rotors)
    if found is None:
        topic, found, kind = "esc_status", _esc_speeds(topics, rotors), "speed_radps"
    if found is None:
        message = f"has no motor outputs of {rotors} rotors: none of actuator_motors, actuator_outputs and esc_status"
        raise file.refuse(message, _MOTORS_HINT)
    hz = _rate_hz(found)
    if kind == "command" and hz < _LEAST_MOTOR_HZ:
        speeds = _esc_speeds(topics, rotors)
        if speeds is not None and _rate_hz(speeds) >= _LEAST_MOTOR_HZ and _lifts(speeds, file.vehicle):
            topic, found, kind, hz = "esc_status", speeds, "speed_radps", _rate_hz(speeds)
    file.topics.update(motors=topic)
    if hz < _LEAST_MOTOR_HZ:
        file.note(f"has {hz:.0f} values per second; the motors' lags need more", _MOTORS_HINT, topic=topic)
    return found, kind


def _rate_hz(series: Series) -> float:
    return 1.0 / float(np.median(np.diff(series.t_s))) if len(series) > 1 else 0.0


def _lifts(speeds: Series, vehicle: Vehicle) -> bool:
    """Return whether measured speeds may be the rotors': PX4's SITL reports 6000 rpm times the command as such."""
    turning = speeds.values[(speeds.values > 0.2 * speeds.values.max()).all(axis=1)]
    if not len(turning):
        return False
    lift_n = float(np.median(wrench(turning, vehicle)[:, 2]))
    return 0.5 < lift_n / (vehicle.mass_kg * STANDARD_GRAVITY_MPS2) < 2.0


def _commands(file: LogFile, topics: _Topics, rotors: int, thrust_factor: float) -> Series | None:
    data = topics("actuator_motors")
    values = None if data is None else _columns(data, "control", rotors)
    if data is None or values is None:
        return None
    following = data.get(f"control[{rotors}]")
    if following is not None and np.isfinite(following).any():
        count = rotors + 1
        message = f"commands motor {count}, and the vehicle {file.vehicle.name!r} has {rotors} rotors"
        raise file.refuse(message, "name the file of the vehicle that made this log", topic="actuator_motors")
    if not np.isfinite(values).any(axis=0).all():
        silent = ", ".join(str(i + 1) for i in np.flatnonzero(~np.isfinite(values).any(axis=0)))
        message = f"never commands the motors {silent} of the vehicle's {rotors}"
        hint = "name the file of the vehicle that made this log; a log without arming has no flight"
        raise file.refuse(message, hint, topic="actuator_motors")
    thrust = np.clip(np.nan_to_num(values, nan=0.0), 0.0, 1.0)  # NaN: a stopped motor
    return series_of(_times(data), _output_of_thrust(thrust, thrust_factor))


def _output_of_thrust(thrust: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    if not 0.0 < factor <= 1.0:
        return thrust
    half = (1.0 - factor) / (2.0 * factor)
    return np.asarray(np.sqrt(half * half + thrust / factor) - half, np.float64)


def _outputs(topics: _Topics, parameters: dict[str, Any], rotors: int) -> Series | None:
    """Return PWM outputs as commands 0 to 1 between the outputs' own limits."""
    for prefix in ("PWM_MAIN", "PWM_AUX", "HIL_ACT"):
        outputs = {int(parameters.get(f"{prefix}_FUNC{n + 1}", 0)) - _FIRST_MOTOR: n for n in range(_MOST_OUTPUTS)}
        if not all(rotor in outputs for rotor in range(rotors)):
            continue
        data = topics("actuator_outputs", 1 if prefix == "PWM_AUX" and topics("actuator_outputs", 1) else 0)
        if data is None:
            return None
        columns = []
        for rotor in range(rotors):
            n = outputs[rotor]
            low, high = (0.0, 1.0) if prefix == "HIL_ACT" else _pwm_range(parameters, prefix, n)
            columns.append((data[f"output[{n}]"].astype(np.float64) - low) / (high - low))
        return series_of(_times(data), np.clip(np.stack(columns, axis=1), 0.0, 1.0))
    return None


def _pwm_range(parameters: dict[str, Any], prefix: str, n: int) -> tuple[float, float]:
    """Return the pulse widths of an output for 0 and 1 [us]; PX4's defaults if the log has none."""
    low = float(parameters.get(f"{prefix}_MIN{n + 1}", 1000.0))
    high = float(parameters.get(f"{prefix}_MAX{n + 1}", 2000.0))
    return low, max(high, low + 1.0)


def _esc_speeds(topics: _Topics, rotors: int) -> Series | None:
    """Return rotor speeds; an ESC names its motor by its output function, in older logs by its place."""
    data = topics("esc_status")
    if data is None:
        return None
    columns: list[NDArray[np.float64]] = []
    for rotor in range(rotors):
        place = rotor
        for i in range(_MOST_OUTPUTS // 2):
            function = data.get(f"esc[{i}].actuator_function")
            if function is not None and int(np.median(function)) == _FIRST_MOTOR + rotor:
                place = i
        rpm = data.get(f"esc[{place}].esc_rpm")
        if rpm is None:
            return None
        columns.append(np.abs(rpm.astype(np.float64)) * _RADPS_PER_RPM)  # negative: turns backwards
    return series_of(_times(data), np.stack(columns, axis=1))


def _imu(file: LogFile, topics: _Topics) -> tuple[Series | None, Series | None]:
    """Return rate and specific force in B."""
    data = topics("sensor_combined")
    if data is not None:
        gyro, accel = _columns(data, "gyro_rad", 3), _columns(data, "accelerometer_m_s2", 3)
        t_s = _times(data)
        if gyro is not None and accel is not None:
            file.topics.update(rate="sensor_combined.gyro_rad", accel="sensor_combined.accelerometer_m_s2")
            relative = data.get("accelerometer_timestamp_relative")
            later_s = 0.0 if relative is None else np.where(np.abs(relative) < 2**30, relative, 0) * _US
            return series_of(t_s, flu_from_frd(gyro)), series_of(t_s + later_s, flu_from_frd(accel))
    file.topics.update(rate="vehicle_angular_velocity", accel="vehicle_acceleration")
    found: list[Series | None] = []
    for name in ("vehicle_angular_velocity", "vehicle_acceleration"):
        data = topics(name)
        xyz = None if data is None else _columns(data, "xyz", 3)
        found.append(None if data is None or xyz is None else series_of(_times(data), flu_from_frd(xyz)))
    return found[0], found[1]


def _state(file: LogFile, topics: _Topics) -> tuple[Series | None, Series | None, Series | None]:
    """Return attitude, position and velocity of the estimator, each with its own times."""
    file.topics.update(
        pose="vehicle_attitude with vehicle_local_position", velocity="vehicle_local_position", voltage="battery_status"
    )
    data = topics("vehicle_attitude")
    q = None if data is None else _columns(data, "q", 4)
    attitude = None if data is None or q is None else series_of(_times(data), q_WB_from_q_NF(q))
    data = topics("vehicle_local_position")
    if data is None:
        file.note(
            "is missing: position and velocity cannot be predicted or judged",
            "let the logger have it (SDLOG_PROFILE bit 0)",
            topic="vehicle_local_position",
        )
        return attitude, None, None
    t_s = _times(data)
    p = np.stack([data[name].astype(np.float64) for name in ("x", "y", "z")], axis=1)
    v = np.stack([data[name].astype(np.float64) for name in ("vx", "vy", "vz")], axis=1)
    _remove_resets(file, data, t_s, p)
    for valid, columns in (("xy_valid", p[:, :2]), ("z_valid", p[:, 2:]), ("v_xy_valid", v[:, :2])):
        if valid in data:
            columns[data[valid] == 0] = np.nan
    return attitude, series_of(t_s, enu_from_ned(p)), series_of(t_s, enu_from_ned(v))


def _remove_resets(
    file: LogFile, data: dict[str, NDArray[Any]], t_s: NDArray[np.float64], p: NDArray[np.float64]
) -> None:
    """Take the jumps of the estimator's origin out of the positions `p` [n, 3], and note the last one."""
    p -= _jumped(data)
    for counter, _, _ in _RESETS:
        jumps = np.flatnonzero(np.diff(data[counter].astype(np.int64))) + 1 if counter in data else np.empty(0, np.intp)
        if len(jumps):
            message = f"jumped {len(jumps)} times, last at {t_s[jumps[-1]]:.2f} s ({counter})"
            hint = "the positions are used without the jumps; good GPS and a wait before take-off avoid them"
            file.note(message, hint, topic="vehicle_local_position")


def _jumped(data: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """Return how far the estimator's resets have moved the position so far [n, 3]."""
    moved = np.zeros((len(data["timestamp"]), 3))
    for counter, deltas, first in _RESETS:
        if counter not in data or any(name not in data for name in deltas):
            continue
        jumps = np.flatnonzero(np.diff(data[counter].astype(np.int64))) + 1
        for k, name in enumerate(deltas):
            steps = np.zeros(len(moved))
            steps[jumps] = data[name][jumps]
            moved[:, first + k] = np.cumsum(np.nan_to_num(steps))
    return moved


def _moved_by_resets(topics: _Topics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the times of the positions, and how far resets have moved them so far."""
    data = topics("vehicle_local_position")
    return (np.empty(0), np.empty((0, 3))) if data is None else (_times(data), _jumped(data))


def _voltage_field(battery: dict[str, NDArray[Any]]) -> str:
    return "voltage_v" if "voltage_v" in battery else "voltage_filtered_v"


FORMAT = Format("PX4 ULog (.ulg)", _recognises, _read)
