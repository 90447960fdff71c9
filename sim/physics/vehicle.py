"""Parameters of a multirotor: mass, inertia, rotors, drag, and the spheres that can touch the scene.

All vectors are in B (FLU, origin at the centre of mass, axes principal), SI units.
"""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel, load_model
from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim._kernels import RigidBody
from sim.physics.integration import TickSteps

VEHICLE_DIR = Path(__file__).resolve().parents[2] / "rigs" / "vehicles"

Metres = Annotated[float, Field(ge=-10.0, le=10.0)]
Point = tuple[Metres, Metres, Metres]
NonNegative3 = tuple[
    Annotated[float, Field(ge=0.0, le=100.0)],
    Annotated[float, Field(ge=0.0, le=100.0)],
    Annotated[float, Field(ge=0.0, le=100.0)],
]
Inertia = Annotated[float, Field(gt=1e-7, le=100.0)]


class Battery(StrictModel):
    """Lithium-polymer pack that limits the speed of the rotors. Equations: sim/native/battery.hpp.

    The rotors' `max_speed_radps` holds at `nominal_voltage_v` and scales with the voltage.
    """

    cells: Annotated[int, Field(ge=1, le=24)]
    capacity_ah: Annotated[float, Field(gt=0.0, le=1000.0)]
    resistance_ohm: Annotated[float, Field(ge=0.0, le=10.0)]  # pack with its leads
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)]  # speed controller and motor: shaft power over electrical
    auxiliary_w: Annotated[float, Field(ge=0.0, le=10_000.0)]  # constant load besides the rotors
    nominal_voltage_v: Annotated[float, Field(gt=0.0, le=1000.0)]
    initial_charge: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  # state of charge at the start


class BatteryState(NamedTuple):
    """State of a battery at one tick."""

    charge: float  # state of charge, 1 full, 0 empty
    voltage_v: float  # at the start of the last tick
    current_a: float  # mean over that tick


class Effects(StrictModel):
    """Switches of the optional parts of the model.

    A part that is off costs nothing. Motor lag, gyroscopic torque and drag have no switch: set their coefficients in
    the vehicle file to zero.
    """

    ground_effect: bool = True  # more thrust near the ground
    descent_loss: bool = True  # less thrust in the vortex ring state
    battery: bool = False  # rotor speed limit follows the voltage; needs a vehicle with a battery


class Spin(StrEnum):
    """Direction in which a rotor turns, seen from above."""

    CCW = "ccw"
    CW = "cw"

    @property
    def sign(self) -> float:
        """+1 for counter-clockwise, about the body's up axis."""
        return 1.0 if self is Spin.CCW else -1.0


LEAST_UP = 0.1  # vertical part of a rotor's axis: 84 degrees of tilt
_COAXIAL_OFFSET_M = 0.01  # greatest distance of a lower rotor from the axis of the upper one
Component = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class Rotor(StrictModel):
    """One rotor; its index in the list is its number in the autopilot's control order."""

    position_m: Point
    spin: Spin  # seen against the axis: from above for an upright rotor
    axis: tuple[Component, Component, Component] = (0.0, 0.0, 1.0)  # direction of the thrust, normalised when read
    coaxial_below: Annotated[int, Field(ge=0, le=7)] | None = None  # index of the upper rotor of its coaxial pair

    @pydantic.field_validator("axis")
    @classmethod
    def _unit_vector(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        length = math.hypot(*axis)
        if length < 1e-6:
            raise ValueError(f"{list(axis)} has no direction: an upright rotor has [0, 0, 1]")
        unit = (axis[0] / length, axis[1] / length, axis[2] / length)
        if unit[2] < LEAST_UP:
            raise ValueError(f"{list(axis)} does not point up: a rotor may tilt by up to 84 degrees from [0, 0, 1]")
        return unit


class RotorConstants(StrictModel):
    """Constants that all rotors of a vehicle share.

    Thrust T = k O^2, torque on the body m_ratio T against the spin, in-plane drag k_d O v. The speed O follows the
    command with the time constant for up or down. The lower rotor of a coaxial pair has the thrust
    k O (O - (1 - coaxial_thrust_ratio) O_upper). Command u gives the speed O_max sqrt(f u^2 + (1 - f) u), with f the
    thrust model factor (PX4's THR_MDL_FAC): with 1 the thrust is quadratic in the command, with 0 linear. The other
    equations are in sim/native/rotor_air.hpp.
    """

    thrust_coefficient_n_per_radps2: Annotated[float, Field(gt=0.0, le=1.0)]
    moment_ratio_m: Annotated[float, Field(ge=0.0, le=1.0)]
    max_speed_radps: Annotated[float, Field(gt=0.0, le=10_000.0)]
    time_constant_up_s: Annotated[float, Field(ge=1e-3, le=1.0)]
    time_constant_down_s: Annotated[float, Field(ge=1e-3, le=1.0)]
    inertia_kgm2: Annotated[float, Field(ge=0.0, le=1.0)]
    drag_kg_per_rad: Annotated[float, Field(ge=0.0, le=1.0)]
    radius_m: Annotated[float, Field(gt=1e-3, le=5.0)]
    thrust_model_factor: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    axial_drag_kg_per_rad: Annotated[float, Field(ge=0.0, le=1.0)] = (
        0.0  # thrust loss = this x rotor speed x climb speed
    )
    ground_thrust_ratio: Annotated[float, Field(ge=1.0, le=4.0)] = 1.0  # thrust at the ground over thrust aloft
    descent_loss: Annotated[float, Field(ge=0.0, le=0.9)] = 0.0  # greatest share of thrust lost when descending
    # Thrust of the lower rotor of a coaxial pair over that of the upper one, at equal speeds.
    coaxial_thrust_ratio: Annotated[float, Field(ge=0.1, le=1.0)] = 1.0


class ContactSphere(StrictModel):
    """Sphere fixed to the body that can touch the scene: a foot, a motor, the hull."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    position_m: Point
    radius_m: Annotated[float, Field(gt=1e-3, le=5.0)]


class Vehicle(StrictModel):
    """Multirotor, as its file in rigs/vehicles describes it."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    description: str
    mass_kg: Annotated[float, Field(gt=1e-3, le=1000.0)]
    inertia_kgm2: tuple[Inertia, Inertia, Inertia]
    rotors: Annotated[tuple[Rotor, ...], Field(min_length=3, max_length=8)]
    rotor_constants: RotorConstants
    body_drag_linear_n_per_mps: NonNegative3
    body_drag_quadratic_n_per_m2ps2: NonNegative3
    feet: Annotated[tuple[ContactSphere, ...], Field(min_length=3, max_length=16)]
    hull: Annotated[tuple[ContactSphere, ...], Field(max_length=32)] = ()
    battery: Battery | None = None

    @pydantic.field_validator("rotors")
    @classmethod
    def _coaxial_pairs(cls, rotors: tuple[Rotor, ...]) -> tuple[Rotor, ...]:
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
        return rotors

    @pydantic.field_validator("inertia_kgm2")
    @classmethod
    def _triangle_inequality(cls, inertia: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = inertia
        if not (x + y >= z and y + z >= x and z + x >= y):
            raise ValueError(f"{inertia}: no moment of inertia can be greater than the sum of the other two")
        return inertia

    @pydantic.model_validator(mode="after")
    def _physical(self) -> Vehicle:
        names = [sphere.name for sphere in self.contact_spheres]
        if len(set(names)) != len(names):
            raise ValueError(f"contact spheres must have different names, not {names}")
        if self.hover_control > 0.95:
            raise ValueError(f"hovers at {self.hover_control:.2f} of full command: raise the thrust or lower the mass")
        return self

    @property
    def contact_spheres(self) -> tuple[ContactSphere, ...]:
        """Spheres of feet, then hull."""
        return self.feet + self.hull

    @property
    def bounding_radius_m(self) -> float:
        """Radius of a sphere about the body origin that encloses every contact sphere."""
        radius_m = 0.0
        for sphere in self.contact_spheres:
            x, y, z = sphere.position_m
            radius_m = max(radius_m, math.sqrt(x * x + y * y + z * z) + sphere.radius_m)
        return radius_m * (1.0 + 1e-12)

    @property
    def standing_height_m(self) -> float:
        """Height of the body origin over level ground when its lowest sphere just touches."""
        return max(sphere.radius_m - sphere.position_m[2] for sphere in self.contact_spheres)

    @property
    def thrust_shares(self) -> tuple[float, ...]:
        """Thrust of each rotor over that of a rotor alone, for small changes of speed about equal speeds.

        Both rotors of a coaxial pair have the same share: the lower rotor's thrust k O_i (O_i - c O_j) changes with
        the speed of either. Their sum at equal speeds is exact.
        """
        paired = {rotor.coaxial_below for rotor in self.rotors} - {None}
        shared = 0.5 * (1.0 + self.rotor_constants.coaxial_thrust_ratio)
        return tuple(
            shared if i in paired or rotor.coaxial_below is not None else 1.0 for i, rotor in enumerate(self.rotors)
        )

    @property
    def effectiveness(self) -> NDArray[np.float64]:
        """Force [N] and torque about the centre of mass [N m], in B, per newton of k O^2 of each rotor: (6, rotors)."""
        m = self.rotor_constants.moment_ratio_m
        columns = []
        for share, rotor in zip(self.thrust_shares, self.rotors, strict=True):
            axis = np.array(rotor.axis)
            torque = share * np.cross(rotor.position_m, axis) - rotor.spin.sign * m * axis
            columns.append(np.concatenate([share * axis, torque]))
        return np.column_stack(columns)

    @property
    def hover_control(self) -> float:
        """Command of each rotor at which the thrust aloft equals the standard weight, at nominal voltage."""
        c = self.rotor_constants
        lift = sum(share * rotor.axis[2] for share, rotor in zip(self.thrust_shares, self.rotors, strict=True))
        max_thrust_n = c.thrust_coefficient_n_per_radps2 * c.max_speed_radps * c.max_speed_radps * lift
        share, f = self.mass_kg * STANDARD_GRAVITY_MPS2 / max_thrust_n, c.thrust_model_factor
        if f == 0.0:
            return share
        return (math.sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * share) - (1.0 - f)) / (2.0 * f)

    def speed_radps(self, control: float) -> float:
        """Return the steady speed of a rotor at a command 0..1, at nominal voltage."""
        c = self.rotor_constants
        f = c.thrust_model_factor
        return c.max_speed_radps * math.sqrt(f * control * control + (1.0 - f) * control)


def vehicle_names() -> list[str]:
    """Return the names that `load_vehicle` accepts, sorted."""
    return sorted(path.stem for path in VEHICLE_DIR.glob("*.yaml"))


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """Load a vehicle of `rigs/vehicles` by name, or any file by path. Raises ConfigError."""
    return load_model(_path(name_or_path), Vehicle)[0]


def _path(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    return path if path.suffix else VEHICLE_DIR / f"{path}.yaml"


def rigid_body(
    vehicle: Vehicle,
    truth: NDArray[np.float64],
    *,
    effects: Effects,
    gravity_mps2: float,
    wind_W_mps: Vec3,
    steps: TickSteps,
) -> RigidBody:
    """Return the kernel for a vehicle; it works on the caller's `truth` [13 + rotors + 6]."""
    c = vehicle.rotor_constants
    return RigidBody(
        truth=truth,
        mass_kg=vehicle.mass_kg,
        inertia_kgm2=vehicle.inertia_kgm2,
        rotor_position_m=[rotor.position_m for rotor in vehicle.rotors],
        rotor_spin=[rotor.spin.sign for rotor in vehicle.rotors],
        thrust_coefficient_n_per_radps2=c.thrust_coefficient_n_per_radps2,
        moment_ratio_m=c.moment_ratio_m,
        max_speed_radps=c.max_speed_radps,
        time_constant_up_s=c.time_constant_up_s,
        time_constant_down_s=c.time_constant_down_s,
        rotor_inertia_kgm2=c.inertia_kgm2,
        rotor_drag_kg_per_rad=c.drag_kg_per_rad,
        body_drag_linear_n_per_mps=vehicle.body_drag_linear_n_per_mps,
        body_drag_quadratic_n_per_m2ps2=vehicle.body_drag_quadratic_n_per_m2ps2,
        gravity_mps2=gravity_mps2,
        wind_W_mps=wind_W_mps,
        tick_s=steps.tick_s,
        substeps=steps.free,
        contact_substeps=steps.contact[False],
        hard_contact_substeps=steps.contact[True],
        thrust_model_factor=c.thrust_model_factor,
        rotor_radius_m=c.radius_m,
        ground_thrust_ratio=c.ground_thrust_ratio if effects.ground_effect else 1.0,
        descent_loss=c.descent_loss if effects.descent_loss else 0.0,
        rotor_axial_kg_per_rad=c.axial_drag_kg_per_rad,
        classical=steps.classical,
        rotor_axis=[rotor.axis for rotor in vehicle.rotors],
        rotor_above=[-1 if rotor.coaxial_below is None else rotor.coaxial_below for rotor in vehicle.rotors],
        coaxial_loss=1.0 - c.coaxial_thrust_ratio,
    )
