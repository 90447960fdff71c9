"""Rotors of a vehicle as its file describes them. Equations: sim/native/forces/rotors.hpp.

All vectors are in B (FLU, origin at the centre of mass, axes principal), SI units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Literal, NamedTuple

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.samples import Vec3
from sim import _kernels
from sim.physics.forces.blade_element import BladeElement, lumps_of
from sim.physics.forces.force import Effects, Point
from sim.physics.forces.motor import Motor
from sim.physics.forces.rotor_equations import coaxial_wake
from sim.physics.forces.wind_tunnel import WindTunnel
from sim.scene.atmosphere import SEA_LEVEL_KGPM3


class Spin(StrEnum):
    """Direction in which a rotor turns, seen from above."""

    CCW = "ccw"
    CW = "cw"

    @property
    def sign(self) -> float:
        """+1 for counter-clockwise, about the body's up axis."""
        return 1.0 if self is Spin.CCW else -1.0


_MOST_MOTOR_RATE_PER_S = 2000.0  # a time constant of 0.5 ms, which the steps of the integrator still follow
LEAST_UP = 0.1  # vertical part of the axis of a rotor that lifts: 84 degrees of tilt
_LEAST_AHEAD = -0.1  # of a propeller ahead, with some degrees of down-thrust
_COAXIAL_OFFSET_M = 0.01  # greatest distance of a lower rotor from the axis of the upper one
Component = Annotated[float, Field(ge=-1000.0, le=1000.0)]


def unit_vector(axis: tuple[float, float, float], usual: str) -> tuple[float, float, float]:
    """Return a vector of length 1. Raises ValueError for one of length 0."""
    length = math.hypot(*axis)
    if length < 1e-6:
        raise ValueError(f"{list(axis)} has no direction: {usual}")
    return (axis[0] / length, axis[1] / length, axis[2] / length)


class Rotor(StrictModel):
    """One rotor; its index in the list is its number in the autopilot's control order."""

    position_m: Point
    spin: Spin  # seen against the axis: from above for an upright rotor
    axis: tuple[Component, Component, Component] = (0.0, 0.0, 1.0)  # direction of the thrust, normalised when read
    coaxial_below: Annotated[int, Field(ge=0, le=7)] | None = None  # index of the upper rotor of its coaxial pair
    set: str | None = None  # name in `rotor_sets`; null: the vehicle's own `rotor_constants`

    @pydantic.field_validator("axis")
    @classmethod
    def _unit_vector(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        unit = unit_vector(axis, "an upright rotor has [0, 0, 1]")
        if unit[2] < _LEAST_AHEAD:
            raise ValueError(
                f"{list(axis)} does not point up or ahead: a rotor may tilt by up to 96 degrees from [0, 0, 1]"
            )
        return unit


class RotorConstants(StrictModel):
    """Constants that the rotors of a set share.

    Thrust T = k O^2, torque on the body m_ratio T against the spin, in-plane drag k_d O v. The speed O follows the
    command with the time constant for up or down. The lower rotor of a coaxial pair has the thrust
    k O (O - (1 - coaxial_thrust_ratio) O_upper). Command u gives the speed O_max sqrt(f u^2 + (1 - f) u), with f the
    thrust model factor (PX4's THR_MDL_FAC): with 1 the thrust is quadratic in the command, with 0 linear. The other
    equations are in sim/native/forces/rotor_air.hpp.
    """

    thrust_coefficient_n_per_radps2: Annotated[float, Field(gt=0.0, le=1.0)]
    moment_ratio_m: Annotated[float, Field(ge=0.0, le=1.0)]
    max_speed_radps: Annotated[float, Field(gt=0.0, le=10_000.0)]
    dead_time_s: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0  # of the speed controller, before the time constants
    time_constant_up_s: Annotated[float, Field(ge=1e-3, le=1.0)]
    time_constant_down_s: Annotated[float, Field(ge=1e-3, le=1.0)]
    inertia_kgm2: Annotated[float, Field(ge=0.0, le=1.0)]
    drag_kg_per_rad: Annotated[float, Field(ge=0.0, le=1.0)]
    radius_m: Annotated[float, Field(gt=1e-3, le=5.0)]
    thrust_model_factor: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    # Relative change of the speed at a command over that of the battery's voltage, at the nominal voltage.
    voltage_slope: Annotated[float, Field(ge=0.0, le=2.0)] = 1.0
    axial_drag_kg_per_rad: Annotated[float, Field(ge=0.0, le=1.0)] = (
        0.0  # thrust loss = this x rotor speed x climb speed
    )
    ground_thrust_ratio: Annotated[float, Field(ge=1.0, le=4.0)] = 1.0  # thrust at the ground over thrust aloft
    # Of one rotor with the ground effect of the whole vehicle; None: `radius_m`. Theory for n rotors far from the
    # ground: sqrt(n) times that, and the hull adds to it.
    ground_radius_m: Annotated[float, Field(gt=1e-3, le=20.0)] | None = None
    descent_loss: Annotated[float, Field(ge=0.0, le=0.9)] = 0.0  # greatest share of thrust lost when descending
    # Thrust of the lower rotor of a coaxial pair over that of the upper one, at equal speeds.
    coaxial_thrust_ratio: Annotated[float, Field(ge=0.1, le=1.0)] = 1.0
    blade_element: BladeElement | None = None  # for `rotor_model: blade_element`
    wind_tunnel: WindTunnel | None = None  # for `rotor_model: wind_tunnel`
    # With a motor the speed follows from voltage and load. A vehicle then computes max_speed_radps,
    # thrust_model_factor and both time constants from it, whatever its file says of them: full duty, the thrust curve
    # through hover, and small changes about hover, in still air at nominal voltage.
    motor: Motor | None = None

    @pydantic.model_validator(mode="after")
    def _heavy_enough(self) -> RotorConstants:
        if self.motor is None:
            return self
        rate_per_s = 1.0 / (self.motor.speed_per_volt_radps**2 * self.motor.resistance_ohm)  # K^2 / R
        if self.inertia_kgm2 * _MOST_MOTOR_RATE_PER_S < rate_per_s:
            raise ValueError(
                f"inertia_kgm2 {self.inertia_kgm2:g} is too small for the motor, which needs at least "
                f"{rate_per_s / _MOST_MOTOR_RATE_PER_S:.2g}: rotor and bell of the motor"
            )
        return self


RotorModel = Literal["blade_element", "quadratic", "wind_tunnel"]


class RotorSet(StrictModel):
    """Constants of the rotors that name this set: another propeller, motor or model than `rotor_constants`."""

    rotor_model: RotorModel = "quadratic"
    rotor_constants: RotorConstants


class RotorGroup(NamedTuple):
    """Rotors with the same constants, which follow each other in the file: one force of the body."""

    key: str  # of its constants in the vehicle's file
    first: int  # index of its first rotor
    rotors: tuple[Rotor, ...]
    model: RotorModel
    constants: RotorConstants
    up: Vec3  # direction in B that points up in hover

    @property
    def blades(self) -> BladeElement | WindTunnel | None:
        """Parameters of the rotor model; None for the quadratic one."""
        c = self.constants
        return {"blade_element": c.blade_element, "wind_tunnel": c.wind_tunnel, "quadratic": None}[self.model]

    @property
    def indices(self) -> range:
        """Indices of its rotors in the vehicle."""
        return range(self.first, self.first + len(self.rotors))

    @property
    def thrust_shares(self) -> tuple[float, ...]:
        """Thrust of each rotor over that of a rotor alone, for small changes of speed about equal speeds.

        Both rotors of a coaxial pair have the same share: the lower rotor's thrust k O_i (O_i - c O_j) changes with
        the speed of either. Their sum at equal speeds is exact.
        """
        paired = {rotor.coaxial_below for rotor in self.rotors} - {None}
        shared = 0.5 * (1.0 + self.constants.coaxial_thrust_ratio)
        return tuple(
            shared if i in paired or rotor.coaxial_below is not None else 1.0
            for i, rotor in zip(self.indices, self.rotors, strict=True)
        )

    @property
    def lift(self) -> float:
        """Vertical part of the axes in hover, summed with the shares: the lift of the group over k O^2 of a rotor."""
        x, y, z = self.up
        return sum(
            share * (x * rotor.axis[0] + y * rotor.axis[1] + z * rotor.axis[2])
            for share, rotor in zip(self.thrust_shares, self.rotors, strict=True)
        )

    def force(self, effects: Effects) -> _kernels.Rotors:
        """Return the force of these rotors."""
        return rotors_force(self.rotors, self.constants, effects, blades=self.blades, first=self.first)


def rotor_groups(
    rotors: Sequence[Rotor],
    model: RotorModel,
    constants: RotorConstants,
    sets: Mapping[str, RotorSet],
    up: Vec3 = (0.0, 0.0, 1.0),
) -> tuple[RotorGroup, ...]:
    """Return the groups of a vehicle's rotors, in their order."""
    groups, first = [], 0
    for name, members in itertools.groupby(rotors, key=lambda rotor: rotor.set):
        own = tuple(members)
        if name is None:
            groups.append(RotorGroup("rotor_constants", first, own, model, constants, up))
        else:
            of = sets[name]
            key = f"rotor_sets.{name}.rotor_constants"
            groups.append(RotorGroup(key, first, own, of.rotor_model, of.rotor_constants, up))
        first += len(own)
    return tuple(groups)


def check_sets(rotors: Sequence[Rotor], sets: Mapping[str, RotorSet]) -> None:
    """Raise ValueError unless each rotor's set exists, each set has rotors, and they follow each other."""
    known = f"it has {', '.join(sets)}" if sets else "the file has none"
    for i, rotor in enumerate(rotors):
        if rotor.set is not None and rotor.set not in sets:
            raise ValueError(f"set of rotor {i} is {rotor.set!r}, which is no set of rotor_sets: {known}")
    names = [name for name, _ in itertools.groupby(rotor.set for rotor in rotors)]
    if unused := [name for name in sets if name not in names]:
        raise ValueError(f"rotor_sets.{unused[0]} has no rotors: a rotor names it with `set: {unused[0]}`")
    if len(set(names)) != len(names):
        again = next(name for name in names if names.count(name) > 1)
        which = "without a set" if again is None else f"of the set {again!r}"
        raise ValueError(f"rotors {which} are apart: those of a set must follow each other in the list")
    for i, rotor in enumerate(rotors):
        above = rotor.coaxial_below
        if above is not None and above < len(rotors) and rotors[above].set != rotor.set:
            raise ValueError(f"coaxial_below of rotor {i} is {above}, a rotor of another set")


def check_coaxial_pairs(rotors: Sequence[Rotor]) -> None:
    """Raise ValueError unless every `coaxial_below` names a rotor above on the same axis, of this pair only."""
    pairs = {i: rotor.coaxial_below for i, rotor in enumerate(rotors) if rotor.coaxial_below is not None}
    for i, above in pairs.items():
        if above >= len(rotors) or above == i or above in pairs or list(pairs.values()).count(above) > 1:
            raise ValueError(
                f"coaxial_below of rotor {i} is {above}: it must name another rotor, which is the upper rotor of "
                "this pair only"
            )
        lower, upper = rotors[i], rotors[above]
        down = [u - v for u, v in zip(upper.position_m, lower.position_m, strict=True)]
        along = sum(d * n for d, n in zip(down, upper.axis, strict=True))
        across = math.sqrt(max(0.0, sum(d * d for d in down) - along * along))
        if lower.axis != upper.axis or along <= 0.0 or across > _COAXIAL_OFFSET_M:
            raise ValueError(
                f"coaxial_below of rotor {i} is {above}, but it is not below rotor {above} on the same axis"
            )


def no_rotors() -> RotorConstants:
    """Return the constants of a vehicle without rotors, which nothing reads."""
    return RotorConstants(
        thrust_coefficient_n_per_radps2=1.0,
        moment_ratio_m=0.0,
        max_speed_radps=1.0,
        time_constant_up_s=1.0,
        time_constant_down_s=1.0,
        inertia_kgm2=0.0,
        drag_kg_per_rad=0.0,
        radius_m=0.002,
    )


def rotors_force(
    rotors: Sequence[Rotor],
    c: RotorConstants,
    effects: Effects,
    *,
    blades: BladeElement | WindTunnel | None = None,
    first: int = 0,
) -> _kernels.Rotors:
    """Return the force of these rotors; its commands and own states (speeds) are in their order.

    With `blades` it is that of blade-element momentum theory, or of a wind tunnel's coefficients. `first`: index of the
    first of them in the vehicle.
    """
    loads = _loads_force(rotors, c, effects, blades, first)
    if c.motor is None:
        return loads
    driven = {
        _kernels.Rotors: _kernels.MotorRotors,
        _kernels.BladeRotors: _kernels.MotorBladeRotors,
        _kernels.TunnelRotors: _kernels.MotorTunnelRotors,
    }[type(loads)]
    return driven(
        loads,
        speed_per_volt_radps=c.motor.speed_per_volt_radps,
        resistance_ohm=c.motor.resistance_ohm,
        no_load_current_a=c.motor.no_load_current_a,
        nominal_voltage_v=c.motor.nominal_voltage_v,
        braking=c.motor.active_braking,
    )


def _loads_force(
    rotors: Sequence[Rotor], c: RotorConstants, effects: Effects, blades: BladeElement | WindTunnel | None, first: int
) -> _kernels.Rotors:
    quadratic = _kernels.Rotors(
        position_m=[rotor.position_m for rotor in rotors],
        spin=[rotor.spin.sign for rotor in rotors],
        axis=[rotor.axis for rotor in rotors],
        above=[-1 if rotor.coaxial_below is None else rotor.coaxial_below - first for rotor in rotors],
        coaxial_loss=1.0 - c.coaxial_thrust_ratio,
        thrust_coefficient_n_per_radps2=c.thrust_coefficient_n_per_radps2,
        moment_ratio_m=c.moment_ratio_m,
        max_speed_radps=c.max_speed_radps,
        thrust_model_factor=c.thrust_model_factor,
        time_constant_up_s=c.time_constant_up_s,
        time_constant_down_s=c.time_constant_down_s,
        inertia_kgm2=c.inertia_kgm2,
        drag_kg_per_rad=c.drag_kg_per_rad,
        axial_drag_kg_per_rad=c.axial_drag_kg_per_rad,
        radius_m=c.radius_m,
        ground_thrust_ratio=c.ground_thrust_ratio if effects.ground_effect else 1.0,
        descent_loss=c.descent_loss if effects.descent_loss else 0.0,
        ground_radius_m=c.radius_m if c.ground_radius_m is None else c.ground_radius_m,
        voltage_slope=c.voltage_slope,
        air_density_kgpm3=SEA_LEVEL_KGPM3 if blades is None else blades.air_density_kgpm3,
    )
    if blades is None:
        return quadratic
    if isinstance(blades, WindTunnel):
        return blades.force(quadratic)
    found = lumps_of(c, blades)
    given = blades.translational_thrust_kg_per_m
    return _kernels.BladeRotors(
        quadratic,
        inflow_thrust_kg_per_rad=found.c_l,
        translational_thrust_kg_per_m=-1.0 if given is None else given,
        induced_power_factor=blades.induced_power_factor,
        profile_power_growth=blades.profile_power_growth,
        hub_moment_share=blades.hub_moment_share,
        ground_floor=found.ground_floor if effects.ground_effect else 0.0,
        density_ratio=SEA_LEVEL_KGPM3 / blades.air_density_kgpm3,
        coaxial_wake=coaxial_wake(c, found) if c.coaxial_thrust_ratio < 1.0 else 0.0,
    )
