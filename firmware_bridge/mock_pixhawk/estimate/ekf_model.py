"""The mock autopilot's estimator model, written once symbolically; its derivatives are generated as C.

Nominal state x (16): q_NF (w x y z, body FRD to local NED), v_NF_N [m/s], p_NF [m], b_g [rad/s], b_a [m/s^2].
Error e (15): (dtheta [rad], dv, dp, db_g, db_a), with q_true = q (x) (1, dtheta/2)/|.| (error in the body frame) and
every other component additive: the error-state filter of Sola, "Quaternion kinematics for the error-state Kalman
filter", arXiv:1711.02508, chapters 5 and 6.

Transition over one IMU sample of length dt (gyro and specific force f are means over the sample):
    phi = (gyro - b_g) dt                   q' = q (x) exp(phi)
    a_N = R(q (x) exp(phi/2)) (f - b_a) + (0, 0, g)
    v'  = v + a_N dt                        p' = p + v dt + a_N dt^2 / 2

exp is its Taylor polynomial to the fifth order: at 2000 deg/s and 4 ms the angle is 0.14 rad and the remainder
1e-10 rad. So the generated C holds only + - * / sqrt, no C library function whose last bit depends on the CPU.

The build runs this file with the output folder of `ekf_jacobians.cpp` and `ekf_jacobians.h` (CMakeLists.txt).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import casadi as ca

STATE_SIZE = 16
ERROR_SIZE = 15
THETA, VEL, POS, GYRO_BIAS, ACCEL_BIAS = (slice(3 * i, 3 * i + 3) for i in range(5))


def quaternion_product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Hamilton product a (x) b, w-x-y-z."""
    return ca.vertcat(
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def rotation_matrix(q: ca.SX) -> ca.SX:
    """Return R with v_N = R v_F, for a unit quaternion q_NF."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def quaternion_exp(phi: ca.SX) -> ca.SX:
    """Return exp(phi [rad]) as a quaternion, by the Taylor series of cos(|phi|/2) and sin(|phi|/2)/|phi|."""
    s = ca.dot(phi, phi)
    return ca.vertcat(1 - s / 8 + s * s / 384, (0.5 - s / 48 + s * s / 3840) * phi)


def normalized(q: ca.SX) -> ca.SX:
    """Return q / |q|."""
    return q / ca.sqrt(ca.dot(q, q))


def retract(x: ca.SX, e: ca.SX) -> ca.SX:
    """Return the true state whose error against the nominal x is e."""
    return ca.vertcat(
        quaternion_product(x[0:4], normalized(ca.vertcat(1, e[THETA] / 2))),
        x[4:16] + e[3:15],
    )


def local_error(x: ca.SX, x_true: ca.SX) -> ca.SX:
    """Return e with retract(x, e) = x_true, to first order and exactly invertible: dtheta = 2 dq_xyz / dq_w."""
    conjugate = ca.vertcat(x[0], -x[1], -x[2], -x[3])
    dq = quaternion_product(conjugate, x_true[0:4])
    return ca.vertcat(2 * dq[1:4] / dq[0], x_true[4:16] - x[4:16])


def propagate(x: ca.SX, imu: ca.SX, dt: ca.SX, gravity: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Apply one IMU sample (gyro rad/s, specific force m/s^2). Return x' and the mean acceleration a_N [m/s^2]."""
    phi = (imu[0:3] - x[10:13]) * dt
    force = imu[3:6] - x[13:16]
    q_mid = quaternion_product(x[0:4], quaternion_exp(phi / 2))
    a_N = rotation_matrix(q_mid) @ force + ca.vertcat(0, 0, gravity)
    q_next = normalized(quaternion_product(x[0:4], quaternion_exp(phi)))
    x_next = ca.vertcat(q_next, x[4:7] + a_N * dt, x[7:10] + x[4:7] * dt + a_N * dt * dt / 2, x[10:16])
    return x_next, a_N


def _row_major(block: ca.SX) -> ca.SX:
    return ca.densify(ca.vec(block.T))


def transition_matrix(x: ca.SX, imu: ca.SX, dt: ca.SX, gravity: ca.SX) -> ca.SX:
    """Return F = d e' / d e at e = 0, 15x15."""
    e = ca.SX.sym("e", ERROR_SIZE)
    x_next, _ = propagate(x, imu, dt, gravity)
    x_true_next, _ = propagate(retract(x, e), imu, dt, gravity)
    jacobian = ca.jacobian(local_error(x_next, x_true_next), e)
    return ca.simplify(ca.substitute(jacobian, e, ca.SX.zeros(ERROR_SIZE)))


def functions() -> list[ca.Function]:
    """Return the functions for the native estimator. Matrices are dense row-major 3x3 blocks."""
    x = ca.SX.sym("x", STATE_SIZE)
    imu = ca.SX.sym("imu", 6)
    dt, gravity, tau = ca.SX.sym("dt"), ca.SX.sym("gravity"), ca.SX.sym("tau")
    q, field = ca.SX.sym("q", 4), ca.SX.sym("field", 3)
    force_N = ca.SX.sym("force_N", 3)

    x_next, a_N = propagate(x, imu, dt, gravity)
    predict = ca.Function(
        "ekf_predict", [x, imu, dt, gravity], [x_next, a_N], ["x", "imu", "dt", "gravity"], ["x_next", "a_N"]
    )

    F = transition_matrix(x, imu, dt, gravity)
    blocks = {
        "theta_theta": F[THETA, THETA],
        "theta_bg": F[THETA, GYRO_BIAS],
        "v_theta": F[VEL, THETA],
        "v_bg": F[VEL, GYRO_BIAS],
        "v_ba": F[VEL, ACCEL_BIAS],
        "p_theta": F[POS, THETA],
        "p_bg": F[POS, GYRO_BIAS],
        "p_ba": F[POS, ACCEL_BIAS],
    }
    transition = ca.Function(
        "ekf_transition",
        [x, imu, dt],
        [_row_major(b) for b in blocks.values()],
        ["x", "imu", "dt"],
        list(blocks),
    )

    # Heading of the magnetic field seen in NED, psi = atan2(m_E, m_N): its derivative is rational.
    dtheta = ca.SX.sym("dtheta", 3)
    q_true = quaternion_product(q, normalized(ca.vertcat(1, dtheta / 2)))
    m_N = rotation_matrix(q_true) @ field
    heading_row = ca.substitute(ca.jacobian(ca.atan2(m_N[1], m_N[0]), dtheta), dtheta, ca.SX.zeros(3))
    heading = ca.Function("ekf_heading", [q, field], [ca.densify(ca.vec(heading_row.T))], ["q", "field"], ["h_theta"])

    # A measurement of velocity and position at t - tau as a function of the error at t: the mean specific force
    # over the interval, force_N, is corrected by the attitude and accelerometer-bias errors at t.
    #   v(t - tau) = v - tau a_N,   p(t - tau) = p - tau v + tau^2/2 a_N,   a_N = R (R_hat^T force_N - db_a) + g
    dba = ca.SX.sym("dba", 3)
    a_true = rotation_matrix(q_true) @ (rotation_matrix(q).T @ force_N - dba)
    a_jacobian = [ca.substitute(ca.jacobian(a_true, s), ca.vertcat(dtheta, dba), ca.SX.zeros(6)) for s in (dtheta, dba)]
    delayed = ca.Function(
        "ekf_delayed",
        [q, force_N, tau],
        [_row_major(sign * j) for sign in (-tau, tau * tau / 2) for j in a_jacobian],
        ["q", "force_N", "tau"],
        ["v_theta", "v_ba", "p_theta", "p_ba"],
    )
    return [predict, transition, heading, delayed]


def write(folder: Path) -> None:
    """Write `ekf_jacobians.cpp` and `.h` into `folder`: CasADi's own C interface, one function per model function."""
    generator = ca.CodeGenerator("ekf_jacobians.cpp", {"cpp": True, "with_header": True})
    for function in functions():
        generator.add(function)
    foreign = set(re.findall(r"^  a\d+=.*?([A-Za-z_]\w*)\(", generator.dump(), flags=re.M)) - {"sqrt", "casadi_sq"}
    if foreign:
        raise SystemExit(f"the estimator's model calls {sorted(foreign)}: only + - * / sqrt are machine-independent")
    folder.mkdir(parents=True, exist_ok=True)
    generator.generate(f"{folder}/")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
