"""The MAVLink message of external vision, ODOMETRY, as a pure function of a sample.

Frames as in `firmware_bridge.codecs.hil`: from O and B (FLU) to local and body FRD the sign of y and z changes, in
positions, velocities and the vector part of quaternions alike. Of the covariances the diagonals are given, and the
rates are left to the autopilot's gyro (NaN). PX4 and ArduPilot take these frames; to ArduPilot x is north.
"""

from __future__ import annotations

from math import nan

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.messages import message_class, pack
from signals.samples import OdometrySample

_Odometry = message_class("ODOMETRY")
ODOMETRY: int = _Odometry.MSGID

_LOCAL_FRD, _BODY_FRD = 20, 12  # MAV_FRAME
_VISION = 2  # MAV_ESTIMATOR_TYPE
_QUALITY = 100  # %
_DIAGONAL = (0, 6, 11, 15, 18, 20)  # of a 6 x 6 matrix whose upper triangle is sent by rows


def odometry_payload(t_ns: int, sample: OdometrySample) -> bytes:
    """Return the payload of ODOMETRY; its time is that of the capture, at most `t_ns`. CodecError: not a number."""
    (x, y, z), (qw, qx, qy, qz), (vx, vy, vz) = sample.p_OB, sample.q_OB, sample.v_OB_B
    total = x + y + z + qw + qx + qy + qz + vx + vy + vz
    if total - total != 0.0:
        raise CodecError(f"ODOMETRY: a value is not a finite number, so not sent: {sample}")
    pose = _covariance((sample.position_sigma_m,) * 3 + (sample.attitude_sigma_rad,) * 3)
    velocity = _covariance((sample.velocity_sigma_mps,) * 3 + (nan,) * 3)
    message = _Odometry(
        time_usec=min(sample.t_capture_ns, t_ns) // 1000,
        frame_id=_LOCAL_FRD,
        child_frame_id=_BODY_FRD,
        x=x,
        y=-y,
        z=-z,
        q=(qw, qx, -qy, -qz),
        vx=vx,
        vy=-vy,
        vz=-vz,
        rollspeed=nan,
        pitchspeed=nan,
        yawspeed=nan,
        pose_covariance=pose,
        velocity_covariance=velocity,
        estimator_type=_VISION,
        quality=_QUALITY,
    )
    return pack(message)


def _covariance(deviations: tuple[float, ...]) -> tuple[float, ...]:
    entries = [0.0] * 21
    for place, deviation in zip(_DIAGONAL, deviations, strict=True):
        entries[place] = deviation * deviation
    return tuple(entries)
