"""Motion of the vehicle between two samples, and what its sensors read, with exact derivatives (CasADi).

State z = [p_WB, q_WB, v_WB_W, w_WB_B, (rotor speeds O,) a_W, b_B]; a_W [m/s2] and b_B [rad/s2] are accelerations that
the model does not explain, constant within a window.
    dp = v,  dq = q (0, w) / 2,  dv = R F / m + g + a,  dw = I^-1 (M - w x I w) + b
    logged speeds     O(t) = O_logged(t + d)                                       d the motors' delay in the log
    logged commands   dO = (c(t + d) - O) / tau, tau up or down
                      c = O_max (1 + e (V / V_nom - 1)) sqrt(f u^2 + (1 - f) u)
A step is one of the classical Runge-Kutta method; `halving_error` says what that costs.
The filter's model has the motors' delay d as an unknown, by their slope. The fit's has none: it lives on the motors'
clock, where commands change between steps, and d moves the times at which the sensors are read (integration.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from hil.apps.identify._programs import StraightLine
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.rotor_loads import Flow, Inflow, exact_jacobian, put_in, wrench
from hil.apps.identify.straight_line import straight_line
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.vehicle import Vehicle

P, Q, V, W, O = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13), 13  # noqa: E741
RATE, ACCEL, POSITION, ATTITUDE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15)
OUTPUTS = 15
SERIES = 4  # with times of their own: rate, accel, pose, velocity


@dataclass(frozen=True)
class Differentiated:
    """A function `value(z, s, ...)` and the nonzeros of its Jacobians to z and to s, for many instants at once."""

    function: Any
    by_z: tuple[np.ndarray, np.ndarray]
    by_s: tuple[np.ndarray, np.ndarray]
    shape: tuple[int, int, int]

    @cached_property
    def program(self) -> StraightLine:
        """The function for many instants; it writes values [W, n], and Jacobians [W, n nz] and [W, n ns] with zeros."""
        (row_z, col_z), (row_s, col_s) = self.by_z, self.by_s
        n, nz, ns = self.shape
        return straight_line(self.function, [np.arange(n), row_z * nz + col_z, row_s * ns + col_s])


@dataclass(frozen=True)
class Reading:
    """Measurement of a sensor, `y(z, theta, u, q_measured)` with its Jacobians.

    Rate; specific force, of the motors at the start of u; position and rotation vector of q_measured^-1 q, which is to
    be zero; or velocity.
    """

    function: Differentiated
    outputs: slice
    states: slice  # which it depends on
    series: int  # of `SERIES`


@dataclass(frozen=True)
class FlightModel:
    """Functions of casadi, one instant each.

    `rates[stage](z, theta, u) -> dz/dt` at the start, middle and end of a step, with Jacobians; `step(z, theta, u)`;
    theta = [vehicle's unknowns s, log's unknowns s];
    u = 3 instants x (motor signals, slopes, curvatures), V / V_nom, and the ground's height.
    `readings` are of a state at their own instant; when that is, and the delays, is the caller's.
    """

    rates: list[Differentiated]
    step: Any
    readings: tuple[Reading, ...]
    forces: Any
    states: int
    inputs: int
    rotors: int
    kind: Literal["speed_radps", "command"]
    step_s: float

    @property
    def disturbance(self) -> int:
        """Index of the first of the six unexplained accelerations in z."""
        return self.states - 6


def _cross_matrix_rotate(q: Any, u: Any) -> Any:
    r = q[1:4]
    t = 2 * ca.cross(r, u)
    return u + q[0] * t + ca.cross(r, t)


def _product(a: Any, b: Any) -> Any:
    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:4], b[1:4]), a[0] * b[1:4] + b[0] * a[1:4] + ca.cross(a[1:4], b[1:4]))


def _conjugate(q: Any) -> Any:
    return ca.vertcat(q[0], -q[1:4])


def make_model(
    vehicle: Vehicle, unknowns: list[at.Unknown], *, kind: Literal["speed_radps", "command"], step_s: float,
    delayed: bool = False,
) -> FlightModel:  # fmt: skip
    """Return the model of a vehicle about its `unknowns` (`vehicle_unknowns`), for a grid of `step_s`.

    Without `delayed` the motors' delay moves no state: the caller moves the readings, whose motors have their slope.
    """
    n = len(vehicle.rotors)
    states = 19 + (n if kind == "command" else 0)
    z, s, inputs = ca.SX.sym("z", states), ca.SX.sym("s", at.VEHICLE_COUNT + at.LOG_COUNT), 9 * n + 2
    u = ca.SX.sym("u", inputs)
    p = ca.vertcat(
        *(
            k.floor + (k.start - k.floor) * ca.exp(s[i]) if k.law == "exp" else k.start + s[i]
            for i, k in enumerate(unknowns[: at.VEHICLE_COUNT])
        )
    )
    of_log = s[at.VEHICLE_COUNT :]
    delay, wind = of_log[at.MOTOR_DELAY], of_log[at.WIND : at.WIND + 3]
    inertia = p[at.INERTIA : at.INERTIA + 3]
    gravity = ca.DM([0.0, 0.0, -STANDARD_GRAVITY_MPS2])
    c = vehicle.rotor_constants

    def motors(x: Any, stage: int, delay: Any) -> tuple[Any, Any]:
        """Rotor speeds and their slopes at stage 0 (start), 1 (middle) or 2 (end) of the step."""
        signal, slope, bend = (u[9 * 0 + stage * 3 * n + i * n : stage * 3 * n + (i + 1) * n] for i in range(3))
        if kind == "speed_radps":
            return signal + slope * delay, slope + bend * delay
        command = ca.fmin(ca.fmax(signal + slope * delay, 1e-6), 1.0)
        f = p[at.SHAPE]
        target = (
            c.max_speed_radps
            * (1 + p[at.VOLTAGE] * (u[9 * n] - 1))
            * ca.sqrt(ca.fmax(f * command * command + (1 - f) * command, 1e-9))
        )
        speed = x[O : O + n]
        return speed, (target - speed) / ca.if_else(target > speed, p[at.TAU_UP], p[at.TAU_DOWN])

    def force_and_moment(x: Any, stage: int, delay: Any, *, exact: bool = False) -> tuple[Any, Any, Any, Inflow]:
        back = _conjugate(x[Q])
        air_B = _cross_matrix_rotate(back, x[V] - wind)
        speed, slope = motors(x, stage, delay)
        force = -p[at.LINEAR_DRAG : at.LINEAR_DRAG + 3] * air_B
        force -= p[at.QUADRATIC_DRAG : at.QUADRATIC_DRAG + 3] * ca.sqrt(ca.dot(air_B, air_B) + 1e-6) * air_B
        k = p[at.AIR_MOMENT : at.AIR_MOMENT + 2]  # the hull's place, and flapping blades: back against the flow
        moment = ca.vertcat(k[0] * air_B[1], -k[1] * air_B[0], 0)
        flow = Flow(air_B, x[W], _cross_matrix_rotate(back, ca.DM([0, 0, 1])), x[P][2] - u[9 * n + 1])
        f, m, inflow = wrench(vehicle, p, flow, speeds=speed, slopes=slope, exact_inflow=exact)
        return force + f, moment + m, slope, inflow

    def derivative(x: Any, stage: int, *, exact: bool = False) -> tuple[Any, Inflow]:
        force, moment, slope, inflow = force_and_moment(x, stage, delay if delayed else 0.0, exact=exact)
        dq = 0.5 * _product(x[Q], ca.vertcat(0, x[W]))
        dv = _cross_matrix_rotate(x[Q], force) / vehicle.mass_kg + gravity + x[states - 6 : states - 3]
        dw = (moment - ca.cross(x[W], inertia * x[W])) / inertia + x[states - 3 :]
        own = [slope] if kind == "command" else []
        return ca.vertcat(x[V], dq, dv, dw, *own, ca.SX.zeros(6)), inflow

    rates = [_with_jacobians(f"rates{stage}", z, s, [u], *derivative(z, stage, exact=True)) for stage in range(3)]

    h = step_s
    halfway = 0.5 * h
    k1 = derivative(z, 0)[0]
    k2 = derivative(z + halfway * k1, 1)[0]
    k3 = derivative(z + halfway * k2, 1)[0]
    k4 = derivative(z + h * k3, 2)[0]
    end = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    end[Q] = end[Q] / ca.norm_2(end[Q])
    step = ca.Function("step", [z, s, u], ca.cse([end]))

    q_seen = ca.SX.sym("q", 4)
    rate = z[W] + of_log[at.GYRO_BIAS : at.GYRO_BIAS + 3]
    force, _, _, inflow = force_and_moment(z, 0, delay, exact=True)
    specific = force / vehicle.mass_kg + _cross_matrix_rotate(_conjugate(z[Q]), z[states - 6 : states - 3])
    specific += of_log[at.ACCEL_BIAS : at.ACCEL_BIAS + 3]
    half = 0.5 * of_log[at.MISALIGNMENT : at.MISALIGNMENT + 3]
    turned = _product(z[Q] / ca.norm_2(z[Q]), ca.vertcat(1, half))
    off = _product(_conjugate(q_seen), turned)
    angle = 2 * off[1:4] / ca.fmax(ca.fabs(off[0]), 1e-3) * ca.sign(off[0])

    def reading(name: str, y: Any, of: Inflow, outputs: slice, states: slice, series: int) -> Reading:
        return Reading(_with_jacobians(name, z, s, [u, q_seen], y, of), outputs, states, series)

    pose = ca.vertcat(z[P], angle)
    readings = (
        reading("rate", rate, Inflow.none(), RATE, W, 0),
        reading("accel", specific, inflow, ACCEL, slice(0, states - 3), 1),
        reading("pose", pose, Inflow.none(), slice(POSITION.start, ATTITUDE.stop), slice(0, Q.stop), 2),
        reading("velocity", z[V], Inflow.none(), VELOCITY, V, 3),
    )
    now, turn, _, _ = force_and_moment(z, 0, delay)
    forces = ca.Function("forces", [z, s, u], [now / vehicle.mass_kg, turn / inertia])
    return FlightModel(rates, step, readings, forces, states, inputs, n, kind, step_s)


def halving_error(model: FlightModel, half: FlightModel, z: np.ndarray, s: np.ndarray, u: np.ndarray) -> float:
    """Return the greatest difference between one step and two half steps over the states of `z` (columns), relative
    to 1 m, 1 rad, 1 m/s and 1 rad/s. `u` holds the motors of the whole step, which the halves interpolate."""
    n = model.rotors
    whole = np.array(model.step(z, s, u))
    start, middle, end = (u[i * 3 * n : (i + 1) * 3 * n] for i in range(3))
    first = np.concatenate([start, (start + middle) / 2, middle, u[9 * n :]])
    second = np.concatenate([middle, (middle + end) / 2, end, u[9 * n :]])
    halves = np.array(half.step(half.step(z, s, first), s, second))
    return float(np.max(np.abs(whole[:13] - halves[:13])))


def _with_jacobians(name: str, z: Any, s: Any, others: list[Any], y: Any, inflow: Inflow) -> Differentiated:
    jz, js = exact_jacobian(y, z, inflow), exact_jacobian(y, s, inflow)
    out = ca.cse(put_in([y, ca.vertcat(*jz.nonzeros()), ca.vertcat(*js.nonzeros())], inflow))
    f = ca.Function(name, [z, s, *others], out)
    (row_z, col_z), (row_s, col_s) = (j.sparsity().get_triplet() for j in (jz, js))
    at_z, at_s = ((np.array(x, np.int64), np.array(y, np.int64)) for x, y in ((row_z, col_z), (row_s, col_s)))
    return Differentiated(f, at_z, at_s, (y.shape[0], z.shape[0], s.shape[0]))
