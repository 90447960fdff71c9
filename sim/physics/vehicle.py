"""A vehicle as its file in rigs/vehicles describes it: a rigid body, what acts on it, and what can touch the scene.

All vectors are in B (FLU, origin at the centre of mass), SI units.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel, load_model
from signals.samples import Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim import _kernels
from sim.physics.battery import Battery
from sim.physics.forces.blade_element import BladeElement, lumps_of
from sim.physics.forces.force import Command, Effects, ForceParameters, Point, any_kind
from sim.physics.forces.motor import curve_factor, lag_s, steady_duty, steady_speed_radps
from sim.physics.forces.rotors import LEAST_UP, Rotor, RotorConstants, check_coaxial_pairs, no_rotors, rotors_force
from sim.physics.forces.surface import Surface, check_names
from sim.physics.forces.wind_tunnel import WindTunnel
from sim.physics.integration import TickSteps
from sim.physics.vibration import Vibration

_CRUISE_SHARE = 0.7  # of a propeller's full speed, where no rotor lifts
VEHICLE_DIR = Path(__file__).resolve().parents[2] / "rigs" / "vehicles"

NonNegative3 = tuple[
    Annotated[float, Field(ge=0.0, le=100.0)],
    Annotated[float, Field(ge=0.0, le=100.0)],
    Annotated[float, Field(ge=0.0, le=100.0)],
]
Inertia = Annotated[float, Field(gt=1e-7, le=100.0)]
_Product = Annotated[float, Field(ge=-100.0, le=100.0)]
CONTROLS = 16  # of an ActuatorFrame


class ContactSphere(StrictModel):
    """Sphere fixed to the body that can touch the scene: a foot, a motor, the hull."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    position_m: Point
    radius_m: Annotated[float, Field(gt=1e-3, le=5.0)]


if TYPE_CHECKING:
    AnyForce = ForceParameters
else:
    AnyForce = any_kind()


class Vehicle(StrictModel):
    """Rigid body with the forces that act on it: drag of the airframe, rotors, then those of `forces`."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    description: str
    mass_kg: Annotated[float, Field(gt=1e-3, le=1000.0)]
    inertia_kgm2: tuple[Inertia, Inertia, Inertia]
    # [Ixy, Ixz, Iyz], Ixy = int x y dm in B: a table's J_xz in x ahead, y right, z down has the other sign here.
    inertia_products_kgm2: tuple[_Product, _Product, _Product] = (0.0, 0.0, 0.0)
    rotors: Annotated[tuple[Rotor, ...], Field(max_length=8)] = ()
    rotor_constants: RotorConstants = Field(default_factory=no_rotors)
    rotor_model: Literal["blade_element", "quadratic", "wind_tunnel"] = "quadratic"
    body_drag_linear_n_per_mps: NonNegative3
    body_drag_quadratic_n_per_m2ps2: NonNegative3
    feet: Annotated[tuple[ContactSphere, ...], Field(min_length=3, max_length=16)]
    hull: Annotated[tuple[ContactSphere, ...], Field(max_length=32)] = ()
    forces: Annotated[tuple[AnyForce, ...], Field(max_length=64)] = ()
    battery: Battery | None = None
    cruise_mps: Annotated[float, Field(gt=1.0, le=150.0)] | None = None  # of a plane; null: 1.4 times its stall speed
    vibration: Vibration | None = None  # null: estimated from the size of the rotors, where a bench asks for it

    @pydantic.field_validator("rotors")
    @classmethod
    def _coaxial_pairs(cls, rotors: tuple[Rotor, ...]) -> tuple[Rotor, ...]:
        check_coaxial_pairs(rotors)
        return rotors

    @pydantic.field_validator("inertia_kgm2")
    @classmethod
    def _triangle_inequality(cls, inertia: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = inertia
        if not (x + y >= z and y + z >= x and z + x >= y):
            raise ValueError(f"{inertia}: no moment of inertia can be greater than the sum of the other two")
        return inertia

    @pydantic.model_validator(mode="after")
    def _body_is_possible(self) -> Vehicle:
        if any(self.inertia_products_kgm2):
            principal = np.linalg.eigvalsh(self.inertia_tensor_kgm2)
            if not (principal[0] > 0.0 and principal[0] + principal[1] >= principal[2]):
                raise ValueError(
                    f"inertia_products_kgm2 {list(self.inertia_products_kgm2)} with inertia_kgm2 "
                    f"{list(self.inertia_kgm2)}: the principal moments would be {np.round(principal, 6).tolist()}, and "
                    "none can be greater than the sum of the other two"
                )
        return self

    @pydantic.model_validator(mode="after")
    def _commands_fit(self) -> Vehicle:
        check_names(self.surfaces)
        if len(self.commands) > CONTROLS:
            raise ValueError(f"rotors and forces take {len(self.commands)} commands, and an autopilot has {CONTROLS}")
        return self

    @pydantic.model_validator(mode="after")
    def _physical(self) -> Vehicle:
        names = [sphere.name for sphere in self.contact_spheres]
        if len(set(names)) != len(names):
            raise ValueError(f"contact spheres must have different names, not {names}")
        for i, rotor in enumerate(self.rotors):
            if rotor.axis[2] < LEAST_UP and not self.has_wings:
                raise ValueError(
                    f"axis of rotor {i} does not point up: without wings (a force such as aero_table) a rotor may tilt "
                    "by up to 84 degrees from [0, 0, 1]"
                )
        if self.rotors and "rotor_constants" not in self.model_fields_set:
            raise ValueError("rotors need rotor_constants, the constants that they share")
        if self.rotor_model == "blade_element":
            if self.rotor_constants.blade_element is None:
                raise ValueError(
                    "rotor_model blade_element needs rotor_constants.blade_element, the lumps of the model"
                )
            lumps_of(self.rotor_constants, self.rotor_constants.blade_element)  # raises if they contradict each other
        if self.rotor_model == "wind_tunnel" and self.rotor_constants.wind_tunnel is None:
            raise ValueError("rotor_model wind_tunnel needs rotor_constants.wind_tunnel, the coefficients of the model")
        if self.rotors and self.rotor_constants.motor is not None:
            self._follow_the_motor()
        return self

    def _follow_the_motor(self) -> None:
        """Set the constants that follow from the motor, in the air for which the file holds: about hover, or cruise."""
        c, motor = self.rotor_constants, self.rotor_constants.motor
        assert motor is not None
        if self.battery is not None and self.battery.nominal_voltage_v != motor.nominal_voltage_v:
            raise ValueError(
                f"rotor_constants.motor.nominal_voltage_v is {motor.nominal_voltage_v:g} and "
                f"battery.nominal_voltage_v {self.battery.nominal_voltage_v:g}: they must be the same"
            )
        most_radps = steady_speed_radps(c, motor, 1.0)
        hover_radps = self.hover_speed_radps()
        usual_radps = min(hover_radps, most_radps) if math.isfinite(hover_radps) else _CRUISE_SHARE * most_radps
        factor = curve_factor(steady_duty(c, motor, usual_radps), (usual_radps / most_radps) ** 2)
        tau_s = min(1.0, max(1e-3, lag_s(c, motor, usual_radps)))
        follows = {
            "max_speed_radps": most_radps,
            "thrust_model_factor": factor,
            "time_constant_up_s": tau_s,
            "time_constant_down_s": tau_s,
        }
        object.__setattr__(self, "rotor_constants", c.model_copy(update=follows))

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

    def hover_speed_radps(self, density_ratio: float = 1.0) -> float:
        """Return the speed of all rotors at which the thrust aloft equals the standard weight; infinite if none lifts.

        `density_ratio`: density of the air over that of the vehicle's file.
        """
        lift = sum(share * rotor.axis[2] for share, rotor in zip(self.thrust_shares, self.rotors, strict=True))
        k = density_ratio * self.rotor_constants.thrust_coefficient_n_per_radps2
        if lift < LEAST_UP:
            return math.inf
        return math.sqrt(self.mass_kg * STANDARD_GRAVITY_MPS2 / (k * lift))

    @property
    def blades(self) -> BladeElement | WindTunnel | None:
        """Parameters of the rotor model; None for the quadratic one."""
        c = self.rotor_constants
        return {"blade_element": c.blade_element, "wind_tunnel": c.wind_tunnel, "quadratic": None}[self.rotor_model]

    def make_forces(self, effects: Effects) -> list[_kernels.Force]:
        """Return new forces for one body, in the order of their own states and commands."""
        drag = _kernels.AirDrag(
            linear_n_per_mps=self.body_drag_linear_n_per_mps, quadratic_n_per_m2ps2=self.body_drag_quadratic_n_per_m2ps2
        )
        rotors = [rotors_force(self.rotors, self.rotor_constants, effects, blades=self.blades)] if self.rotors else []
        return [drag, *rotors, *(force.make(effects) for force in self.forces)]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Commands of the vehicle in the order of an autopilot's controls: rotors, then those of `forces`."""
        rotors = [Command(f"rotor_{i}", signed=False) for i in range(len(self.rotors))]
        return (*rotors, *(command for force in self.forces for command in force.commands))

    @property
    def signed_commands(self) -> frozenset[int]:
        """Indices of the commands that are -1..1."""
        return frozenset(i for i, command in enumerate(self.commands) if command.signed)

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Control surfaces of all forces, in the order of their commands."""
        return tuple(surface for force in self.forces for surface in force.moved_surfaces)

    @property
    def inertia_tensor_kgm2(self) -> NDArray[np.float64]:
        """Tensor of inertia in B."""
        (x, y, z), (xy, xz, yz) = self.inertia_kgm2, self.inertia_products_kgm2
        return np.array([[x, -xy, -xz], [-xy, y, -yz], [-xz, -yz, z]])

    @property
    def has_wings(self) -> bool:
        """True if any force carries the vehicle by its speed through the air."""
        return any(force.is_wing for force in self.forces)

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
    def lying_height_m(self) -> float:
        """Height of the body origin over level ground when its lowest contact sphere just touches."""
        return max(sphere.radius_m - sphere.position_m[2] for sphere in self.contact_spheres)

    @property
    def standing_height_m(self) -> float:
        """Height of the body origin over level ground where the vehicle stands: on its wheels, or its lowest sphere."""
        weight_n = self.mass_kg * STANDARD_GRAVITY_MPS2
        carried = [height for force in self.forces if (height := force.standing_height_m(weight_n)) is not None]
        return max([self.lying_height_m, *carried])

    @property
    def standing_pitch_rad(self) -> float:
        """Pitch of the vehicle that stands on its wheels on level ground, nose up above 0; else 0."""
        weight_n = self.mass_kg * STANDARD_GRAVITY_MPS2
        carried = [force for force in self.forces if force.standing_height_m(weight_n) is not None]
        return carried[0].standing_pitch_rad(weight_n) if carried else 0.0

    @property
    def rolling_resistance(self) -> float:
        """Greatest rolling resistance over load of its wheels; 0 without wheels."""
        return max((force.rolling_resistance for force in self.forces), default=0.0)

    @property
    def rolls(self) -> bool:
        """True if a force carries the vehicle on the ground, such as wheels."""
        return any(force.standing_height_m(0.0) is not None for force in self.forces)


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
    forces: list[_kernels.Force],
    gravity_mps2: float,
    wind_W_mps: Vec3,
    steps: TickSteps,
    air: tuple[float, float] | None = None,
) -> _kernels.RigidBody:
    """Return the kernel for a vehicle; it works on the caller's `truth` [13 + own states of the forces + 6].

    `air`: altitude of the site and kelvins over the standard atmosphere; without it the density is that of sea level.
    """
    body = _kernels.RigidBody(
        truth=truth,
        mass_kg=vehicle.mass_kg,
        inertia_kgm2=vehicle.inertia_kgm2,
        inertia_products_kgm2=vehicle.inertia_products_kgm2,
        forces=forces,
        gravity_mps2=gravity_mps2,
        wind_W_mps=wind_W_mps,
        tick_s=steps.tick_s,
        substeps=steps.free,
        contact_substeps=steps.contact[False],
        hard_contact_substeps=steps.contact[True],
        classical=steps.classical,
    )
    if air is not None:
        body.set_air(*air)
    return body
