"""Set-points of the bench's own recordings, in which a companion, a ROS 2 node or a followed log flew.

They are the SET_POSITION_TARGET_LOCAL_NED of /mavlink/to_autopilot, about the origin of the autopilot's estimator. It
is where the estimator found itself at its start, up to metres from the truth, and follows from the median difference of
the true position and LOCAL_POSITION_NED: estimate and truth then agree on the average of the flight.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from hil.run.flight_logs.flight_log import Series
from hil.run.flight_logs.ned import enu_from_ned
from hil.run.flight_logs.set_points import Columns, SetPoints, set_points_of
from hil.run.recorder.reading import RecordedMessage
from signals.time import NS_PER_S

SENT, RECEIVED = "/mavlink/to_autopilot", "/mavlink/from_autopilot"
_HEAD = struct.Struct("<4xiIII")  # CDR header, stamp, message id, number of bytes
_SET_POINT, _ESTIMATE = MSGID["SET_POSITION_TARGET_LOCAL_NED"], MSGID["LOCAL_POSITION_NED"]
# POSITION_TARGET_TYPEMASK: the values to ignore
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW, _NO_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
_NAN = float("nan")


class OffboardRows:
    """Set-points and estimated positions among the recorded MAVLink frames."""

    def __init__(self) -> None:
        self._parsers = {SENT: FrameParser(), RECEIVED: FrameParser()}
        self._set_points: list[tuple[float, ...]] = []
        self._estimates: list[tuple[float, ...]] = []

    def add(self, message: RecordedMessage) -> None:
        """Take a message of one of the two topics."""
        wanted = _SET_POINT if message.topic == SENT else _ESTIMATE
        _, _, msgid, size = _HEAD.unpack_from(message.data)
        if msgid != wanted:
            return
        t_s = message.log_time_ns / NS_PER_S
        for frame in self._parsers[message.topic].feed(message.data[_HEAD.size : _HEAD.size + size]):
            if frame.msgid == wanted:
                self._keep(t_s, unpack(frame))

    def _keep(self, t_s: float, m: Any) -> None:
        if hasattr(m, "type_mask"):
            mask = m.type_mask
            place = (_NAN,) * 3 if mask & _NO_POSITION else (m.x, m.y, m.z)
            velocity = (_NAN,) * 3 if mask & _NO_VELOCITY else (m.vx, m.vy, m.vz)
            acceleration = (_NAN,) * 3 if mask & _NO_ACCELERATION else (m.afx, m.afy, m.afz)
            yaw_rad = _NAN if mask & _NO_YAW else m.yaw
            rate_radps = _NAN if mask & _NO_RATE else m.yaw_rate
            self._set_points.append((t_s, *place, *velocity, *acceleration, yaw_rad, rate_radps))
        else:
            self._estimates.append((t_s, m.x, m.y, m.z))

    def set_points(self, pose: Series | None) -> SetPoints | None:
        """Return the set-points in W; None if there are none, or nothing tells where they lie."""
        if not self._set_points or not self._estimates or pose is None:
            return None
        rows, estimates = np.array(self._set_points), np.array(self._estimates)
        true = np.stack([np.interp(estimates[:, 0], pose.t_s, pose.values[:, k]) for k in range(3)], axis=1)
        origin_W = np.median(true - enu_from_ned(estimates[:, 1:4]), axis=0)
        p_N = rows[:, 1:4] + enu_from_ned(origin_W[None, :])  # the map is its own inverse
        columns = Columns(rows[:, 0], p_N, rows[:, 4:7], rows[:, 7:10], rows[:, 10], rows[:, 11])
        return set_points_of("SET_POSITION_TARGET_LOCAL_NED", columns, ned=True)
