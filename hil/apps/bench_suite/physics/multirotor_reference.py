"""The multirotor's equations written independently in CasADi, solved by CVODES with tolerances of 1e-14.

Written independently of the kernel and in another form: attitude as a 3x3 matrix, angular momentum of body and rotors
in the world frame with dL/dt = R tau (no gyroscopic terms), forces and their moments by cross products over the rotors,
rotor speeds and angles integrated and not in closed form, ground effect and descent loss written as in their sources,
induced velocities of `rotor_model: blade_element` integrated too (blade_reference.py).
What is piecewise by tick in the model (commands, wind's slope, rotor faults) is an input of each tick, and CVODES
starts afresh there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.physics.blade_reference import BladeRotor, Hub, InflowRoots, relative_density, with_inflow
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Site

Float64 = NDArray[np.float64]
AIR_DENSITY = 1.225
TOLERANCE = 1e-14
# Adams, functional iteration: nothing is stiff, and |a| has no Jacobian at a = 0.
CVODES: dict[str, Any] = {
    "abstol": TOLERANCE,
    "reltol": TOLERANCE,
    "max_num_steps": 1_000_000,
    "linear_multistep_method": "adams",
    "nonlinear_solver_iteration": "functional",
}


@dataclass
class Inputs:
    """Inputs of the vehicle, tick by tick. All but `commands` are optional."""

    commands: Float64  # [ticks, rotors] 0..1
    wind_W: Float64 | None = None  # [ticks + 1, 3] m/s, linear in between
    speed_scale: Float64 | None = None  # [ticks] battery voltage over nominal
    thrust_left: Float64 | None = None  # [ticks, rotors]
    imbalance_kgm: Float64 | None = None  # [ticks, rotors]
    driven: NDArray[np.bool_] | None = None  # [ticks, rotors]; False for a motor that has lost its rotor
    effects: dict[str, bool] = field(default_factory=dict)  # ground_effect, descent_loss
    site: Site | None = None  # whose density the air has; without it 1.225 kg/m3


def commanded_speeds(vehicle: Vehicle, commands: Float64) -> Float64:
    """Return steady rotor speeds at nominal voltage: THR_MDL_FAC's curve f u^2 + (1 - f) u is relative thrust."""
    c = vehicle.rotor_constants
    u = np.clip(commands, 0.0, 1.0)
    return c.max_speed_radps * np.sqrt(c.thrust_model_factor * u**2 + (1.0 - c.thrust_model_factor) * u)


def fly(vehicle: Vehicle, start: Float64, inputs: Inputs, *, tick_s: float, gravity_mps2: float = 9.80665) -> Float64:
    """Return states (p, q, v, w, rotor speeds) per tick, [ticks + 1, 13 + rotors], from `start` in the same form."""
    n, ticks = len(vehicle.rotors), len(inputs.commands)
    wind = np.zeros((ticks + 1, 3)) if inputs.wind_W is None else inputs.wind_W
    scale = np.ones(ticks) if inputs.speed_scale is None else inputs.speed_scale
    left = np.ones((ticks, n)) if inputs.thrust_left is None else inputs.thrust_left
    whirl = np.zeros((ticks, n)) if inputs.imbalance_kgm is None else inputs.imbalance_kgm
    motor = vehicle.rotor_constants.motor
    if motor is None:
        targets = commanded_speeds(vehicle, inputs.commands) * scale[:, None]
        drives = [targets, _lags(vehicle, start[13:], targets, tick_s)]
    else:
        duty = np.clip(inputs.commands, 0.0, 1.0)
        driven = np.ones((ticks, n), dtype=bool) if inputs.driven is None else inputs.driven
        drives = [duty * scale[:, None] * motor.nominal_voltage_v, np.where(driven, duty, -1.0)]
    controls = np.column_stack(
        [
            *drives,
            wind[:-1],
            np.diff(wind, axis=0) / tick_s,
            left,
            whirl,
        ]
    )
    problem, roots = _equations(vehicle, gravity_mps2, inputs, whirling=bool(whirl.any()))
    # One call a tick: the solver must not step across a change of its inputs.
    solver = ca.integrator("reference", "cvodes", problem, 0.0, tick_s, CVODES)
    inertia = np.diag(vehicle.inertia_kgm2)
    R0 = matrix_of_quaternion(start[3:7])
    momentum = R0 @ (inertia @ start[10:13] + _spin_momentum(vehicle, start[13:]))
    x = np.concatenate([start[:3], R0.ravel(order="F"), start[7:10], momentum, start[13:], np.zeros(n)])
    moving = len(x)
    if roots is not None:
        x = np.concatenate([x, np.full(n, 5.0)])
    states = np.empty((ticks + 1, 13 + n))
    states[0] = start
    q = start[3:7]
    for k, control in enumerate(controls, start=1):
        if roots is not None:
            x[moving:] = roots.solve(x[:moving], x[moving:], control)
        x = np.array(solver(x0=x, u=control)["xf"]).ravel()
        R = x[3:12].reshape(3, 3, order="F")
        speeds = x[18 : 18 + n]
        w = np.linalg.solve(inertia, R.T @ x[15:18] - _spin_momentum(vehicle, speeds))
        q = quaternion_like(R, q)
        states[k] = np.concatenate([x[:3], q, x[12:15], w, speeds])
    return states


def _lags(vehicle: Vehicle, speeds: Float64, targets: Float64, tick_s: float) -> Float64:
    """Return the time constant of each rotor in each tick: spin-up below its target. It cannot change within a tick."""
    c = vehicle.rotor_constants
    lags = np.empty_like(targets)
    for k, target in enumerate(targets):
        lags[k] = np.where(target > speeds, c.time_constant_up_s, c.time_constant_down_s)
        speeds = target + (speeds - target) * np.exp(-tick_s / lags[k])
    return lags


def _equations(
    vehicle: Vehicle, g: float, inputs: Inputs, *, whirling: bool
) -> tuple[dict[str, ca.SX], InflowRoots | None]:
    c, n, effects = vehicle.rotor_constants, len(vehicle.rotors), inputs.effects
    by_blades, by_tunnel = vehicle.rotor_model == "blade_element", vehicle.rotor_model == "wind_tunnel"
    t = ca.SX.sym("t")
    p, R, v, L = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("v", 3), ca.SX.sym("L", 3)
    speed, angle = ca.SX.sym("speed", n), ca.SX.sym("angle", n)
    target, lag = ca.SX.sym("c", n), ca.SX.sym("tau", n)
    wind0, slope = ca.SX.sym("w0", 3), ca.SX.sym("ws", 3)
    left, whirl = ca.SX.sym("left", n), ca.SX.sym("whirl", n)
    up = ca.DM([0, 0, 1])
    inertia = ca.diag(ca.DM(vehicle.inertia_kgm2))
    spins = ca.DM([rotor.spin.sign for rotor in vehicle.rotors])
    axes = ca.DM(np.array([rotor.axis for rotor in vehicle.rotors]).T)
    w = ca.solve(inertia, R.T @ L - c.inertia_kgm2 * (axes @ (spins * speed)))
    through_air = v - (wind0 + t * slope)
    air = R.T @ through_air
    density = relative_density(p[2], inputs.site) if inputs.site is not None and (by_blades or by_tunnel) else 1.0
    force = -ca.DM(vehicle.body_drag_linear_n_per_mps) * air
    force -= ca.DM(vehicle.body_drag_quadratic_n_per_m2ps2) * ca.sqrt(ca.sumsqr(air) + 1e-24) * air
    force *= density
    torque = ca.SX.zeros(3)
    induced = ca.SX.sym("v", n if by_blades else 0)
    blades = [
        BladeRotor(vehicle, i, left[i], ground=effects.get("ground_effect", False)) for i in range(n) if by_blades
    ]
    gaps, resisting = [], ca.SX.zeros(n)  # aerodynamic torque against each spin
    area = np.pi * c.radius_m**2
    for i, rotor in enumerate(vehicle.rotors):
        site = ca.DM(rotor.position_m)
        hub = air + ca.cross(w, site)
        axis = ca.DM(rotor.axis)
        if whirling:
            left_of_it = ca.cross(axis, ca.DM([1, 0, 0])) / ca.norm_2(ca.cross(axis, ca.DM([1, 0, 0])))
            ahead = ca.cross(left_of_it, axis)
            shake = whirl[i] * speed[i] ** 2 * (ca.cos(angle[i]) * ahead + ca.sin(angle[i]) * left_of_it)
            force += shake
            torque += ca.cross(site, shake)
        if by_blades:
            seen = Hub(hub, (p + R @ site)[2], (R @ axis)[2])
            wake = 0.0 if rotor.coaxial_below is None else induced[rotor.coaxial_below]
            pull, moment = blades[i].force_and_moment(seen, speed[i], induced[i], wake)
            gaps.append(blades[i].gap(seen, speed[i], induced[i], wake))
            force += density * blades[i].relative * pull
            torque += density * blades[i].relative * (ca.cross(site, pull) + moment)
            resisting[i] = -density * blades[i].relative * spins[i] * ca.dot(moment, axis)
            continue
        reaction = left[i] * c.thrust_coefficient_n_per_radps2 * c.moment_ratio_m * speed[i] ** 2
        # Of the undamaged rotor: a chipped one moves as much air in spite of its loss of thrust.
        hover_speed2 = c.thrust_coefficient_n_per_radps2 * speed[i] ** 2 / (2 * AIR_DENSITY * area)
        along = ca.dot(hub, axis)
        across2 = ca.sumsqr(ca.cross(axis, hub))
        thrust = left[i] * c.thrust_coefficient_n_per_radps2 * speed[i] ** 2
        if rotor.coaxial_below is not None:  # upper * lower: 1 at equal speeds
            wake = (1 - c.coaxial_thrust_ratio) * speed[rotor.coaxial_below] * speed[i]
            thrust -= left[i] * c.thrust_coefficient_n_per_radps2 * wake
        if effects.get("ground_effect") and c.ground_thrust_ratio > 1.0:
            z = (p + R @ site)[2] / (c.ground_radius_m or c.radius_m)
            thrust *= _ground(z, (R @ axis)[2], across2 / hover_speed2, c.ground_thrust_ratio)
        if effects.get("descent_loss") and c.descent_loss > 0.0 and not by_tunnel:
            thrust *= _descent(-along / ca.sqrt(hover_speed2), across2 / hover_speed2, c.descent_loss)
        if by_tunnel:
            assert c.wind_tunnel is not None
            tunnel = c.wind_tunnel
            advance = along / (speed[i] / (2 * np.pi) * 2 * c.radius_m)
            a, b = tunnel.thrust_coefficients, tunnel.power_coefficients
            still = left[i] * c.thrust_coefficient_n_per_radps2 * speed[i] ** 2
            bent = advance * ca.sqrt(advance**2 + 0.01)
            thrust += still * (a[1] * advance + a[2] * bent) / a[0]
            reaction *= (b[0] + b[1] * advance + b[2] * advance**2) / b[0]
            heavier = density * AIR_DENSITY / tunnel.air_density_kgpm3
            pull = thrust * axis - c.drag_kg_per_rad * speed[i] * (hub - along * axis)
            force += heavier * pull
            torque += heavier * (ca.cross(site, pull) - spins[i] * reaction * axis)
            resisting[i] = heavier * reaction
            continue
        resisting[i] = reaction
        thrust -= c.axial_drag_kg_per_rad * speed[i] * along
        pull = thrust * axis - c.drag_kg_per_rad * speed[i] * ca.cross(ca.cross(axis, hub), axis)
        force += pull
        torque += ca.cross(site, pull) - spins[i] * reaction * axis
    rates = [
        v,
        ca.vec(R @ ca.skew(w)),
        R @ force / vehicle.mass_kg - g * up,
        R @ torque,
        (target - speed) / lag if c.motor is None else _motor(vehicle, speed, target, lag, resisting),
        spins * speed * (whirl > 0) if whirling else ca.SX.zeros(n),  # since the fault
    ]
    state, moving = ca.vertcat(p, ca.vec(R), v, L, speed, angle), ca.vertcat(*rates)
    inputs_of_tick = ca.vertcat(target, lag, wind0, slope, left, whirl)
    problem = {"x": state, "t": t, "u": inputs_of_tick, "ode": moving}
    if not by_blades:
        return problem, None
    return with_inflow(problem, blades, induced, ca.vertcat(*gaps))


def _motor(vehicle: Vehicle, speed: ca.SX, volts: ca.SX, duty: ca.SX, resisting: ca.SX) -> ca.SX:
    """Return the rates of the speeds. `volts` at each motor; `duty` is -1 for one without a current."""
    c, motor = vehicle.rotor_constants, vehicle.rotor_constants.motor
    assert motor is not None
    per_volt = motor.kv_rpm_per_v * np.pi / 30  # rad/s
    amps = (volts - speed / per_volt) / motor.resistance_ohm
    if not motor.active_braking:
        blur = 0.02 * motor.nominal_voltage_v * duty / motor.resistance_ohm
        amps = amps / 2 + ca.sqrt(amps**2 + blur**2) / 2
    amps = ca.if_else(duty < 0, 0, amps) - motor.no_load_current_a * (1 - 20 / (20 + speed))
    return (amps / per_volt - resisting) / c.inertia_kgm2


def _ground(heights: ca.SX, level: ca.SX, across2: ca.SX, at_ground: float) -> ca.SX:
    """Cheeseman and Bennett with a floor under the height and a fade; heights in radii, speeds in hover inflows."""
    floor = at_ground / (at_ground - 1.0)
    share = ca.fmax(level, 0) ** 4 * ca.fmax(1 - (heights / 32) ** 2, 0) ** 4 / (1 + across2)
    return 1 / (1 - share / (floor + 16 * heights**2))


def _descent(sink: ca.SX, across2: ca.SX, loss: float) -> ca.SX:
    y = (ca.fmax(sink, 0) / 1.45) ** 4
    return 1 - loss * 4 * y / (1 + y) ** 2 / (1 + across2) ** 2


def _spin_momentum(vehicle: Vehicle, speeds: Float64) -> Float64:
    spins = np.array([rotor.spin.sign for rotor in vehicle.rotors])
    axes = np.array([rotor.axis for rotor in vehicle.rotors])
    return vehicle.rotor_constants.inertia_kgm2 * np.asarray((spins * speeds) @ axes)


def matrix_of_quaternion(q: Float64) -> Float64:
    w, x, y, z = q / np.linalg.norm(q)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * skew + 2 * skew @ skew


def quaternion_like(R: Float64, like: Float64) -> Float64:
    """Return the eigenvector of Bar-Itzhack's matrix, sign nearest to `like`."""
    K = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2]],
            [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]],
            [R[1, 0] - R[0, 1], R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q @ like > 0 else -q


def attitude_error_rad(q: Float64, exact: Float64) -> float:
    """Return the angle between attitudes, from the vector part: the arc cosine of the scalar part fails below 1e-8."""
    (a, *x), (b, *y) = q.tolist(), exact.tolist()
    vector = b * np.array(x) - a * np.array(y) + np.cross(x, y)
    return 2.0 * float(np.arcsin(min(1.0, float(np.linalg.norm(vector)))))
