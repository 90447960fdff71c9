"""Checks for a vehicle whose numbers no aircraft has: most are right in another unit than that of their key.

    tip speed            O R over the speed of sound                     shipped vehicles 0.28 to 0.62
    thrust coefficient   C_T = k / (rho pi R^4)                          0.0057 to 0.025
    torque over thrust   moment_ratio_m / R                              0.12 to 0.47
    radius of gyration   sqrt(I / m) over the distance of its outermost  0.16 to 0.60
                         sphere, rotor or wing tip; 1 would be a hollow
                         shell, and g for kg or cm2 for m2 give a factor
                         of 30 to 100
    thrust over weight   of all lifting rotors at full speed             1.7 to 4.6

Bounds are wide enough for any real propeller or ducted fan (C_T 0.1 to 0.25, because its disc is small) and narrow
enough for a factor of 9.55 (rev/min for rad/s), 39.4 (in for m) or 1000 (g for kg).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from signals.documents.document import Place
from signals.documents.validate import Located, at
from signals.errors import Problem
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.forces.rotors import LEAST_UP, RotorConstants, RotorGroup
from sim.physics.forces.wing import WingParameters
from sim.physics.vehicle import Vehicle
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

_SOUND_MPS = 340.3
_MOST_MACH = 0.95
_LEAST_MACH = 0.15  # of rotors at full speed
_THRUST_COEFFICIENT = (0.001, 0.4)
_PROPELLERS, _DUCTED_FANS = (0.005, 0.03), (0.1, 0.25)  # usual thrust coefficients
_MOST_TORQUE_ARM = 1.5
_GYRATION = (0.03, 2.0)
_MOST_THRUST = 30.0  # weights
_RADPS_OF_RPM = math.tau / 60.0


def unit_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    """Report what is out of range for any aircraft, with the unit in which the number would be right."""
    found = [problem for group in vehicle.rotor_groups for problem in _rotor_problems(group)]
    found += list(_mass_problems(vehicle) if not found else ()) or _gyration_problems(vehicle)
    return [at(file, place, message, hint) for place, message, hint in found]


def _rotor_problems(group: RotorGroup) -> Iterator[tuple[Place, str, str]]:
    c, key = group.constants, tuple(group.key.split("."))
    k = c.thrust_coefficient_n_per_radps2
    coefficient = k / (SEA_LEVEL_KGPM3 * math.pi * c.radius_m**4)
    mach = c.max_speed_radps * c.radius_m / _SOUND_MPS
    least, most = _THRUST_COEFFICIENT
    if not least <= coefficient <= most:
        message = (
            f"is {k:.4g}, and with radius_m {c.radius_m:g} the thrust coefficient C_T = k / (rho pi R^4) is "
            f"{coefficient:.2g}, where propellers have 0.005 to 0.03 and ducted fans 0.1 to 0.25"
        )
        yield (*key, "thrust_coefficient_n_per_radps2"), message, _thrust_hint(k, c.radius_m)
    elif mach > _MOST_MACH:
        speed = (*key, "max_speed_radps") if c.motor is None else (*key, "motor")
        message = (
            f"lets it turn at {c.max_speed_radps:.4g} rad/s, where tips {c.radius_m:g} m out move at Mach {mach:.2g}"
        )
        yield speed, message, _speed_hint(c, mach)
    arm = c.moment_ratio_m / c.radius_m
    if arm > _MOST_TORQUE_ARM:
        message = f"is {c.moment_ratio_m:g}, {arm:.2g} times radius_m: the torque of a propeller is 0.05 to 0.5 of T R"
        yield (*key, "moment_ratio_m"), message, "give torque over thrust in m"


def _speed_hint(c: RotorConstants, mach: float) -> str:
    if c.motor is not None:
        return "give kv_rpm_per_v without load, nominal_voltage_v in V, and radius_m in m"
    if _LEAST_MACH <= mach * _RADPS_OF_RPM <= _MOST_MACH:
        return f"{c.max_speed_radps:.4g} rev/min are {c.max_speed_radps * _RADPS_OF_RPM:.4g} rad/s"
    return "give the full speed under load in rad/s, not kV times volts"


def _thrust_hint(k: float, radius_m: float) -> str:
    """Return the unit in which thrust coefficient or radius would be those of a propeller, or else of a ducted fan."""
    units = (
        ("thrust is per (rad/s)^2, and it seems to be per (rev/min)^2", 1.0 / _RADPS_OF_RPM**2, 1.0),
        ("radius_m is in m, and it seems to be in inches", 1.0, 0.0254),
        ("radius_m is the radius, and it seems to be the diameter", 1.0, 0.5),
        ("radius_m is in m, and it seems to be in cm", 1.0, 0.01),
        ("radius_m is the radius in m, and it seems to be the diameter in inches", 1.0, 0.0127),
        ("thrust is in N, and it seems to be in grams of weight", 0.00980665, 1.0),
    )
    for least, most in (_PROPELLERS, _DUCTED_FANS):
        for unit, of_k, of_radius in units:
            if least <= of_k * k / (SEA_LEVEL_KGPM3 * math.pi * (of_radius * radius_m) ** 4) <= most:
                return unit
    return "check the units of both: N per (rad/s)^2, and m"


def _gyration_problems(vehicle: Vehicle) -> Iterator[tuple[Place, str, str]]:
    wings = [force for force in vehicle.forces if isinstance(force, WingParameters)]
    ends = [corner for wing in wings for solid in wing.solids(()) for corner in solid]
    ends += [rotor.position_m for rotor in vehicle.rotors]
    reach_m = max([vehicle.bounding_radius_m, *(math.hypot(*end) for end in ends)])
    least, most = _GYRATION
    for axis, inertia_kgm2 in zip("xyz", vehicle.inertia_kgm2, strict=True):
        share = math.sqrt(inertia_kgm2 / vehicle.mass_kg) / reach_m
        if least <= share <= most:
            continue
        message = (
            f"of {inertia_kgm2:.4g} about {axis} puts {vehicle.mass_kg:.4g} kg "
            f"{share * reach_m:.2g} m from the axis, and the vehicle's spheres, rotors and wings reach {reach_m:.2g} m"
        )
        yield ("inertia_kgm2",), message, "give inertias in kg m2, mass_kg in kg, and positions in m"
        return


def _mass_problems(vehicle: Vehicle) -> Iterator[tuple[Place, str, str]]:
    full_n = sum(
        g.constants.thrust_coefficient_n_per_radps2 * g.lift * g.constants.max_speed_radps**2
        for g in vehicle.rotor_groups
        if g.lift >= LEAST_UP
    )
    weights = full_n / (vehicle.mass_kg * STANDARD_GRAVITY_MPS2)
    message = f"of {vehicle.mass_kg:g} is lifted by {full_n:.3g} N at full speed, {weights:.2g} times its weight"
    if weights > _MOST_THRUST:
        yield ("mass_kg",), message, "give mass_kg in kg, and the thrust coefficient in N per (rad/s)^2"
    elif 1.0 < 1000.0 * weights <= _MOST_THRUST:
        yield ("mass_kg",), message, f"{vehicle.mass_kg:g} g are {vehicle.mass_kg / 1000:g} kg"
