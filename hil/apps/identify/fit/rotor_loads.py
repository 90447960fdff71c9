"""Force and moment of every rotor on the body, as symbols of the fit, by the model that the vehicle file names.

`blade_element`: sim/physics/forces/rotor_equations.py, the equations of the bench's kernel, with lumps of the unknowns
    k, c_l, k_d, h, m_ratio, gamma_0 and R_g; the other numbers are those of the vehicle file.
`quadratic` (sim/native/forces/rotors.hpp, rotor_air.hpp), O the speed, u the velocity of the hub through the air:
    thrust        T = (k O (O - c O_upper) G V_loss - k_z O u_n) n,  G of ground_ratio, V_loss of descent_ratio
    rotor drag    H = -k_d O u_a
    torque        -s m k O^2 n
Both: - s J dO/dt n - w x (s J O n), with the spin s = +1 counter-clockwise and the axis n.

The induced velocity v of blade elements is the root of g(v, x) = 0, x the unknowns and states. Newton's steps give its
value; its derivative is dv/dx = -g_x / g_v at that value, not the derivative of the steps: exact at the same place as
the value, and without the eight-fold nested expressions that differentiating the steps would make. `_STEPS` of them
leave less than 1e-8 of v_h for |u_n|, V <= 100 v_h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hil.apps.identify.fit import parameters as at
from sim.physics.forces.blade_element import HAYDEN, RotorLumps, lumps_of
from sim.physics.forces.rotor_equations import coaxial_wake, ground_inflow_loss, induced_velocity, inflow_balance, loads
from sim.physics.vehicle import Vehicle
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

_STEPS = 5
_GROUND_REACH_RADII, _VORTEX_RING_CENTRE = 32.0, 1.45  # rotor_air.hpp
_TINY = 1e-12


@dataclass(frozen=True)
class Flow:
    """Flow at a rotor, on which its loads depend besides the unknowns, in B. `height_m`: of the origin."""

    air_B: Any
    w_B: Any
    up_B: Any
    height_m: Any


@dataclass(frozen=True)
class Inflow:
    """Induced velocities of the rotors: symbols, their values by Newton's method, and g of each, in the rotors' order.

    Values may depend on symbols: those of upper rotors. Empty for a model without inflow.
    """

    symbols: Any
    values: Any
    balances: Any

    @staticmethod
    def none() -> Inflow:
        """Return that of a function without rotors."""
        return Inflow(ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1))


def wrench(
    vehicle: Vehicle, p: Any, flow: Flow, *, speeds: Any, slopes: Any, exact_inflow: bool = True
) -> tuple[Any, Any, Inflow]:
    """Return force [N] and moment about the centre of mass [N m], both in B, and the inflow that they hold as symbols.

    `p`: values in the order of `parameters.vehicle_unknowns`. Without `exact_inflow` the inflow is put in.
    """
    blades = vehicle.rotor_constants.blade_element if vehicle.rotor_model == "blade_element" else None
    count = len(vehicle.rotors)
    symbols = ca.SX.sym("v", count if blades is not None and exact_inflow else 0)
    values, balances = [0.0] * count, [0.0] * count
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    upper_first = sorted(range(count), key=lambda i: vehicle.rotors[i].coaxial_below is not None)
    lumps = _lumps(vehicle, p) if blades is not None else None
    wake = _wake(vehicle)
    induced: dict[int, Any] = {}
    for i in upper_first:
        rotor = vehicle.rotors[i]
        n, r = ca.DM(np.array(rotor.axis)), ca.DM(np.array(rotor.position_m)) - p[at.CENTRE : at.CENTRE + 3]
        u = flow.air_B + ca.cross(flow.w_B, r)
        u_n = ca.dot(u, n)
        u_a = u - u_n * n
        across2 = ca.dot(u_a, u_a)
        height, up = flow.height_m + ca.dot(flow.up_B, r), ca.dot(flow.up_B, n)
        O, s = speeds[i], rotor.spin.sign  # noqa: E741
        above = rotor.coaxial_below
        if lumps is not None:
            if above is not None:
                u_n = u_n + wake * induced[above]
            gamma = ground_inflow_loss(lumps, O, across2, height, up)
            values[i] = induced_velocity(lumps, O, u_n, across2, gamma, steps=_STEPS)
            induced[i] = symbols[i] if exact_inflow else values[i]
            balances[i] = inflow_balance(lumps, O, u_n, across2, gamma, induced[i])[0]
            found = loads(lumps, O, u_n, across2, gamma=gamma, induced_mps=induced[i])
            hub = found.thrust_n * n - found.across_kg_per_s * u_a
            turn = -s * found.roll_kg_m_per_s * u_a - found.pitch_kg_m_per_s * ca.cross(n, u_a)
            torque = found.torque_nm
        else:
            lost = 0.0 if above is None else (1.0 - vehicle.rotor_constants.coaxial_thrust_ratio) * speeds[above]
            static = p[at.THRUST] * O * (O - lost) * _near_ground_or_sinking(vehicle, p, O, u_n, across2, height, up)
            hub = (static - p[at.AXIAL_DRAG] * O * u_n) * n - p[at.ROTOR_DRAG] * O * u_a
            turn, torque = ca.SX.zeros(3), p[at.MOMENT_RATIO] * p[at.THRUST] * O * O
        J = p[at.ROTOR_INERTIA]
        force += hub
        moment += ca.cross(r, hub) + turn
        moment -= s * (torque + J * slopes[i]) * n + ca.cross(flow.w_B, s * J * O * n)
    if symbols.numel() == 0:
        return force, moment, Inflow(symbols, symbols, symbols)
    return force, moment, Inflow(symbols, ca.vertcat(*values), ca.vertcat(*balances))


def exact_jacobian(y: Any, x: Any, inflow: Inflow) -> Any:
    """Return dy/dx with the inflow a function of x: y_x - y_v g_v^-1 g_x, its symbols still in it."""
    direct = ca.jacobian(y, x)
    v, g = inflow.symbols, inflow.balances
    if v.numel() == 0:
        return direct
    return direct - ca.jacobian(y, v) @ ca.solve(ca.jacobian(g, v), ca.jacobian(g, x))


def put_in(expressions: list[Any], inflow: Inflow) -> list[Any]:
    """Return the expressions with the values of the inflow in place of its symbols."""
    v, values = inflow.symbols, inflow.values
    if v.numel() == 0:
        return expressions
    while ca.depends_on(values, v):  # of lower rotors, which are in the wake of upper ones
        (values,) = ca.substitute([values], [v], [values])
    return list(ca.substitute(expressions, [v], [values]))


def _lumps(vehicle: Vehicle, p: Any) -> RotorLumps:
    """Return the lumps of blade_element.py's `lumps_of`, of symbols."""
    c, blades = vehicle.rotor_constants, vehicle.rotor_constants.blade_element
    assert blades is not None
    fixed = lumps_of(c, blades)
    k, c_l = p[at.THRUST], p[at.INFLOW]
    kappa = k / fixed.disc_kg_per_m
    c_t = k + c_l * ca.sqrt(kappa)
    across = blades.translational_thrust_kg_per_m
    return fixed._replace(
        c_t=c_t,
        c_l=c_l,
        c_v=1.5 * c_t / (c.radius_m * c.radius_m) if across is None else across,
        c_q=k * (p[at.MOMENT_RATIO] - blades.induced_power_factor * ca.sqrt(kappa)),
        k_d=p[at.ROTOR_DRAG],
        kappa_m2=kappa,
        hub_moment_share=p[at.HUB_SHARE],
        ground_floor=HAYDEN / p[at.GROUND] if blades.ground_inflow_loss > 0.0 else 0.0,
        ground_radius_m=p[at.GROUND_RADIUS],
    )


def _wake(vehicle: Vehicle) -> float:
    """Return chi of the vehicle file; it hardly moves with the unknowns."""
    c = vehicle.rotor_constants
    if vehicle.rotor_model != "blade_element" or c.blade_element is None or c.coaxial_thrust_ratio >= 1.0:
        return 0.0
    return coaxial_wake(c, lumps_of(c, c.blade_element))


def _near_ground_or_sinking(
    vehicle: Vehicle, p: Any, speed: Any, u_n: Any, across2: Any, height_m: Any, up: Any
) -> Any:
    """Return G V_loss of rotor_air.hpp."""
    c = vehicle.rotor_constants
    if c.ground_thrust_ratio == 1.0 and c.descent_loss == 0.0:
        return 1.0
    disc = 2.0 * SEA_LEVEL_KGPM3 * np.pi * c.radius_m * c.radius_m
    induced2 = p[at.THRUST] / disc * speed * speed + _TINY
    calm = induced2 / (induced2 + across2)
    ratio = 1.0
    if c.ground_thrust_ratio > 1.0:
        fade = ca.fmax(1.0 - (height_m / (_GROUND_REACH_RADII * p[at.GROUND_RADIUS])) ** 2, 0.0)
        share = ca.fmax(up, 0.0) ** 4 * fade**4 * calm
        floor = p[at.GROUND] / (p[at.GROUND] - 1.0)
        ratio = 1.0 + share / (floor - share + (4.0 * height_m / p[at.GROUND_RADIUS]) ** 2)
    if c.descent_loss > 0.0:
        sinks4, centre4 = ca.fmin(u_n, 0.0) ** 4, (_VORTEX_RING_CENTRE**2 * induced2) ** 2
        ratio = ratio * (1.0 - c.descent_loss * 4.0 * sinks4 * centre4 / (sinks4 + centre4) ** 2 * calm * calm)
    return ratio
