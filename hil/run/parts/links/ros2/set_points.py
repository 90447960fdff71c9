"""Set-points from ROS 2: `cmd_vel`, `cmd_pose` and `cmd_land` become desired states, which the offboard pilot flies.

    cmd_vel    geometry_msgs/Twist or TwistStamped   velocity [m/s] and rate of heading [rad/s]
    cmd_pose   geometry_msgs/PoseStamped             position [m] and heading
    cmd_land   std_msgs/Empty                        the vehicle lands, which ends the flight

A velocity is one of the vehicle unless `header.frame_id` names the world: a Twist, an empty frame_id and "base_link"
turn with the vehicle's true heading, as teleops and planners mean them. A position is one of the world. The stamp is
not used: a set-point applies from the next tick on.
"""

from __future__ import annotations

from math import atan2, cos, sin
from typing import Any, NamedTuple

from signals.desired import DesiredState
from signals.samples import Quat, TruthState

_LARGEST = 1e9  # m, m/s, ...: as for companions


def heading_of(q: Quat) -> float:
    """Return the heading of an attitude w-x-y-z, from east, counter-clockwise [rad]."""
    w, x, y, z = q
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class Frames(NamedTuple):
    """Names of the frames in which set-points may be given."""

    body: str
    worlds: tuple[str, ...]  # whose axes and origin are those of W


def desired_velocity(twist: Any, frame: str, truth: TruthState, frames: Frames) -> DesiredState:
    """Return the desired state of a Twist in a frame. Raises ValueError for another frame, or numbers out of range."""
    linear, angular = twist.linear, twist.angular
    _check_numbers(linear.x, linear.y, linear.z, angular.z)
    vx, vy = linear.x, linear.y
    if frame in ("", frames.body):
        c, s = cos(heading := heading_of(truth.q_WB)), sin(heading)
        vx, vy = c * vx - s * vy, s * vx + c * vy
    elif frame not in frames.worlds:
        raise ValueError(f"frame_id is {frame!r}; it has to be {frames.body!r} or one of {', '.join(frames.worlds)}")
    return DesiredState(v_W=(vx, vy, linear.z), yaw_rate_radps=angular.z)


def desired_pose(message: Any, frames: Frames) -> DesiredState:
    """Return the desired state of a PoseStamped. Raises ValueError as `desired_velocity`."""
    frame, p, q = message.header.frame_id, message.pose.position, message.pose.orientation
    if frame and frame not in frames.worlds:
        raise ValueError(f"frame_id is {frame!r}; a position has to be in one of {', '.join(frames.worlds)}")
    _check_numbers(p.x, p.y, p.z)
    return DesiredState(p_W=(p.x, p.y, p.z), q_WB=(q.w, q.x, q.y, q.z))


def _check_numbers(*numbers: float) -> None:
    if not all(abs(number) <= _LARGEST for number in numbers):  # also NaN
        raise ValueError(f"it has {numbers}; every number has to be finite and within {_LARGEST:g}")
