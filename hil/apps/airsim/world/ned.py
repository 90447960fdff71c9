"""Frames at the edge of the server: NED about an origin in W, body FRD, and geodetic positions.

Inside everything is ENU and FLU (signals.frames).
"""

from __future__ import annotations

from dataclasses import dataclass

from hil.apps.airsim.rpc.arguments import Pose, Quaternion, Vector
from hil.apps.airsim.rpc.methods import RpcError
from signals._kernel import rotate_into_body
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.geodesy import LocalFrame, Site
from signals.rotation import minus, quaternion_norm
from signals.samples import Quat, TruthState, Vec3

Kinematics = dict[str, Vector | Quaternion]


def q_WB_from_q_NF(q_NF: Quat) -> Quat:
    """Return the attitude FLU->ENU of an attitude FRD->NED."""
    return q_NF_from_q_WB(q_NF)  # the map is its own inverse


def unit_rotation(q: Quat) -> Quat:
    """Return the unit quaternion of an orientation that a client gave. Raises RpcError if it is not a rotation."""
    length = quaternion_norm(q)
    if not 1e-3 <= length <= 1e3:
        raise RpcError(
            f"the orientation is not a rotation: its length is {length:g}, and that of a unit quaternion is 1"
        )
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def body_from_W(q_WB: Quat, v_W: Vec3) -> Vec3:
    """Return a vector of W along the body's front, right and bottom."""
    return frd_from_flu(rotate_into_body(q_WB, v_W))


@dataclass(frozen=True)
class NedFrame:
    """North, east, down from a point of W."""

    origin_W: Vec3

    def from_W(self, p_W: Vec3) -> Vec3:
        """Return a point of W in this frame."""
        o = self.origin_W
        return ned_from_enu(minus(p_W, o))

    def to_W(self, p_N: Vec3) -> Vec3:
        """Return a point of this frame in W."""
        x, y, z = ned_from_enu(p_N)
        o = self.origin_W
        return (x + o[0], y + o[1], z + o[2])

    def pose(self, p_W: Vec3, q_WB: Quat) -> Pose:
        """Return a pose as AirSim gives it."""
        return Pose(Vector(*self.from_W(p_W)), Quaternion(*q_NF_from_q_WB(q_WB)))

    def kinematics(self, truth: TruthState) -> Kinematics:
        """Return AirSim's kinematics: rates and angular acceleration along the body's axes, all else in NED."""
        pose = self.pose(truth.p_WB, truth.q_WB)
        return {
            "position": pose.position,
            "orientation": pose.orientation,
            "linear_velocity": Vector(*ned_from_enu(truth.v_WB_W)),
            "angular_velocity": Vector(*frd_from_flu(truth.w_WB_B)),
            "linear_acceleration": Vector(*ned_from_enu(truth.a_WB_W)),
            "angular_acceleration": Vector(*frd_from_flu(truth.alpha_WB_B)),
        }


class Earth:
    """Place of the world's NED frame on the Earth."""

    def __init__(self, site: Site, frame: NedFrame) -> None:
        self._local, self._frame = LocalFrame(site), frame

    def geodetic(self, p_W: Vec3) -> tuple[float, float, float]:
        """Return latitude, longitude [deg] and altitude [m] of a point of W."""
        o = self._frame.origin_W
        return self._local.geodetic_from_enu(minus(p_W, o))

    def point_W(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vec3:
        """Return the point of W at a geodetic position."""
        x, y, z = self._local.enu_from_geodetic(latitude_deg, longitude_deg, altitude_m)
        o = self._frame.origin_W
        return (x + o[0], y + o[1], z + o[2])
