"""Set-points as messages. The type masks name exactly what is not given; nothing given is left to the autopilot.

NED and FRD; yaw from north, clockwise, in [-pi, pi]. PX4 and ArduPilot agree on all of it but for the thrust of
SET_ATTITUDE_TARGET, which ArduPilot takes as a climb rate (0.5: none) unless GUID_OPTIONS has bit 3 (8) set.
"""

from __future__ import annotations

from math import pi
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.wire import Wire
from hil.signals.desired import DesiredState
from hil.signals.frames import frd_from_flu, q_NF_from_q_WB
from hil.signals.rotation import yaw_of
from hil.signals.samples import Vec3

_PositionTarget = message_class("SET_POSITION_TARGET_LOCAL_NED")
_AttitudeTarget = message_class("SET_ATTITUDE_TARGET")

_LOCAL_NED = 1  # MAV_FRAME
# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK: what to ignore
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW, _NO_YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
_NO_RATES, _NO_ATTITUDE = 0x07, 0x80

_NOTHING: Vec3 = (0.0, 0.0, 0.0)


def position_target(
    wire: Wire,
    t_ns: int,
    *,
    p_N: Vec3 | None = None,
    v_N: Vec3 | None = None,
    a_N: Vec3 | None = None,
    yaw_rad: float | None = None,
    yaw_rate_radps: float | None = None,
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED. Angles as the autopilot has them."""
    mask = 0
    for value, bits in (
        (p_N, _NO_POSITION),
        (v_N, _NO_VELOCITY),
        (a_N, _NO_ACCELERATION),
        (yaw_rad, _NO_YAW),
        (yaw_rate_radps, _NO_YAW_RATE),
    ):
        if value is None:
            mask |= bits
    return _PositionTarget(
        _boot_ms(t_ns),
        wire.target_sysid,
        wire.target_compid,
        _LOCAL_NED,
        mask,
        *(p_N or _NOTHING),
        *(v_N or _NOTHING),
        *(a_N or _NOTHING),
        yaw_rad or 0.0,
        yaw_rate_radps or 0.0,
    )


def attitude_target(wire: Wire, t_ns: int, desired: DesiredState) -> Any:
    """SET_ATTITUDE_TARGET of a desired state with thrust."""
    q_WB, w_B = desired.q_WB, desired.w_B
    return _AttitudeTarget(
        _boot_ms(t_ns),
        wire.target_sysid,
        wire.target_compid,
        (_NO_ATTITUDE if q_WB is None else 0) | (_NO_RATES if w_B is None else 0),
        (1.0, 0.0, 0.0, 0.0) if q_WB is None else q_NF_from_q_WB(q_WB),
        *(_NOTHING if w_B is None else frd_from_flu(w_B)),
        desired.thrust,
    )


def heading_N(desired: DesiredState) -> float | None:
    """The yaw that is wanted, from north, clockwise: of `yaw_rad`, or else of `q_WB`."""
    yaw_rad = desired.yaw_rad
    if yaw_rad is None:
        if desired.q_WB is None:
            return None
        yaw_rad = yaw_of(desired.q_WB)
    angle = 0.5 * pi - yaw_rad
    if -pi <= angle <= pi:
        return angle
    return angle - 2.0 * pi * ((angle + pi) // (2.0 * pi))


def _boot_ms(t_ns: int) -> int:
    return t_ns // 1_000_000 & 0xFFFFFFFF
