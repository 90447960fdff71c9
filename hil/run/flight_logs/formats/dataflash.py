"""ArduPilot's DataFlash (.bin), indexed by pymavlink and decoded by columns.

    motors      ESC (rpm) if every motor reports, else RCOU (us) by the outputs' functions and MOT_PWM_MIN and _MAX,
                made faster by RATE (ardupilot_mixing.py)
    rate, accel IMU, first instance, without INS_GYRO_FILTER and INS_ACCEL_FILTER, in one band with the commands
                (unfiltered.py)
    pose        attitude of XKQ, else XKF1, else ATT; position and velocity of XKF1, else POS and GPS
    voltage     BAT, first instance
    set-points  PSCN, PSCE, PSCD, ATT.DesYaw (dataflash_set_points.py), wind the estimator's

pymavlink yields messages one by one, which takes a minute for five minutes at 400 Hz; here its index of offsets becomes
columns with a numpy record type per message. ArduPilot numbers motors by its frames; firmware_bridge's table of frames
says which rotor of the vehicle file is which motor.
"""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.links.ardupilot.frames import FIRST_MOTOR_FUNCTION, frame_of
from hil.run.flight_logs.ardupilot_mixing import faster_commands
from hil.run.flight_logs.columns_of_time import pose_of, series_of
from hil.run.flight_logs.dataflash_set_points import dataflash_other_vehicle, dataflash_set_points, dataflash_wind
from hil.run.flight_logs.flight_log import FlightLog, MotorsKind, Series
from hil.run.flight_logs.log_format import Format, LogFile
from hil.run.flight_logs.message_columns import MessageColumns
from hil.run.flight_logs.ned import enu_from_ned, flu_from_frd, q_WB_from_q_NF, quaternion_of_euler
from hil.run.flight_logs.unfiltered import LowPass, band_of, within_band

_HEAD = b"\xa3\x95"
_HEAD_BYTES = 3
# ArduPilot's characters of a format: numpy type and factor.
_TYPES: Mapping[str, tuple[str, float]] = {
    "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0), "I": ("<u4", 1.0),
    "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0), "c": ("<i2", 0.01), "C": ("<u2", 0.01),
    "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "M": ("u1", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "a": ("V64", 1.0),
}  # fmt: skip
_US = 1e-6
_RADPS_PER_RPM = 2.0 * math.pi / 60.0
_MOST_OUTPUTS = 14
_EARTH_RADIUS_M = 6378137.0
_MOTORS_HINT = "set LOG_BITMASK with RCOUT (bit 10), fast attitude (bit 0) and fast IMU (bit 18), and fly again"
_SITL_ACCEL_HZ = 1000.0  # INS_SITL_SENSOR_A
_FAST_HZ = 8000.0  # of a sensor whose rate is not logged: the filter is then as good as continuous
_MOST_CUTOFF = 0.4  # of the rate, DigitalBiquadFilter::compute_params
_LEAST_MOTOR_HZ = 45.0  # below it a motor's lag, typically 0.02 to 0.05 s, hides between two samples


class _Messages:
    """Messages of a log as columns."""

    def __init__(self, file: LogFile) -> None:
        from pymavlink.DFReader import DFReader_binary

        self._file = file
        with _printed() as printed:
            reader = DFReader_binary(str(file.path))
            printed.seek(0)
            self.damaged_bytes = sum(1 for _ in printed)
        try:
            self._bytes = np.frombuffer(bytes(reader.data_map), np.uint8)
            self._formats = {f.name: f for f in reader.formats.values()}
            self._offsets = {f.name: np.asarray(reader.offsets[f.type], np.int64) for f in reader.formats.values()}
        finally:
            reader.filehandle.close()

    def __call__(self, name: str, instance: int | None = None) -> MessageColumns | None:
        """Return the columns of a message, of its one `instance` if it has several; None without any."""
        item, offsets = self._formats.get(name), self._offsets.get(name)
        if item is None or offsets is None:
            return None
        offsets = offsets[offsets + item.len <= len(self._bytes)]
        declared = len(item.columns) == len(item.format) and len(set(item.columns)) == len(item.columns)
        if not len(offsets) or not declared or any(c not in _TYPES for c in item.format):
            return None  # declared by a damaged part of the log
        record = np.dtype([(column, _TYPES[c][0]) for column, c in zip(item.columns, item.format, strict=True)])
        if record.itemsize + _HEAD_BYTES != item.len:
            return None
        places = offsets[:, None] + np.arange(_HEAD_BYTES, item.len)
        rows = np.ascontiguousarray(self._bytes[places]).view(record).ravel()
        values = {
            column: rows[column] if _TYPES[c][1] == 1.0 else rows[column] * _TYPES[c][1]
            for column, c in zip(item.columns, item.format, strict=True)
        }
        columns = MessageColumns(values, self._file, name)
        which = next((columns[c] for c in ("I", "Instance", "C") if c in columns), None)
        if instance is None or which is None:
            return columns
        kept = which == instance
        if not kept.any():
            return None
        return MessageColumns({column: x[kept] for column, x in columns.items()}, self._file, name)

    @property
    def names(self) -> list[str]:
        return [name for name, offsets in self._offsets.items() if len(offsets)]


@contextlib.contextmanager
def _printed() -> Iterator[IO[bytes]]:
    """Catch the standard error of the process: pymavlink's indexer in C prints a line for each damaged byte."""
    with tempfile.TemporaryFile() as caught:
        try:
            kept = os.dup(2)
        except OSError:  # closed
            yield caught
            return
        try:
            os.dup2(caught.fileno(), 2)
            with contextlib.redirect_stderr(None), contextlib.redirect_stdout(None):
                yield caught
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _recognises(head: bytes, path: Path) -> bool:
    return head.startswith(_HEAD) or path.suffix.lower() == ".bin"


def _read(file: LogFile) -> FlightLog:
    with open(file.path, "rb") as opened:
        if opened.read(2) != _HEAD:
            raise file.refuse("is named .bin and is no DataFlash log", "take the log from LOGS of the vehicle's card")
    try:
        messages = _Messages(file)
    except Exception as error:  # pymavlink raises bare exceptions for damaged files
        raise file.refuse(f"is no readable DataFlash log ({error})", "copy it from the vehicle again") from error
    if messages.damaged_bytes:
        hint = "copy it from the vehicle again; what is whole is used"
        file.note(f"has {messages.damaged_bytes} damaged bytes", hint)
    if other := dataflash_other_vehicle(messages):
        raise file.refuse(f"is the log of {other}", "name the log of a multirotor", topic="MSG")
    parameters = _parameters(messages)
    motors, kind = _motors(file, messages, parameters)
    file.topics.update(rate="IMU.Gyr", accel="IMU.Acc", pose="XKQ with XKF1", velocity="XKF1", voltage="BAT")
    imu = messages("IMU", 0)
    rate = accel = None
    if imu is not None:
        t_s = imu["TimeUS"] * _US
        rate = series_of(t_s, flu_from_frd(_stack(imu, "GyrX", "GyrY", "GyrZ")))
        accel = series_of(t_s, flu_from_frd(_stack(imu, "AccX", "AccY", "AccZ")))
        gyro_filter, accel_filter = _low_passes(imu, parameters)
        filters = [x for x in (gyro_filter, accel_filter) if x is not None]
        band_hz = band_of(filters, float(np.median(np.diff(t_s)))) if len(t_s) > 1 else 0.0
        rate, accel = within_band(rate, band_hz, gyro_filter), within_band(accel, band_hz, accel_filter)
        if kind == "command" and _rate_hz(motors) > 2.0 * band_hz:
            motors = _in_band(motors, band_hz)
    attitude = _attitude(messages)
    position, velocity = _motion(messages)
    battery = messages("BAT", 0)
    voltage = None if battery is None else series_of(battery["TimeUS"] * _US, battery["Volt"])
    _check_clock(file, messages)
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
        set_points=dataflash_set_points(messages),
        wind=dataflash_wind(messages),
    )


def _low_passes(
    imu: Mapping[str, NDArray[Any]], parameters: Mapping[str, float]
) -> tuple[LowPass | None, LowPass | None]:
    """Return the filters of gyro and accelerometer.

    ArduPilot computes the gyro's coefficients again while it measures the sensor's rate, for 30 s, and the
    accelerometer's once, at start, for the rate that the driver states (update_gyro_filters, update_accel_filters in
    AP_InertialSensor_Backend.cpp). Drivers of chips state what they deliver; SITL's states 1000 Hz and delivers
    SIM_RATE_HZ, so that at 400 Hz its accelerometer's 20 Hz are 8 Hz.
    """
    found: list[LowPass | None] = []
    for name, column in (("INS_GYRO_FILTER", "GHz"), ("INS_ACCEL_FILTER", "AHz")):
        cutoff_hz = parameters.get(name, 0.0)
        rate_hz = float(np.median(imu[column])) if column in imu else 0.0
        rate_hz = rate_hz if rate_hz > 0.0 else _FAST_HZ
        simulated = column == "AHz" and "SIM_RATE_HZ" in parameters
        designed_hz = max(_SITL_ACCEL_HZ, rate_hz) if simulated else rate_hz
        cutoff_hz = min(cutoff_hz, _MOST_CUTOFF * designed_hz)
        found.append(LowPass(cutoff_hz, designed_hz, rate_hz) if cutoff_hz > 0.0 else None)
    return found[0], found[1]


def _in_band(commands: Series, band_hz: float) -> Series:
    found = within_band(commands, band_hz)
    assert found is not None
    return Series(found.t_s, np.clip(found.values, 0.0, 1.0))


def _stack(columns: Mapping[str, NDArray[Any]], *names: str) -> NDArray[np.float64]:
    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)


def _parameters(messages: _Messages) -> dict[str, float]:
    columns = messages("PARM")
    if columns is None:
        return {}
    names = [bytes(name).rstrip(b"\0").decode(errors="replace") for name in columns["Name"]]
    return dict(zip(names, columns["Value"].astype(float).tolist(), strict=True))


def _check_clock(file: LogFile, messages: _Messages) -> None:
    """Refuse a file of two boots: its clock starts again."""
    for name in ("IMU", "RCOU"):
        columns = messages(name)
        back = None if columns is None else np.flatnonzero(np.diff(columns["TimeUS"].astype(np.int64)) < -1_000_000)
        if columns is not None and back is not None and len(back):
            at_s = float(columns["TimeUS"][back[0]]) * _US
            message = f"goes back in time after {at_s:.1f} s: the file holds two boots"
            raise file.refuse(message, "set LOG_FILE_DSRMROT=1 for a file per flight, or split it", topic=name)


def _motors(file: LogFile, messages: _Messages, parameters: Mapping[str, float]) -> tuple[Series, MotorsKind]:
    vehicle = file.vehicle
    count = len(vehicle.rotors)
    frame = frame_of([(r.position_m[0], r.position_m[1], r.spin.sign) for r in vehicle.rotors])
    rotor_of_motor = frame.rotors if frame is not None else tuple(range(count))
    functions = {
        int(parameters.get(f"SERVO{n + 1}_FUNCTION", -1)) - FIRST_MOTOR_FUNCTION: n for n in range(_MOST_OUTPUTS)
    }
    logged = sum(1 for motor in functions if 0 <= motor < 8)
    if logged and logged != count:
        message = f"drives {logged} motors, and the vehicle {vehicle.name!r} has {count} rotors"
        raise file.refuse(message, "name the file of the vehicle that made this log", topic="SERVOn_FUNCTION")
    output_of_rotor = {rotor: functions.get(motor, motor) for motor, rotor in enumerate(rotor_of_motor)}
    found = _esc_speeds(messages, output_of_rotor, count)
    if found is not None:
        file.topics.update(motors="ESC")
        return found, "speed_radps"
    file.topics.update(motors="RCOU")
    columns = messages("RCOU")
    if columns is None or any(f"C{output_of_rotor[r] + 1}" not in columns for r in range(count)):
        raise file.refuse(f"has no motor outputs of {count} rotors: neither RCOU nor ESC", _MOTORS_HINT)
    low, high = parameters.get("MOT_PWM_MIN", 1000.0), parameters.get("MOT_PWM_MAX", 2000.0)
    pwm = np.stack([columns[f"C{output_of_rotor[r] + 1}"].astype(np.float64) for r in range(count)], axis=1)
    commands = np.clip((pwm - low) / max(high - low, 1.0), 0.0, 1.0)
    series = series_of(columns["TimeUS"] * _US, commands)
    assert series is not None  # PWM is finite
    if _rate_hz(series) < _LEAST_MOTOR_HZ:
        rate = messages("RATE")
        loops = None
        if rate is not None:
            loops = series_of(rate["TimeUS"] * _US, _stack(rate, "ROut", "POut", "YOut", "AOut"))
        if loops is not None and _rate_hz(loops) >= _LEAST_MOTOR_HZ:
            faster = faster_commands(series, loops, parameters)
            if faster is not None:
                file.topics.update(motors="RATE, mixed as RCOU")
                return faster, "command"
        message = f"has {_rate_hz(series):.0f} values per second; the motors' lags need more"
        file.note(message, _MOTORS_HINT, topic="RCOU")
    return series, "command"


def _rate_hz(series: Series) -> float:
    return 1.0 / float(np.median(np.diff(series.t_s))) if len(series) > 1 else 0.0


def _esc_speeds(messages: _Messages, output_of_rotor: Mapping[int, int], count: int) -> Series | None:
    """Return rotor speeds at the times of the first ESC; the others report within the same cycle."""
    columns: list[NDArray[np.float64]] = []
    times: list[NDArray[np.float64]] = []
    for rotor in range(count):
        data = messages("ESC", output_of_rotor[rotor])
        if data is None or len(data["TimeUS"]) < 2:
            return None
        times.append(data["TimeUS"] * _US)
        columns.append(np.abs(data["RPM"].astype(np.float64)) * _RADPS_PER_RPM)
    at_s = times[0]
    values = np.stack([np.interp(at_s, t, c) for t, c in zip(times, columns, strict=True)], axis=1)
    return series_of(at_s, values) if values.max() > 0.0 else None


def _attitude(messages: _Messages) -> Series | None:
    data = messages("XKQ", 0)
    if data is not None:
        return series_of(data["TimeUS"] * _US, q_WB_from_q_NF(_stack(data, "Q1", "Q2", "Q3", "Q4")))
    data = messages("XKF1", 0)
    data = data if data is not None else messages("ATT")
    if data is None:
        return None
    angles = np.radians(_stack(data, "Roll", "Pitch", "Yaw"))
    return series_of(data["TimeUS"] * _US, q_WB_from_q_NF(quaternion_of_euler(angles)))


def _motion(messages: _Messages) -> tuple[Series | None, Series | None]:
    data = messages("XKF1", 0)
    if data is not None:
        t_s = data["TimeUS"] * _US
        p, v = _stack(data, "PN", "PE", "PD"), _stack(data, "VN", "VE", "VD")
        return series_of(t_s, enu_from_ned(p)), series_of(t_s, enu_from_ned(v))
    data = messages("POS")
    if data is None:
        return None, None
    latitude, longitude = np.radians(data["Lat"]), np.radians(data["Lng"])
    east = (longitude - longitude[0]) * np.cos(latitude[0]) * _EARTH_RADIUS_M
    north = (latitude - latitude[0]) * _EARTH_RADIUS_M
    up = data["Alt"].astype(np.float64) - float(data["Alt"][0])
    return series_of(data["TimeUS"] * _US, np.stack([east, north, up], axis=1)), None


FORMAT = Format("ArduPilot DataFlash (.bin)", _recognises, _read)
