"""Figures of a vehicle that make its free flight too fast to integrate.

The integrator halves its steps up to 64 times and needs lambda h <= 2 (classical: 1). The terms of lambda are those of
sim/native/free_flight.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sim.physics.forces.blade_element import lumps_of
from sim.physics.forces.rotors import RotorGroup
from sim.physics.integration import TickSteps
from sim.physics.vehicle import Vehicle

_HALVINGS = 6
_PER_STEP = {False: 2.0, True: 1.0}  # greatest lambda h of the methods of order 8 and 4


def too_stiff(vehicle: Vehicle, steps: TickSteps, v_WB_W: Sequence[float], wind_W_mps: Sequence[float]) -> str | None:
    """Return which figure of the vehicle makes the shortest step unstable at this velocity; None if no figure does."""
    mass, least = vehicle.mass_kg, min(vehicle.inertia_kgm2)
    linear, quadratic = max(vehicle.body_drag_linear_n_per_mps), max(vehicle.body_drag_quadratic_n_per_m2ps2)
    thrust = _full_thrust_n(vehicle)
    airspeed = math.dist(v_WB_W, wind_W_mps) + thrust / mass * steps.tick_s  # the most that it may reach in the tick
    terms = [
        (linear / mass, "body_drag_linear_n_per_mps", f"{linear:g} on {mass:g} kg"),
        (
            2.0 * quadratic * airspeed / mass,
            "body_drag_quadratic_n_per_m2ps2",
            f"{quadratic:g} on {mass:g} kg at {airspeed:.3g} m/s",
        ),
    ]
    most_radps: dict[str, float] = {}
    for group in vehicle.rotor_groups:
        found = _rotor_terms(group, mass, least, airspeed)
        terms += found
        most_radps |= {key: group.constants.max_speed_radps for _, key, _ in found}
    fastest_per_s = _PER_STEP[steps.classical] / _shortest_s(steps)
    if sum(rate for rate, _, _ in terms) <= fastest_per_s:
        return None
    rate, key, text = max(terms)
    if key in most_radps:
        text += f" with a body of {mass:g} kg and {least:g} kg m2 and rotors up to {most_radps[key]:g} rad/s"
    return (
        f"{key} of the vehicle is too great to integrate: {text} changes the motion at {rate:.3g} per s, and the "
        f"shortest step, {1e6 * _shortest_s(steps):.4g} us, follows {fastest_per_s:.3g} per s"
    )


def _rotor_terms(group: RotorGroup, mass: float, least: float, airspeed: float) -> list[tuple[float, str, str]]:
    """Return rate, key and figure of the terms of a group of rotors."""
    c, n, key = group.constants, len(group.rotors), group.key
    reach2 = sum(x * x for rotor in group.rotors for x in rotor.position_m)
    mobility = c.max_speed_radps * (n / mass + reach2 / least)
    terms = [
        (c.inertia_kgm2 * n * c.max_speed_radps / least, f"{key}.inertia_kgm2", f"{c.inertia_kgm2:g}"),
        (c.drag_kg_per_rad * mobility, f"{key}.drag_kg_per_rad", f"{c.drag_kg_per_rad:g}"),
        (c.axial_drag_kg_per_rad * mobility, f"{key}.axial_drag_kg_per_rad", f"{c.axial_drag_kg_per_rad:g}"),
    ]
    if group.model == "blade_element" and c.blade_element is not None:
        found = lumps_of(c, c.blade_element)
        slope = found.c_l + 2.0 * found.c_q / (c.radius_m * c.radius_m)
        edge = 2.0 * found.c_v * airspeed * mobility / c.max_speed_radps
        terms.append((slope * mobility + edge, f"{key}.blade_element", f"{slope:g} kg/rad"))
    if group.model == "wind_tunnel" and c.wind_tunnel is not None:
        still, *falls = c.wind_tunnel.thrust_coefficients
        per = math.pi / c.radius_m
        slope = c.thrust_coefficient_n_per_radps2 * per * abs(falls[0] + 0.1 * falls[1]) / still
        edge = 2.0 * c.thrust_coefficient_n_per_radps2 * per * per * abs(falls[1]) / still * airspeed
        rate = (slope + edge / c.max_speed_radps) * mobility
        terms.append((rate, f"{key}.wind_tunnel", f"{slope:.3g} kg/rad"))
    return terms


def _full_thrust_n(vehicle: Vehicle) -> float:
    return sum(c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2 for c in vehicle.constants_of_rotors)


def too_strong(vehicle: Vehicle, steps: TickSteps, most_mps: float, most_radps: float) -> str | None:
    """Return which figure takes the vehicle from rest beyond these speeds within one tick; None if no figure does."""
    group, (x, y, z) = vehicle.leading_group, vehicle.inertia_kgm2
    if group is None:
        return None
    c, n, of, thrust = group.constants, len(vehicle.rotors), group.key, _full_thrust_n(vehicle)
    arm = max((math.hypot(*rotor.position_m[:2]) for rotor in vehicle.rotors), default=0.0)
    lag_s = min(c.time_constant_up_s, c.time_constant_down_s)
    turns = [
        (thrust * arm / min(x, y), "thrust_coefficient_n_per_radps2", c.thrust_coefficient_n_per_radps2),
        (thrust * c.moment_ratio_m / z, "moment_ratio_m", c.moment_ratio_m),
        (n * c.inertia_kgm2 * c.max_speed_radps / lag_s / z, "inertia_kgm2", c.inertia_kgm2),
    ]
    alpha, key, value = max(turns)
    if alpha * steps.tick_s > most_radps:
        return (
            f"{of}.{key} {value:g} at up to {c.max_speed_radps:g} rad/s turns a body of inertia "
            f"{list(vehicle.inertia_kgm2)} kg m2 at up to {alpha:.3g} rad/s2"
        )
    if thrust / vehicle.mass_kg * steps.tick_s > most_mps:
        return (
            f"{of}.thrust_coefficient_n_per_radps2 {c.thrust_coefficient_n_per_radps2:g} at up to "
            f"{c.max_speed_radps:g} rad/s gives {vehicle.mass_kg:g} kg up to {thrust / vehicle.mass_kg:.3g} m/s2"
        )
    return None


def _shortest_s(steps: TickSteps) -> float:
    return steps.tick_s / (steps.free << _HALVINGS)
