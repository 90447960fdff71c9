"""Facts of a vehicle that a multirotor's controller needs. The vehicle itself may have other forces, or no rotors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.forces.force import Effects
from sim.physics.forces.motor import curve_factor, steady_duty, steady_speed_radps
from sim.physics.forces.rotors import LEAST_UP, RotorGroup
from sim.physics.vehicle import Vehicle, load_vehicle, vehicle_names
from sim.scene.atmosphere import SEA_LEVEL_KGPM3
from sim.scene.scene import Site

LEAST_ROTORS = 3
_MOST_HOVER_CONTROL = 0.95


def unfit(vehicle: Vehicle) -> tuple[str, str] | None:
    """Return the key of the vehicle's file and the reason why it cannot hover on its rotors; None if it can."""
    if vehicle.tilts:
        return "tilts", "turns rotors by servos, which a multirotor's controller does not command"
    count = len(vehicle.rotors)
    if count < LEAST_ROTORS:
        return "rotors", f"holds {count} rotors, and a multirotor's controller needs at least {LEAST_ROTORS}"
    for i, rotor in enumerate(vehicle.rotors):
        if rotor.axis[2] < LEAST_UP:
            return "rotors", f"holds rotor {i} that does not point up, as a multirotor's controller needs all to"
    hover = hover_control(vehicle)
    if hover > _MOST_HOVER_CONTROL:
        return "mass_kg", f"makes it hover at {hover:.2f} of full command: raise the thrust or lower the mass"
    return None


def uneven(vehicle: Vehicle) -> tuple[str, str] | None:
    """Return the key and the reason why a controller of equal rotors cannot fly the vehicle; None if it can."""
    if len(vehicle.rotor_groups) < 2:
        return None
    return "rotor_sets", f"makes rotors of {len(vehicle.rotor_groups)} kinds, and this controller needs equal ones"


def multirotor_names() -> list[str]:
    """Return the names of the shipped vehicles that hover on their rotors, sorted."""
    return [name for name in vehicle_names() if unfit(load_vehicle(name)) is None]


def effectiveness(vehicle: Vehicle) -> NDArray[np.float64]:
    """Return force and torque about the centre of mass per newton of k O^2 of each rotor, in B: (6, rotors) [-, m]."""
    columns = []
    for share, rotor, c in zip(vehicle.thrust_shares, vehicle.rotors, vehicle.constants_of_rotors, strict=True):
        axis = np.array(rotor.axis)
        torque = share * np.cross(rotor.position_m, axis) - rotor.spin.sign * c.moment_ratio_m * axis
        columns.append(np.concatenate([share * axis, torque]))
    return np.column_stack(columns)


def hover_control(vehicle: Vehicle, density_ratio: float = 1.0) -> float:
    """Return the command of each rotor at which the thrust aloft equals the standard weight; infinite if none lifts.

    At nominal voltage. `density_ratio`: density of the air over that of the vehicle's file.
    """
    lifting = lifting_groups(vehicle)
    if not lifting:
        return math.inf
    if len(lifting) > 1:
        return _common_control(vehicle, lifting, density_ratio)
    (group,) = lifting
    c, lift = group.constants, group.lift
    if c.motor is not None:
        hover_radps = vehicle.hover_speeds_radps(density_ratio)[group.first]
        return steady_duty(c, c.motor, hover_radps, density_ratio)
    max_thrust_n = density_ratio * c.thrust_coefficient_n_per_radps2 * c.max_speed_radps * c.max_speed_radps * lift
    share, f = vehicle.mass_kg * STANDARD_GRAVITY_MPS2 / max_thrust_n, c.thrust_model_factor
    if f == 0.0:
        return share
    return (math.sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * share) - (1.0 - f)) / (2.0 * f)


def lifting_groups(vehicle: Vehicle) -> list[RotorGroup]:
    """Return the groups of rotors that lift."""
    return [group for group in vehicle.rotor_groups if group.lift >= LEAST_UP]


def _common_control(vehicle: Vehicle, lifting: Sequence[RotorGroup], density_ratio: float) -> float:
    """Return the command at which all sets together carry the weight; above 1 the square root of the missing thrust."""
    weight_n = vehicle.mass_kg * STANDARD_GRAVITY_MPS2

    def thrust_n(control: float) -> float:
        return sum(
            density_ratio
            * g.constants.thrust_coefficient_n_per_radps2
            * g.lift
            * group_speed_radps(g, control, density_ratio) ** 2
            for g in lifting
        )

    if thrust_n(1.0) <= weight_n:
        return math.sqrt(weight_n / thrust_n(1.0))
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if thrust_n(middle) < weight_n else (low, middle)
    return 0.5 * (low + high)


def group_speed_radps(group: RotorGroup, control: float, density_ratio: float = 1.0) -> float:
    """Return the steady speed of a group's rotors at a command 0..1 in still air, at nominal voltage."""
    c = group.constants
    if c.motor is not None:
        return steady_speed_radps(c, c.motor, control, density_ratio)
    f = c.thrust_model_factor
    return c.max_speed_radps * math.sqrt(f * control * control + (1.0 - f) * control)


def density_ratio(vehicle: Vehicle, site: Site, effects: Effects) -> float:
    """Return the density of the air at a site over that for which the vehicle's thrust holds, as the physics has it."""
    group = vehicle.leading_group
    blades = None if group is None else group.blades
    if blades is None or not effects.air_density:
        return 1.0
    return site.density_ratio * SEA_LEVEL_KGPM3 / blades.air_density_kgpm3


def speed_radps(vehicle: Vehicle, control: float) -> float:
    """Return the steady speed of the leading rotors at a command 0..1 in still air, at nominal voltage."""
    group = vehicle.leading_group
    if group is None:
        raise ValueError(f"the vehicle {vehicle.name!r} has no rotors")
    return group_speed_radps(group, control)


def max_speed_radps(vehicle: Vehicle, density_ratio: float = 1.0) -> float:
    """Return the steady speed of the leading rotors at full command; a motor turns faster in thin air."""
    group = vehicle.leading_group
    return vehicle.rotor_constants.max_speed_radps if group is None else group_speed_radps(group, 1.0, density_ratio)


def full_thrusts_n(vehicle: Vehicle, density_ratio: float = 1.0) -> NDArray[np.float64]:
    """Return k O^2 of each rotor at full command [N]."""
    return np.array(
        [
            density_ratio
            * group.constants.thrust_coefficient_n_per_radps2
            * group_speed_radps(group, 1.0, density_ratio) ** 2
            for group in vehicle.rotor_groups
            for _ in group.rotors
        ]
    )


def thrust_model_factor(vehicle: Vehicle, density_ratio: float = 1.0) -> float:
    """Return f of the curve f u^2 + (1 - f) u of the relative thrust; with motors it goes through hover."""
    group = vehicle.leading_group
    c = vehicle.rotor_constants if group is None else group.constants
    if c.motor is None or group is None:
        return c.thrust_model_factor
    most = max_speed_radps(vehicle, density_ratio)
    share = (min(vehicle.hover_speeds_radps(density_ratio)[group.first], most) / most) ** 2
    return curve_factor(min(1.0, hover_control(vehicle, density_ratio)), share)
