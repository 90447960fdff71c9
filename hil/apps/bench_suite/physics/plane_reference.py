"""The equations of a plane written independently in CasADi, solved by CVODES with tolerances of 1e-14.

In another form than the kernel's: attitude as a 3x3 matrix, angular momentum of body and propellers in the world frame
with the full tensor of inertia, aerodynamic forces as coefficients, attached flow as a difference of two hyperbolic
tangents, alpha and beta by other inverse functions, deflections and propeller speeds integrated and not in closed form,
induced velocities as states (blade_reference.py).
What is piecewise in the model (commands, slope of the wind, a servo that leaves its rate limit) is constant between two
restarts of CVODES.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.blade_reference import BladeRotor, Hub, InflowRoots, relative_density, with_inflow
from hil.apps.bench_suite.physics.multirotor_reference import CVODES, matrix_of_quaternion, quaternion_like
from hil.apps.bench_suite.physics.panels_reference import Flight, Stream, panels
from sim.physics.forces.aero_table import AeroTable, Lateral
from sim.physics.forces.panels import Panels
from sim.physics.forces.rotors import RotorConstants
from sim.physics.forces.surface import Surface
from sim.physics.forces.tilt import Tilt
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site

Float64 = NDArray[np.float64]
_SEA_LEVEL_KGPM3 = 1.225
_SMOOTH = 0.05  # of |w| in separated flow, over V


@dataclass
class PlaneInputs:
    """Inputs of a plane, tick by tick."""

    commands: Float64  # [ticks, commands], in the order of `Vehicle.commands`
    wind_W: Float64  # [ticks + 1, 3] m/s, linear in between
    site: Site | None = None  # whose density the air has; without it 1.225 kg/m3


def fly(vehicle: Vehicle, start: Float64, inputs: PlaneInputs, *, tick_s: float, gravity_mps2: float) -> Float64:
    """Return p, q, v, w, propeller speeds and deflections per tick from `start`: [ticks + 1, 13 + own states]."""
    n = len(vehicle.rotors)
    servos = [_Servo(servo) for servo in vehicle.servos]
    problem, roots = _equations(vehicle, gravity_mps2, inputs.site)
    solver = ca.integrator("reference", "cvodes", problem, 0.0, 1.0, CVODES)
    inertia = vehicle.inertia_tensor_kgm2
    R = matrix_of_quaternion(start[3:7])
    momentum = R @ (inertia @ start[10:13] + _spin_momentum(vehicle, start[13 : 13 + n], start[13 + n :]))
    x = np.concatenate([start[:3], R.ravel(order="F"), start[7:10], momentum, start[13:]])
    moving = len(x)
    x = np.concatenate([x, np.full(n, 5.0)])
    states = np.empty((len(inputs.commands) + 1, len(start)))
    states[0], q = start, start[3:7]
    targets = np.column_stack(
        [_commanded_speeds(c, inputs.commands[:, i]) for i, c in enumerate(vehicle.constants_of_rotors)]
    )
    ups, downs = (
        np.array([getattr(c, f"time_constant_{way}_s") for c in vehicle.constants_of_rotors]) for way in ("up", "down")
    )
    for k, commands in enumerate(inputs.commands):
        deflections, speeds = states[k, 13 + n :], states[k, 13 : 13 + n]
        lags = np.where(targets[k] > speeds, ups, downs)
        slope = (inputs.wind_W[k + 1] - inputs.wind_W[k]) / tick_s
        aims = [servo.target(u) for servo, u in zip(servos, commands[n:], strict=True)]
        for t, length, rates, held in _pieces(servos, aims, deflections, tick_s):
            control = np.concatenate([targets[k], lags, aims, rates, held, inputs.wind_W[k], slope, [t, length]])
            if roots is not None:
                x[moving:] = roots.solve(x[:moving], x[moving:], control)
            x = np.array(solver(x0=x, u=control)["xf"]).ravel()
        R = x[3:12].reshape(3, 3, order="F")
        speeds = x[18 : 18 + n]
        w = np.linalg.solve(inertia, R.T @ x[15:18] - _spin_momentum(vehicle, speeds, x[18 + n : moving]))
        q = quaternion_like(R, q)
        states[k + 1] = np.concatenate([x[:3], q, x[12:15], w, x[18:moving]])
    return states


def _commanded_speeds(c: RotorConstants, commands: Float64) -> Float64:
    u = np.clip(commands, 0.0, 1.0)
    return np.asarray(c.max_speed_radps * np.sqrt(u * (1.0 + c.thrust_model_factor * (u - 1.0))))


class _Servo:
    """Motion of one surface or tilt: at its rate limit until it is near enough, then exponential."""

    def __init__(self, surface: Surface | Tilt) -> None:
        self._surface = surface
        self.tau_s = surface.time_constant_s
        self._rate = math.inf if surface.rate_degps is None else math.radians(surface.rate_degps)

    def target(self, command: float) -> float:
        u = max(-1.0, min(1.0, float(command)))
        if isinstance(self._surface, Tilt):
            return math.radians(float(np.interp(u, (-1.0, 1.0), (self._surface.min_deg, self._surface.max_deg))))
        return math.radians(max(u, 0.0) * self._surface.max_deg + max(-u, 0.0) * self._surface.min_deg)

    def limited_s(self, error: float) -> float:
        """Return how long it moves at its limit."""
        return max(0.0, abs(error) / self._rate - self.tau_s)

    def rate(self, error: float) -> float:
        return math.copysign(self._rate, error)


def _pieces(
    servos: Sequence[_Servo], aims: Sequence[float], deflections: Float64, tick_s: float
) -> Iterator[tuple[float, float, list[float], list[float]]]:
    """Yield start, length, rates [rad/s] and 1 for a servo at its limit, of the pieces of a tick."""
    errors = [aim - float(angle) for aim, angle in zip(aims, deflections, strict=True)]
    ends = [servo.limited_s(error) for servo, error in zip(servos, errors, strict=True)]
    borders = sorted({0.0, tick_s, *(end for end in ends if 0.0 < end < tick_s)})
    for begin, end in itertools.pairwise(borders):
        held = [1.0 if begin < limit else 0.0 for limit in ends]
        rates = [servo.rate(e) if h else 0.0 for servo, e, h in zip(servos, errors, held, strict=True)]
        yield begin, end - begin, rates, held


def _equations(vehicle: Vehicle, g: float, site: Site | None) -> tuple[dict[str, ca.SX], InflowRoots | None]:
    n, m = len(vehicle.rotors), len(vehicle.servos)
    assert all(group.model == "blade_element" for group in vehicle.rotor_groups)
    share = ca.SX.sym("share")  # of the piece
    p, R, v, L = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("v", 3), ca.SX.sym("L", 3)
    speed, angle, induced = ca.SX.sym("speed", n), ca.SX.sym("angle", m), ca.SX.sym("induced", n)
    target, lag = ca.SX.sym("target", n), ca.SX.sym("lag", n)
    aim, rate, held = ca.SX.sym("aim", m), ca.SX.sym("rate", m), ca.SX.sym("held", m)
    wind0, slope, begin, length = ca.SX.sym("wind", 3), ca.SX.sym("slope", 3), ca.SX.sym("t0"), ca.SX.sym("length")
    inertia = ca.DM(vehicle.inertia_tensor_kgm2)
    tau = ca.DM([servo.time_constant_s for servo in vehicle.servos])
    turning = held * rate + (1 - held) * (aim - angle) / tau
    places, axes = _poses(vehicle, angle)
    spin_momentum = ca.SX.zeros(3)
    for i, (rotor, of) in enumerate(zip(vehicle.rotors, vehicle.constants_of_rotors, strict=True)):
        spin_momentum += of.inertia_kgm2 * rotor.spin.sign * speed[i] * axes[i]
    w = ca.solve(inertia, R.T @ L - spin_momentum)
    air = R.T @ (v - (wind0 + (begin + length * share) * slope))
    density = relative_density(p[2], site) if site is not None else 1.0
    force = -ca.DM(vehicle.body_drag_linear_n_per_mps) * air * density
    force -= ca.DM(vehicle.body_drag_quadratic_n_per_m2ps2) * ca.sqrt(ca.sumsqr(air) + 1e-24) * air * density
    torque = ca.SX.zeros(3)
    blades = [BladeRotor(vehicle, i, 1.0, ground=False, axis=axes[i]) for i in range(n)]
    gaps, streams = [], []
    for i, of in enumerate(vehicle.constants_of_rotors):
        place, axis = places[i], axes[i]
        moved = ca.jtimes(place, angle, turning) if vehicle.tilts else ca.SX.zeros(3)
        seen = Hub(air + ca.cross(w, place) + moved, (p + R @ place)[2], (R @ axis)[2])
        pull, moment = blades[i].force_and_moment(seen, speed[i], induced[i], 0.0)
        gaps.append(blades[i].gap(seen, speed[i], induced[i], 0.0))
        streams.append(Stream(place, axis, of.radius_m, seen.velocity, induced[i]))
        force += density * blades[i].relative * pull
        torque += density * blades[i].relative * (ca.cross(place, pull) + moment)
    first = len(vehicle.tilts)
    for part in vehicle.forces:
        assert isinstance(part, AeroTable | Panels)
        count = len(part.surfaces)
        if isinstance(part, Panels):
            f, about = panels(part, Flight(air, w, p[2], R.T @ ca.DM([0, 0, 1]), streams), angle[first : first + count])
        else:
            f, about = aero_table(part, air, w, angle[first : first + count])
        force, torque, first = force + density * f, torque + density * about, first + count
    rates = [
        v,
        ca.vec(R @ ca.skew(w)),
        R @ force / vehicle.mass_kg - g * ca.DM([0, 0, 1]),
        R @ torque,
        (target - speed) / lag,
        turning,
    ]
    state, moving = ca.vertcat(p, ca.vec(R), v, L, speed, angle), length * ca.vertcat(*rates)
    inputs = ca.vertcat(target, lag, aim, rate, held, wind0, slope, begin, length)
    problem = {"x": state, "t": share, "u": inputs, "ode": moving}
    if not n:
        return problem, None
    return with_inflow(problem, blades, induced, ca.vertcat(*gaps))


def aero_table(part: AeroTable, air: ca.SX, w: ca.SX, angles: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return force and torque in B of a table at 1.225 kg/m3, as expressions of the flow, the rates and the angles."""
    to_F = ca.DM(np.diag([1.0, -1.0, -1.0]))  # FLU to x ahead, y right, z down and back
    a, rates = to_F @ air, to_F @ w
    V = ca.norm_2(a)
    in_plane = ca.sqrt(a[0] ** 2 + a[2] ** 2)
    alpha, beta = ca.atan2(a[2], a[0]), ca.asin(a[1] / V)
    forward, up = a[0] / in_plane, a[2] / in_plane  # cosine and sine of alpha
    stall, b, c = part.stall, part.span_m, part.chord_m
    attached = _window(alpha, stall.alpha_deg, stall.sharpness) * _window(beta, stall.sideslip_deg, stall.sharpness)
    apart = 1 - attached
    p_hat, q_hat, r_hat = rates[0] * b / (2 * V), rates[1] * c / (2 * V), rates[2] * b / (2 * V)
    effect = attached + apart * part.separated.surface_share * a[0] / V

    moved = {
        name: sum(s.moves.get(name, 0.0) * angles[i] for i, s in enumerate(part.surfaces)) for name in part.controls
    }

    def by_controls(quantity: str) -> Any:
        return sum(getattr(control, quantity) * moved[name] for name, control in part.controls.items())

    line = part.lift.zero + part.lift.alpha * alpha
    C_L = attached * (line + part.lift.q * q_hat) + effect * by_controls("lift")
    d = part.drag
    C_D = d.zero + d.alpha * alpha + d.alpha2 * alpha**2 + d.beta * beta + d.beta2 * beta**2 + d.q * q_hat
    if d.oswald_factor is not None:
        C_D += line**2 / (math.pi * d.oswald_factor * b**2 / part.area_m2)
    C_D += by_controls("drag") + sum(control.drag2 * moved[name] ** 2 for name, control in part.controls.items())
    C_D = attached * C_D
    sideways = a[1] / V
    plate = a[2] / V * ca.sqrt((a[2] / V) ** 2 + _SMOOTH**2)

    def lateral(of: Lateral, quantity: str, own: str) -> Any:
        """Coefficient in attached flow; the derivative by the rate about its own axis `own` acts everywhere."""
        turns = {"p": of.p * p_hat, "r": of.r * r_hat}
        kept = turns.pop(own) if own else 0.0
        return attached * (of.zero + of.beta * beta + sum(turns.values())) + kept + effect * by_controls(quantity)

    C_X = -C_D * forward + C_L * up - apart * d.zero * a[0] / V
    C_Z = -C_D * up - C_L * forward - apart * (d.zero * a[2] / V + part.separated.normal * plate)
    C_Y = lateral(part.side, "side", "") + apart * (part.side.beta - d.zero) * sideways
    C_l = lateral(part.roll, "roll", "p")
    C_m = attached * (part.pitch.zero + part.pitch.alpha * alpha) + apart * part.separated.pitch * plate
    C_m += part.pitch.q * q_hat + effect * by_controls("pitch")
    C_n = lateral(part.yaw, "yaw", "r") + apart * part.yaw.beta * sideways
    pressure = 0.5 * _SEA_LEVEL_KGPM3 * V**2 * part.area_m2
    force = to_F @ (pressure * ca.vertcat(C_X, C_Y, C_Z))
    about = to_F @ (pressure * ca.vertcat(b * C_l, c * C_m, b * C_n))
    return force, about + ca.cross(ca.DM(part.reference_m), force)


def _window(x: ca.SX, border_deg: float, sharpness: float) -> ca.SX:
    """Return 1 inside +-border and 0 outside: the product of two logistic functions, by their sum."""
    border = math.radians(border_deg)
    inside = 0.5 * (ca.tanh(0.5 * sharpness * (border - x)) + ca.tanh(0.5 * sharpness * (border + x)))
    return inside / (1 - math.exp(-2 * sharpness * border))


def _poses(vehicle: Vehicle, angle: Any) -> tuple[list[Any], list[Any]]:
    """Return place and axis in B of each rotor for these angles of the servos, the tilts' first.

    A turn by the angle t about the unit vector a is the matrix I + sin t [a]x + (1 - cos t) [a]x^2.
    """
    places = [ca.DM(rotor.position_m) for rotor in vehicle.rotors]
    axes = [ca.DM(rotor.axis) for rotor in vehicle.rotors]
    for k, tilt in enumerate(vehicle.tilts):
        across = ca.skew(ca.DM(tilt.axis))
        turn = ca.DM.eye(3) + ca.sin(angle[k]) * across + (1 - ca.cos(angle[k])) * (across @ across)
        for i in tilt.rotors:
            hinge = places[i] if tilt.hinge_m is None else ca.DM(tilt.hinge_m)
            places[i], axes[i] = hinge + turn @ (places[i] - hinge), turn @ axes[i]
    return places, axes


def _spin_momentum(vehicle: Vehicle, speeds: Float64, angles: Float64) -> Float64:
    _, axes = _poses(vehicle, angles)
    total = np.zeros(3)
    for rotor, of, axis, speed in zip(vehicle.rotors, vehicle.constants_of_rotors, axes, speeds, strict=True):
        total += of.inertia_kgm2 * rotor.spin.sign * speed * np.array(axis).ravel()
    return total
