"""Parameters of the blade-element momentum model of a rotor, and the lumps that its equations take.

Equations: rotor_equations.py of this folder, and sim/native/forces/blade_rotors.hpp. Static thrust and torque are those
of `RotorConstants`, k O^2 and m_ratio k O^2, at the density of the air for which the file holds.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Protocol

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

_WAYS = ("inflow_thrust_kg_per_rad", "zero_thrust_advance_ratio", "blades")


class StaticRotor(Protocol):
    """The part of `RotorConstants` that the model takes."""

    @property
    def thrust_coefficient_n_per_radps2(self) -> float: ...
    @property
    def moment_ratio_m(self) -> float: ...
    @property
    def drag_kg_per_rad(self) -> float: ...
    @property
    def radius_m(self) -> float: ...
    @property
    def ground_radius_m(self) -> float | None: ...
    @property
    def coaxial_thrust_ratio(self) -> float: ...


class Blades(StrictModel):
    """Blades of a rotor: enough for its change of thrust with inflow."""

    count: Annotated[int, Field(ge=1, le=8)]
    mean_chord_m: Annotated[float, Field(gt=0.0, le=1.0)]  # area of a blade over the radius
    lift_slope_per_rad: Annotated[float, Field(gt=0.0, le=7.0)] = 5.0  # estimate for small propellers; thin plate 2 pi


class BladeElement(StrictModel):
    """Parameters of the blade-element momentum model besides the constants of the rotor.

    The change of thrust with the flow through the rotor is given in one of three ways: the lump itself, the advance
    ratio J = u / (n D) at which the propeller has no thrust (wind-tunnel tables), or the blades.
    """

    inflow_thrust_kg_per_rad: Annotated[float, Field(gt=0.0, le=10.0)] | None = None  # c_l
    zero_thrust_advance_ratio: Annotated[float, Field(gt=0.0, le=3.0)] | None = None
    blades: Blades | None = None
    translational_thrust_kg_per_m: Annotated[float, Field(ge=0.0, le=100.0)] | None = None  # c_V; theory: 1.5 c_t / R^2
    induced_power_factor: Annotated[float, Field(ge=1.0, le=2.0)] = 1.15  # kappa_i: Leishman, ch. 2
    profile_power_growth: Annotated[float, Field(ge=0.0, le=10.0)] = 4.65  # with mu^2: Leishman, ch. 5
    hub_moment_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5  # 1 rigid blades, 0 freely hinged
    ground_inflow_loss: Annotated[float, Field(ge=0.0, le=0.95)] = 0.6  # at the ground; far above it Hayden's
    air_density_kgpm3: Annotated[float, Field(gt=0.01, le=5.0)] = SEA_LEVEL_KGPM3  # for which the file's constants hold

    @pydantic.model_validator(mode="after")
    def _one_way(self) -> BladeElement:
        given = [name for name in _WAYS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of {', '.join(_WAYS)}, not {' and '.join(given) or 'none'}")
        return self


class RotorLumps(NamedTuple):
    """Coefficients of one rotor in the equations. Every value may be a number or a symbol."""

    c_t: float  # thrust without inflow over O^2 [N s2]
    c_l: float  # loss of thrust over O and inflow [kg/rad]
    c_v: float  # thrust over the square of the speed across, drag over its product with the inflow [kg/m]
    c_q: float  # profile torque over O^2 [N m s2]
    k_d: float  # drag over O and the speed across [kg/rad]
    kappa_m2: float  # v_h^2 / O^2
    disc_kg_per_m: float  # 2 rho A of the air for which the coefficients hold
    radius_m: float
    induced_power_factor: float
    profile_power_growth: float
    hub_moment_share: float
    ground_radius_m: float  # of one rotor with the ground effect of the vehicle
    ground_floor: float  # Hayden's coefficient over the loss of inflow at the ground; 0 without ground effect


HAYDEN = 16.0 * 4.0 * 0.0379  # of 1 - v / v_far, over (R / 4z)^2: rotor_equations.py


def inflow_thrust_kg_per_rad(c: StaticRotor, model: BladeElement) -> float:
    """Return c_l of a rotor. Raises ValueError if the advance ratio is below what the static thrust needs.

    blades    c_l = rho a N c R^2 / 4: blade element theory with uniform inflow (Leishman, ch. 3)
    J_0       no thrust at u = J_0 n D = J_0 R O / pi, where c_t O = c_l u and c_t = k + c_l sqrt(kappa):
              c_l = k / (J_0 R / pi - sqrt(kappa))
    """
    if model.inflow_thrust_kg_per_rad is not None:
        return model.inflow_thrust_kg_per_rad
    if model.blades is not None:
        b = model.blades
        return (
            0.25 * model.air_density_kgpm3 * b.lift_slope_per_rad * b.count * b.mean_chord_m * c.radius_m * c.radius_m
        )
    assert model.zero_thrust_advance_ratio is not None
    k = c.thrust_coefficient_n_per_radps2
    per_speed = math.sqrt(k / (2.0 * model.air_density_kgpm3 * math.pi * c.radius_m * c.radius_m))
    room = model.zero_thrust_advance_ratio * c.radius_m / math.pi - per_speed
    if room <= 0.0:
        raise ValueError(
            f"zero_thrust_advance_ratio {model.zero_thrust_advance_ratio:g} is too small: the induced flow "
            f"of this rotor in hover is an advance ratio of {per_speed * math.pi / c.radius_m:.3g}"
        )
    return k / room


def lumps_of(c: StaticRotor, model: BladeElement) -> RotorLumps:
    """Return the lumps of a rotor with static thrust k O^2 and static torque m_ratio k O^2.

    Raises ValueError for constants that contradict each other.
    """
    radius2 = c.radius_m * c.radius_m
    disc = 2.0 * model.air_density_kgpm3 * math.pi * c.radius_m * c.radius_m
    k, c_l = c.thrust_coefficient_n_per_radps2, inflow_thrust_kg_per_rad(c, model)
    kappa = k / disc
    per_speed = kappa**0.5  # v_h / O
    c_t = k + c_l * per_speed
    across = model.translational_thrust_kg_per_m
    found = RotorLumps(
        c_t=c_t,
        c_l=c_l,
        c_v=1.5 * c_t / radius2 if across is None else across,
        c_q=k * (c.moment_ratio_m - model.induced_power_factor * per_speed),
        k_d=c.drag_kg_per_rad,
        kappa_m2=kappa,
        disc_kg_per_m=disc,
        radius_m=c.radius_m,
        induced_power_factor=model.induced_power_factor,
        profile_power_growth=model.profile_power_growth,
        hub_moment_share=model.hub_moment_share,
        ground_radius_m=c.radius_m if c.ground_radius_m is None else c.ground_radius_m,
        ground_floor=HAYDEN / model.ground_inflow_loss if model.ground_inflow_loss > 0.0 else 0.0,
    )
    if found.c_q < 0.0:
        least = model.induced_power_factor * math.sqrt(found.kappa_m2)
        raise ValueError(
            f"moment_ratio_m {c.moment_ratio_m:g} is below {least:.4g}, the torque over thrust of the induced power "
            "alone: raise it, or lower induced_power_factor"
        )
    return found
