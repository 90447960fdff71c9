"""The MAVLink HIL messages as pure functions of samples.

The bench uses ENU/FLU and SI; MAVLink's HIL messages use NED/FRD and scaled integers. `UNITS` states the MAVLink unit,
the factor from the sample's unit, and the frame of every field that is written here. The packers take their factors
from it, and a test compares its units with the dialect's own.

    FLU -> FRD   (x, y, z) -> (x, -y, -z)          ENU -> NED   (x, y, z) -> (y, x, -z)

Integers are rounded to nearest and saturate at their range, so that a receiver gets the nearest value that the field
can express. A number that is not finite is refused with `CodecError`, which names the field: the effect of a NaN in an
autopilot shows far from its cause. Only + - * /, comparisons and functions with the same result on every machine are
used.
"""

from __future__ import annotations

import struct
from math import isfinite, sqrt
from typing import NamedTuple

from firmware_bridge._native import read_actuator_controls
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from signals._kernel import det_atan2
from signals.samples import (
    ActuatorFrame,
    BaroSample,
    DifferentialPressureSample,
    GpsSample,
    ImuSample,
    MagSample,
)
from signals.units import DEG_PER_RAD


class FieldUnit(NamedTuple):
    """The conversion of a sample's value to a field: field = `scale` * SI value, in `unit`, axes of `frame`."""

    unit: str
    scale: float
    frame: str


_ACCEL = FieldUnit("m/s/s", 1.0, "F")
_GYRO = FieldUnit("rad/s", 1.0, "F")
_MAG = FieldUnit("gauss", 1e4, "F")
_DEGREES = FieldUnit("degE7", 1e7, "WGS-84")
_ALTITUDE = FieldUnit("mm", 1e3, "MSL")
_SPEED_N = FieldUnit("cm/s", 1e2, "N")
_MICROSECONDS = FieldUnit("us", 1e-3, "-")

UNITS: dict[str, dict[str, FieldUnit]] = {
    "HIL_SENSOR": {
        "time_usec": _MICROSECONDS,
        "xacc": _ACCEL,
        "yacc": _ACCEL,
        "zacc": _ACCEL,
        "xgyro": _GYRO,
        "ygyro": _GYRO,
        "zgyro": _GYRO,
        "xmag": _MAG,
        "ymag": _MAG,
        "zmag": _MAG,
        "abs_pressure": FieldUnit("hPa", 1e-2, "-"),
        "temperature": FieldUnit("degC", 1.0, "-"),
        "diff_pressure": FieldUnit("hPa", 1e-2, "-"),
    },
    "HIL_GPS": {
        "time_usec": _MICROSECONDS,
        "lat": _DEGREES,
        "lon": _DEGREES,
        "alt": _ALTITUDE,
        # The dialect calls these dilutions of precision; PX4 reads them as 1-sigma accuracy in centimetres.
        "eph": FieldUnit("", 1e2, "-"),
        "epv": FieldUnit("", 1e2, "-"),
        "vel": FieldUnit("cm/s", 1e2, "-"),
        "vn": _SPEED_N,
        "ve": _SPEED_N,
        "vd": _SPEED_N,
        "cog": FieldUnit("cdeg", 1e2, "N"),
    },
}

# HIL_SENSOR.fields_updated: PX4 takes a group only if all of its bits are set.
FIELDS_ACCEL = 0x7
FIELDS_GYRO = 0x38
FIELDS_MAG = 0x1C0
FIELDS_BARO = 0x1A00  # abs_pressure, pressure_alt, temperature
FIELDS_DIFF_PRESSURE = 0x400
_FIELDS_IMU = FIELDS_ACCEL | FIELDS_GYRO

UNKNOWN_U16 = 65535  # HIL_GPS eph, epv, vel, cog: "not known"
_MODE_ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED

HIL_SENSOR = MSGID["HIL_SENSOR"]
HIL_GPS = MSGID["HIL_GPS"]
HIL_ACTUATOR_CONTROLS = MSGID["HIL_ACTUATOR_CONTROLS"]

_pack_sensor = struct.Struct("<Q13fIB").pack
_pack_gps = struct.Struct("<QiiiHHHhhhHBBBH").pack
_new_tuple = tuple.__new__  # without the calls of a NamedTuple's own

_GAUSS = UNITS["HIL_SENSOR"]["xmag"].scale
_HPA = UNITS["HIL_SENSOR"]["abs_pressure"].scale
_DEGE7 = UNITS["HIL_GPS"]["lat"].scale
_MM = UNITS["HIL_GPS"]["alt"].scale
_CM = UNITS["HIL_GPS"]["eph"].scale
_CMPS = UNITS["HIL_GPS"]["vn"].scale
_CDEG = UNITS["HIL_GPS"]["cog"].scale


def hil_sensor_payload(
    t_ns: int,
    imu: ImuSample | None,
    mag: MagSample | None,
    baro: BaroSample | None,
    pitot: DifferentialPressureSample | None = None,
) -> bytes:
    """Return the payload of HIL_SENSOR, id 0, at `t_ns`. `fields_updated` has the groups of the given samples.

    Accel and gyro [m/s2, rad/s] and field [T -> gauss] from B (FLU) to F (FRD); pressures Pa -> hPa. The temperature is
    the barometer's.
    """
    if imu is not None:
        ax, ay, az = imu[3]
        gx, gy, gz = imu[4]
        fields = _FIELDS_IMU
    else:
        ax = ay = az = gx = gy = gz = 0.0
        fields = 0
    if mag is not None:
        mx, my, mz = mag[3]
        fields |= FIELDS_MAG
    else:
        mx = my = mz = 0.0
    if baro is not None:
        pressure, altitude, temperature = baro[3], baro[4], baro[5]
        fields |= FIELDS_BARO
    else:
        pressure = altitude = temperature = 0.0
    difference = 0.0
    if pitot is not None:
        difference = pitot[3]
        fields |= FIELDS_DIFF_PRESSURE
    # x - x is 0 for every finite x and NaN for NaN and infinity: one test for all thirteen.
    total = ax + ay + az + gx + gy + gz + mx + my + mz + pressure + altitude + temperature + difference
    if total - total != 0.0:
        raise CodecError(_not_finite(imu, mag, baro, pitot))
    try:
        return _pack_sensor(
            t_ns // 1000,
            ax,
            -ay,
            -az,
            gx,
            -gy,
            -gz,
            mx * _GAUSS,
            -my * _GAUSS,
            -mz * _GAUSS,
            pressure * _HPA,
            difference * _HPA,
            altitude,
            temperature,
            fields,
            0,
        )
    except OverflowError as error:
        raise CodecError(f"HIL_SENSOR: a value does not fit a 32-bit float: {imu} {mag} {baro} {pitot}") from error


def _not_finite(
    imu: ImuSample | None, mag: MagSample | None, baro: BaroSample | None, pitot: DifferentialPressureSample | None
) -> str:
    """Name the sensor values that are NaN or infinite."""
    values: list[tuple[str, float]] = []
    if imu is not None:
        values += [(f"imu.accel_mps2[{i}]", v) for i, v in enumerate(imu.accel_mps2)]
        values += [(f"imu.gyro_radps[{i}]", v) for i, v in enumerate(imu.gyro_radps)]
    if mag is not None:
        values += [(f"mag.field_tesla[{i}]", v) for i, v in enumerate(mag.field_tesla)]
    if baro is not None:
        values += [(f"baro.{name}", getattr(baro, name)) for name in BaroSample._fields[3:]]
    if pitot is not None:
        values.append(("pitot.differential_pressure_pa", pitot.differential_pressure_pa))
    bad = [f"{name} = {value!r}" for name, value in values if not isfinite(value)]
    return f"HIL_SENSOR: {', '.join(bad) or 'the values overflow'}: not a finite number, so not sent"


def integer(field: str, value: float, low: int, high: int) -> int:
    """Return `value` rounded to nearest and limited to [low, high]. CodecError if it is not finite."""
    if value - value != 0.0:
        raise CodecError(f"{field} = {value!r}: not a finite number, so not sent")
    return low if value < low else high if value > high else round(value)


def _i32(field: str, value: float) -> int:
    return integer(field, value, -(2**31), 2**31 - 1)


def _i16(field: str, value: float) -> int:
    return integer(field, value, -(2**15), 2**15 - 1)


def _u16_known(field: str, value: float) -> int:
    """Return an unsigned 16-bit value below the one that means "not known"."""
    return integer(field, value, 0, UNKNOWN_U16 - 1)


def _accuracy_cm(accuracy_m: float) -> int:
    """Return the 1-sigma accuracy [m] in cm, or "not known" if it is not finite or not positive."""
    if not (accuracy_m > 0.0 and accuracy_m - accuracy_m == 0.0):
        return UNKNOWN_U16
    return _u16_known("HIL_GPS accuracy", accuracy_m * _CM)


# Below this speed a course is noise, and real receivers report it as not known.
_COURSE_MIN_SPEED_MPS = 0.1


def hil_gps_payload(t_ns: int, gps: GpsSample) -> bytes:
    """Return the payload of HIL_GPS, id 0. Position deg -> degE7, altitude and velocity m -> mm, cm/s, ENU -> NED.

    `eph` and `epv` carry the accuracy in cm, 65535 where it is not known; `vel` is the horizontal speed.
    """
    v_E, v_N, v_U = gps.v_W
    speed = sqrt(v_N * v_N + v_E * v_E)
    if speed - speed == 0.0 and speed >= _COURSE_MIN_SPEED_MPS:
        course = round(det_atan2(v_E, v_N) * DEG_PER_RAD * _CDEG) % 36000
    else:
        course = UNKNOWN_U16
    return _pack_gps(
        t_ns // 1000,
        _i32("HIL_GPS.lat", gps.latitude_deg * _DEGE7),
        _i32("HIL_GPS.lon", gps.longitude_deg * _DEGE7),
        _i32("HIL_GPS.alt", gps.altitude_m * _MM),
        _accuracy_cm(gps.horizontal_accuracy_m),
        _accuracy_cm(gps.vertical_accuracy_m),
        _u16_known("HIL_GPS.vel", speed * _CMPS),
        _i16("HIL_GPS.vn", v_N * _CMPS),
        _i16("HIL_GPS.ve", v_E * _CMPS),
        _i16("HIL_GPS.vd", -v_U * _CMPS),
        course,
        gps.fix_type,
        min(gps.satellites, 254),
        0,
        0,
    )


def actuator_frame(tick: int, frame: Frame) -> ActuatorFrame:
    """Return the commands of a HIL_ACTUATOR_CONTROLS frame for `tick`. `t_ns` is the message's own time.

    CodecError if a control is not finite or outside -1..1 (0..1 for motors; servos may be negative).
    """
    t_us, controls, mode, in_range = read_actuator_controls(frame[4])
    if not in_range:
        bad = {i: c for i, c in enumerate(controls) if not -1.0 <= c <= 1.0}
        raise CodecError(f"HIL_ACTUATOR_CONTROLS at {t_us} us: controls out of -1..1: {bad}")
    return _new_tuple(ActuatorFrame, (tick, t_us * 1000, controls, mode & _MODE_ARMED != 0, mode))
