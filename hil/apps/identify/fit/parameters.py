"""The unknowns of a fit: where each stands in the vehicle file, where it starts, and how far the fit may move it.

Each unknown is a number s with a weak prior s ~ N(0, prior^2) about the vehicle file's value p0:
    positive quantities   p = p_least + (p0 - p_least) exp(s),  p_least 0 but for what a floor bounds
    others                p = p0 + s
The mass stays as given: motion alone shows every force, moment and inertia per mass, never the mass itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.physics.forces.air_moment import AirMoment
from sim.physics.forces.blade_element import lumps_of
from sim.physics.vehicle import Vehicle


@dataclass(frozen=True)
class Unknown:
    """One unknown. `key` as in `Estimated.key`; `start` in `unit`; `prior` 1 sigma of s."""

    key: str
    start: float
    unit: str
    prior: float
    law: Literal["exp", "plus"] = "plus"
    sense: str = ""  # what a flight must contain to show it
    least: float = -math.inf  # that a vehicle file can say; for `exp` the floor that the law keeps above
    most: float = math.inf

    @property
    def floor(self) -> float:
        return max(self.least, 0.0)

    def value(self, s: float) -> float:
        return self.floor + (self.start - self.floor) * math.exp(s) if self.law == "exp" else self.start + s

    def slope(self, s: float) -> float:
        """dp/ds, which turns a deviation of s into one of the value."""
        return (self.start - self.floor) * math.exp(s) if self.law == "exp" else 1.0

    def inverse(self, value: float) -> float:
        """The s of a value; used for values that the caller fixes, and for bounds."""
        if self.law != "exp":
            return value - self.start
        return math.log((value - self.floor) / (self.start - self.floor))


# Of the vehicle, in the order of the model's parameter vector.
THRUST, MOMENT_RATIO, INERTIA, ROTOR_INERTIA, ROTOR_DRAG, AXIAL_DRAG = 0, 1, 2, 5, 6, 7
AIR_MOMENT, LINEAR_DRAG, QUADRATIC_DRAG, CENTRE, TAU_UP, TAU_DOWN, SHAPE, VOLTAGE = 8, 10, 13, 16, 19, 20, 21, 22
INFLOW, HUB_SHARE, GROUND, GROUND_RADIUS = 23, 24, 25, 26  # the first two of blade elements
VEHICLE_COUNT = 27
# Of one log, behind those of the vehicle.
MOTOR_DELAY, WIND, POSE_DELAY, GYRO_BIAS, ACCEL_BIAS, MISALIGNMENT = 0, 1, 4, 5, 8, 11
LOG_COUNT = 14

_TURN, _CLIMB, _LOW = "turn about that axis", "climb and sink", "hover low over the ground"
_WIND_MPS = 3.0  # scale of a log's level wind; that of its vertical one is 0.3 of it


@dataclass(frozen=True)
class _BladeStart:
    """Starts of what only one of the two rotor models has."""

    least_moment_ratio_m: float
    inflow_kg_per_rad: float
    hub_share: float
    ground: Unknown

    @staticmethod
    def of(vehicle: Vehicle) -> _BladeStart:
        c = vehicle.rotor_constants
        if vehicle.rotor_model != "blade_element" or c.blade_element is None:
            key = "rotor_constants.ground_thrust_ratio"
            ground = Unknown(key, c.ground_thrust_ratio, "-", 1.0, "exp", _LOW, least=1.0, most=4.0)
            return _BladeStart(0.0, 1.0, 0.0, ground)
        blades = c.blade_element
        lumps = lumps_of(c, blades)
        # Of the induced power alone, with what a thrust coefficient larger than the file's adds to it.
        least_m = 1.05 * blades.induced_power_factor * math.sqrt(lumps.kappa_m2)
        key = "rotor_constants.blade_element.ground_inflow_loss"
        ground = Unknown(key, max(blades.ground_inflow_loss, 1e-3), "-", 1.0, "exp", _LOW, least=0.0, most=0.95)
        return _BladeStart(least_m, lumps.c_l, blades.hub_moment_share, ground)


def vehicle_unknowns(vehicle: Vehicle) -> list[Unknown]:
    """Return the unknowns of a vehicle, `VEHICLE_COUNT` of them."""
    c = vehicle.rotor_constants
    hover_radps = math.sqrt(vehicle.mass_kg * 9.81 / (c.thrust_coefficient_n_per_radps2 * max(1, len(vehicle.rotors))))
    per_speed = vehicle.mass_kg / (len(vehicle.rotors) * hover_radps)  # kg/rad that brakes at 1 1/s
    arm_m = max((math.hypot(*rotor.position_m[:2]) for rotor in vehicle.rotors), default=1.0)
    linear, quadratic = vehicle.body_drag_linear_n_per_mps, vehicle.body_drag_quadratic_n_per_m2ps2
    air = [force for force in vehicle.forces if isinstance(force, AirMoment)]
    moment = (sum(force.about_x_ns for force in air), sum(force.about_y_ns for force in air))
    rc, blades = "rotor_constants", "rotor_constants.blade_element"
    voltage_slope = c.voltage_slope if vehicle.battery else 0.0
    blade = _BladeStart.of(vehicle)
    found = [
        Unknown(f"{rc}.thrust_coefficient_n_per_radps2", c.thrust_coefficient_n_per_radps2, "N/(rad/s)2", 1.0, "exp"),
        Unknown(
            f"{rc}.moment_ratio_m",
            max(c.moment_ratio_m, blade.least_moment_ratio_m + 1e-4),
            "m",
            1.0,
            "exp",
            "turn about z",
            least=blade.least_moment_ratio_m,
        ),
        *(
            Unknown(f"inertia_kgm2.{i}", vehicle.inertia_kgm2[i], "kg m2", 1.0, "exp", f"turn fast about {'xyz'[i]}")
            for i in range(3)
        ),
        Unknown(f"{rc}.inertia_kgm2", max(c.inertia_kgm2, 1e-9), "kg m2", 1.0, "exp", "sudden yaw commands"),
        Unknown(
            f"{rc}.drag_kg_per_rad", c.drag_kg_per_rad, "kg/rad", per_speed, "plus", "fly fast and sideways", least=0.0
        ),
        Unknown(f"{rc}.axial_drag_kg_per_rad", c.axial_drag_kg_per_rad, "kg/rad", per_speed, "plus", _CLIMB, least=0.0),
        *(
            Unknown(
                f"air_moment.about_{'xy'[i]}_ns", moment[i], "N s", 0.5 * vehicle.mass_kg * arm_m, "plus", "fly fast"
            )
            for i in range(2)
        ),
        *(
            Unknown(
                f"body_drag_linear_n_per_mps.{i}",
                linear[i],
                "N s/m",
                0.3 * vehicle.mass_kg,
                "plus",
                "fly fast",
                least=0.0,
            )
            for i in range(3)
        ),
        *(
            Unknown(
                f"body_drag_quadratic_n_per_m2ps2.{i}",
                quadratic[i],
                "N s2/m2",
                0.05 * vehicle.mass_kg,
                "plus",
                "fly at several speeds",
                least=0.0,
            )
            for i in range(3)
        ),
        *(Unknown(f"centre_of_mass_m.{i}", 0.0, "m", 0.1 * arm_m, "plus", _TURN) for i in range(3)),
        Unknown(f"{rc}.time_constant_up_s", c.time_constant_up_s, "s", 1.0, "exp", "sudden changes of thrust"),
        Unknown(f"{rc}.time_constant_down_s", c.time_constant_down_s, "s", 1.0, "exp", "sudden changes of thrust"),
        Unknown(
            f"{rc}.thrust_model_factor",
            c.thrust_model_factor,
            "-",
            0.5,
            "plus",
            "climb, hover and sink",
            least=0.0,
            most=1.0,
        ),
        Unknown(f"{rc}.voltage_slope", voltage_slope, "-", 1.0, "plus", "fly a battery empty", least=0.0, most=2.0),
        Unknown(f"{blades}.inflow_thrust_kg_per_rad", blade.inflow_kg_per_rad, "kg/rad", 1.0, "exp", _CLIMB),
        Unknown(f"{blades}.hub_moment_share", blade.hub_share, "-", 0.3, "plus", "fly fast", least=0.0, most=1.0),
        blade.ground,
        Unknown(f"{rc}.ground_radius_m", c.ground_radius_m or c.radius_m, "m", 1.0, "exp", _LOW),
    ]
    assert len(found) == VEHICLE_COUNT
    return found


def log_unknowns(name: str) -> list[Unknown]:
    """Return the unknowns of one log, `LOG_COUNT` of them."""
    key = f"log.{name}"
    axes = "xyz"
    found = [
        Unknown(f"{key}.motor_delay_s", 0.0, "s", 0.03, "plus", "sudden turns"),
        *(
            Unknown(
                f"{key}.wind_{a}_mps", 0.0, "m/s", _WIND_MPS if a != "z" else 0.3 * _WIND_MPS, "plus", "turn in wind"
            )
            for a in axes
        ),
        Unknown(f"{key}.pose_delay_s", 0.0, "s", 0.03, "plus", "fast manoeuvres"),
        *(Unknown(f"{key}.gyro_bias_{a}_radps", 0.0, "rad/s", 0.05, "plus") for a in axes),
        *(Unknown(f"{key}.accel_bias_{a}_mps2", 0.0, "m/s2", 0.5, "plus") for a in axes),
        *(Unknown(f"{key}.misalignment_{a}_rad", 0.0, "rad", 0.05, "plus", "hover and fly fast") for a in axes),
    ]
    assert len(found) == LOG_COUNT
    return found


def values(unknowns: Sequence[Unknown], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of the unknowns for the vector s."""
    return np.array([u.value(x) for u, x in zip(unknowns, s, strict=True)])
