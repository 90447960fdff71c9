"""The MAVLink messages beside HIL_SENSOR and HIL_GPS as pure functions of samples: range finder and optical flow.

Axes and units as in `firmware_bridge.codecs.hil`: B (FLU) -> F (FRD) changes the sign of y and z, for positions and
rotations alike. Integers are rounded to nearest and saturate; a number that is not finite is refused with `CodecError`.
"""

from __future__ import annotations

import struct

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil import integer
from firmware_bridge.codecs.hil_odometry import ODOMETRY, odometry_payload
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.codecs.sensor_rotation import CUSTOM, named_rotation, rotation_to
from signals.samples import FlowSample, OdometrySample, RangeSample, Sample

HIL_OPTICAL_FLOW = MSGID["HIL_OPTICAL_FLOW"]
DISTANCE_SENSOR = MSGID["DISTANCE_SENSOR"]

_LASER = 0  # MAV_DISTANCE_SENSOR_LASER
_UNKNOWN_VARIANCE = 255
_INVALID, _MIN_QUALITY, _MAX_QUALITY = 1, 2, 100  # signal_quality; 0 means "not known"
_UNKNOWN_DISTANCE = -1.0

_pack_flow = struct.Struct("<QI5fIfhBB").pack
_pack_distance = struct.Struct("<IHHHBBBB2f4fB").pack


def distance_sensor_payload(t_ns: int, sample: RangeSample) -> bytes:
    """Return the payload of DISTANCE_SENSOR, id 0, of a laser.

    A direction without a MAV_SENSOR_ROTATION is told by the quaternion, from forward to it.
    Without a valid distance `signal_quality` is 1 (invalid). The variance saturates at 254 cm^2 (a deviation of
    15.9 cm), since 255 means "not known".
    """
    name = "DISTANCE_SENSOR"
    sigma_cm = sample.sigma_m * 1e2
    variance = _UNKNOWN_VARIANCE
    if sample.quality > 0:
        variance = integer(f"{name}.covariance", sigma_cm * sigma_cm, 0, _UNKNOWN_VARIANCE - 1)
    rotation = named_rotation(sample.axis_B)
    quaternion = (0.0, 0.0, 0.0, 0.0) if rotation is not None else rotation_to(sample.axis_B)
    return _pack_distance(
        t_ns // 1_000_000,
        integer(f"{name}.min_distance", sample.min_distance_m * 1e2, 0, 65535),
        integer(f"{name}.max_distance", sample.max_distance_m * 1e2, 0, 65535),
        integer(f"{name}.current_distance", sample.distance_m * 1e2, 0, 65535),
        _LASER,
        0,
        CUSTOM if rotation is None else rotation,
        variance,
        0.0,
        0.0,
        *quaternion,
        _INVALID if sample.quality <= 0 else min(max(sample.quality, _MIN_QUALITY), _MAX_QUALITY),
    )


def hil_optical_flow_payload(t_ns: int, sample: FlowSample) -> bytes:
    """Return the payload of HIL_OPTICAL_FLOW, id 0. Flow and gyro from B to F; a distance of -1 is not known."""
    (x, y), (gx, gy, gz) = sample.flow_rad, sample.gyro_rad
    distance = sample.distance_m if sample.distance_m >= 0.0 else _UNKNOWN_DISTANCE
    total = x + y + gx + gy + gz + sample.distance_m + sample.temperature_degc
    if total - total != 0.0:
        raise CodecError(f"HIL_OPTICAL_FLOW: a value is not a finite number, so not sent: {sample}")
    try:
        return _pack_flow(
            t_ns // 1000,
            sample.integration_ns // 1000,
            x,
            -y,
            gx,
            -gy,
            -gz,
            0,  # the distance belongs to the same instant
            distance,
            integer("HIL_OPTICAL_FLOW.temperature", sample.temperature_degc * 1e2, -32768, 32767),
            0,
            integer("HIL_OPTICAL_FLOW.quality", sample.quality, 0, 255),
        )
    except (OverflowError, struct.error) as error:
        raise CodecError(f"HIL_OPTICAL_FLOW: a value does not fit its field: {sample}") from error


def ranging_message(t_ns: int, sample: Sample) -> tuple[int, bytes]:
    """Return message id and payload of a sample of range, flow or external vision. CodecError for any other."""
    if isinstance(sample, RangeSample):
        return DISTANCE_SENSOR, distance_sensor_payload(t_ns, sample)
    if isinstance(sample, FlowSample):
        return HIL_OPTICAL_FLOW, hil_optical_flow_payload(t_ns, sample)
    if isinstance(sample, OdometrySample):
        return ODOMETRY, odometry_payload(t_ns, sample)
    raise CodecError(f"no message carries a {type(sample).__name__} to an autopilot")
