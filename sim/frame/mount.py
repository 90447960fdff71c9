"""Mount of a frame sensor on the vehicle, and its pose at an instant near the tick.

    q_BC = Rz(yaw) Ry(pitch) Rx(roll) q_forward       p_WC = p_WB + R_WB p_BC

Angles (0, 0, 0) look forward: the optical z axis along x of B, x to the right (-y of B), y down (-z of B). Rotations
are about the axes of B (FLU), roll first, then pitch, then yaw: yaw to the left, pitch downwards (90: straight down,
with the top of the picture forward), roll to the right.

A picture takes time. From the truth at its tick, the vehicle's pose tau later (or earlier) is

    p + v tau + a tau^2 / 2          q * exp(w tau + alpha tau^2 / 2)

with a and alpha the means over the tick just ended. This neglects the change of a and alpha: with a jerk j and a tick h
the error is about j tau h tau / 4 + j tau^3 / 6. In an oscillation of 4.3 rad/s and 27 rad/s2 the error is 0.007 mm and
0.003 degrees at tau = 8 ms, 0.02 mm and 0.009 degrees at 12 ms (tests/unit/sim/frame/test_frame_mount.py).
"""

from __future__ import annotations

from signals._kernel import det_cos, det_sin, rotate_into_world
from signals.rotation import NO_TURN, applied, cross, matrix_of, norm, product
from signals.samples import Quat, TruthState, Vec3
from signals.units import RAD_PER_DEG
from sim.frame.camera_pose import CameraPose

_ROUNDING = 1e-15  # of the cosine of 90 degrees
_FORWARD: Quat = (0.5, -0.5, 0.5, -0.5)  # optical axes to FLU: z to forward, x to right, y to down


def quaternion_of_rpy(rpy_deg: Vec3) -> Quat:
    """Return the quaternion of Rz(yaw) Ry(pitch) Rx(roll)."""
    turn = NO_TURN
    for axis in (2, 1, 0):
        half = 0.5 * rpy_deg[axis] * RAD_PER_DEG
        q = [det_cos(half), 0.0, 0.0, 0.0]
        q[axis + 1] = det_sin(half)
        turn = product(turn, (q[0], q[1], q[2], q[3]))
    return turn


class Mount:
    """Sensor frame C fixed to B. At angles (0, 0, 0), C has the optical axes if `optical`, else the axes of B."""

    def __init__(self, mount_m: Vec3, mount_rpy_deg: Vec3, *, optical: bool = True) -> None:
        self.p_BC = mount_m
        self.q_BC = product(quaternion_of_rpy(mount_rpy_deg), _FORWARD if optical else NO_TURN)

    @property
    def axis_B(self) -> Vec3:
        """The first axis of C, a unit vector in B, exact along an axis of B."""
        x, y, z = (0.0 if abs(value) < _ROUNDING else value for value in matrix_of(self.q_BC)[0::3])
        scale = norm((x, y, z))
        return (x / scale, y / scale, z / scale)

    def attitude(self, truth: TruthState) -> Quat:
        """Return q_WC at the tick."""
        return product(truth.q_WB, self.q_BC)

    def place(self, truth: TruthState) -> tuple[Vec3, Quat]:
        """Return p_WC and q_WC at the tick."""
        x, y, z = rotate_into_world(truth.q_WB, self.p_BC)
        return (truth.p_WB[0] + x, truth.p_WB[1] + y, truth.p_WB[2] + z), self.attitude(truth)

    def pose(self, truth: TruthState, tau_s: float = 0.0) -> CameraPose:
        """Return pose and velocity `tau_s` after the tick."""
        p, q, v, w_B = truth.p_WB, truth.q_WB, truth.v_WB_W, truth.w_WB_B
        if tau_s != 0.0:
            p, q, v, w_B = moved(truth, tau_s)
        R_WB = matrix_of(q)
        arm_W = applied(R_WB, self.p_BC)
        w_W = applied(R_WB, w_B)
        v_arm_W = cross(w_W, arm_W)
        return CameraPose(
            (p[0] + arm_W[0], p[1] + arm_W[1], p[2] + arm_W[2]),
            matrix_of(product(q, self.q_BC)),
            (v[0] + v_arm_W[0], v[1] + v_arm_W[1], v[2] + v_arm_W[2]),
            w_W,
        )


def moved(truth: TruthState, tau_s: float) -> tuple[Vec3, Quat, Vec3, Vec3]:
    """Return p_WB, q_WB, v_WB_W and w_WB_B `tau_s` after the tick."""
    t, half = tau_s, 0.5 * tau_s * tau_s
    p, v, a = truth.p_WB, truth.v_WB_W, truth.a_WB_W
    w, alpha = truth.w_WB_B, truth.alpha_WB_B
    x, y, z = w[0] * t + alpha[0] * half, w[1] * t + alpha[1] * half, w[2] * t + alpha[2] * half
    angle = norm((x, y, z))
    # sin(angle / 2) / angle; below 1e-4 rad the series has a relative error of 1e-10
    ratio = det_sin(0.5 * angle) / angle if angle > 1e-4 else 0.5 - angle * angle / 48.0
    turn = (det_cos(0.5 * angle), x * ratio, y * ratio, z * ratio)
    return (
        (p[0] + v[0] * t + a[0] * half, p[1] + v[1] * t + a[1] * half, p[2] + v[2] * t + a[2] * half),
        product(truth.q_WB, turn),
        (v[0] + a[0] * t, v[1] + a[1] * t, v[2] + a[2] * t),
        (w[0] + alpha[0] * t, w[1] + alpha[1] * t, w[2] + alpha[2] * t),
    )
