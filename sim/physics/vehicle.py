"""A vehicle as its file in rigs/vehicles describes it: a rigid body, what acts on it, and what can touch the scene.

All vectors are in B (FLU, origin at the centre of mass), SI units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel, load_model
from signals.rotation import cos_nose_up_of, cos_tilt_of
from signals.samples import Quat, Vec3
from signals.units import STANDARD_GRAVITY_MPS2
from sim import _kernels
from sim.physics.battery import Battery
from sim.physics.forces.blade_element import lumps_of
from sim.physics.forces.force import Command, Effects, ForceParameters, Point, any_kind
from sim.physics.forces.motor import curve_factor, lag_s, steady_duty, steady_speed_radps
from sim.physics.forces.rotors import (
    LEAST_UP,
    Rotor,
    RotorConstants,
    RotorGroup,
    RotorModel,
    RotorSet,
    check_coaxial_pairs,
    check_sets,
    no_rotors,
    rotor_groups,
)
from sim.physics.forces.surface import Surface, check_names
from sim.physics.forces.tilt import Tilt, check_tilts, tilts_force
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
    # Coefficient of friction on any ground; null, or less than the scene's ground_friction: the scene's.
    friction: Annotated[float, Field(gt=0.0, le=5.0)] | None = None

    def friction_on(self, ground: float) -> float:
        """Return the coefficient of friction on a ground of this coefficient."""
        return ground if self.friction is None else max(ground, self.friction)


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
    rotor_model: RotorModel = "quadratic"
    # Other propellers, motors or models: a rotor names its set, and without one it has the two keys above.
    rotor_sets: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")], RotorSet] = Field(default_factory=dict)
    tilts: Annotated[tuple[Tilt, ...], Field(max_length=8)] = ()  # servos that turn rotors
    # How it stands on the ground and hovers: with the body's z up, or as a tailsitter with x up.
    stands: Literal["on_feet", "on_tail"] = "on_feet"
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

    def __hash__(self) -> int:  # pydantic's own takes no dict, as `rotor_sets` is
        values = (tuple(v.items()) if isinstance(v, dict) else v for v in self.__dict__.values())
        return hash((type(self), *values))

    @pydantic.model_validator(mode="after")
    def _commands_fit(self) -> Vehicle:
        check_names(self.servos)
        if len(self.commands) > CONTROLS:
            raise ValueError(
                f"rotors, tilts and forces take {len(self.commands)} commands, and an autopilot has {CONTROLS}"
            )
        return self

    @pydantic.model_validator(mode="after")
    def _physical(self) -> Vehicle:
        names = [sphere.name for sphere in self.contact_spheres]
        if len(set(names)) != len(names):
            raise ValueError(f"contact spheres must have different names, not {names}")
        for i, rotor in enumerate(self.rotors):
            if self.upward(rotor.axis) < LEAST_UP and not self.has_wings:
                raise ValueError(
                    f"axis of rotor {i} does not point up: without wings (a force such as aero_table) a rotor may tilt "
                    "by up to 84 degrees from [0, 0, 1]"
                )
        check_sets(self.rotors, self.rotor_sets)
        check_tilts(self.tilts, self.rotors)
        if any(rotor.set is None for rotor in self.rotors) and "rotor_constants" not in self.model_fields_set:
            raise ValueError("rotors need rotor_constants, the constants that they share")
        for group in self.rotor_groups:
            self._check_model(group)
        delays_s = [group.constants.dead_time_s for group in self.rotor_groups]
        if [delay > 0.0 for delay, _ in itertools.groupby(delays_s)].count(True) > 1:
            raise ValueError(
                f"dead_time_s of the sets of rotors is {', '.join(f'{delay:g}' for delay in delays_s)}: sets that have "
                "one must have the same, and follow each other"
            )
        if any(group.constants.motor is not None for group in self.rotor_groups):
            self._follow_the_motors()
        return self

    def _check_model(self, group: RotorGroup) -> None:
        c, of = group.constants, group.key.removesuffix("rotor_constants")
        if group.model == "blade_element":
            if c.blade_element is None:
                raise ValueError(f"{of}rotor_model blade_element needs {group.key}.blade_element, lumps of the model")
            lumps_of(c, c.blade_element)  # raises if they contradict each other
        if group.model == "wind_tunnel" and c.wind_tunnel is None:
            raise ValueError(
                f"{of}rotor_model wind_tunnel needs {group.key}.wind_tunnel, the coefficients of the model"
            )

    def _follow_the_motors(self) -> None:
        """Set the constants that follow from motors, in the air for which the file holds: about hover, or cruise."""
        most = {}
        for group in self.rotor_groups:
            motor = group.constants.motor
            if motor is None:
                continue
            if self.battery is not None and self.battery.nominal_voltage_v != motor.nominal_voltage_v:
                raise ValueError(
                    f"{group.key}.motor.nominal_voltage_v is {motor.nominal_voltage_v:g} and "
                    f"battery.nominal_voltage_v {self.battery.nominal_voltage_v:g}: they must be the same"
                )
            most[group.first] = steady_speed_radps(group.constants, motor, 1.0)
            self._replace_constants(group, {"max_speed_radps": most[group.first]})
        for group in self.rotor_groups:
            c, motor = group.constants, group.constants.motor
            if motor is None:
                continue
            most_radps = most[group.first]
            hover_radps = self.hover_speeds_radps()[group.first]
            usual_radps = min(hover_radps, most_radps) if math.isfinite(hover_radps) else _CRUISE_SHARE * most_radps
            factor = curve_factor(steady_duty(c, motor, usual_radps), (usual_radps / most_radps) ** 2)
            tau_s = min(1.0, max(1e-3, lag_s(c, motor, usual_radps)))
            self._replace_constants(
                group, {"thrust_model_factor": factor, "time_constant_up_s": tau_s, "time_constant_down_s": tau_s}
            )

    def _replace_constants(self, group: RotorGroup, update: dict[str, float]) -> None:
        constants = group.constants.model_copy(update=update)
        name = group.rotors[0].set
        if name is None:
            object.__setattr__(self, "rotor_constants", constants)
        else:
            of = self.rotor_sets[name].model_copy(update={"rotor_constants": constants})
            object.__setattr__(self, "rotor_sets", self.rotor_sets | {name: of})

    @property
    def rotor_groups(self) -> tuple[RotorGroup, ...]:
        """Rotors by their constants, in their order: each group is one force of the body."""
        return rotor_groups(self.rotors, self.rotor_model, self.rotor_constants, self.rotor_sets, self.up_axis)

    @property
    def leading_group(self) -> RotorGroup | None:
        """Group of the vehicle's first rotors that lift, else its first; None without rotors."""
        groups = self.rotor_groups
        return next((group for group in groups if group.lift >= LEAST_UP), groups[0] if groups else None)

    @property
    def constants_of_rotors(self) -> tuple[RotorConstants, ...]:
        """Constants of each rotor."""
        return tuple(group.constants for group in self.rotor_groups for _ in group.rotors)

    @property
    def thrust_shares(self) -> tuple[float, ...]:
        """Thrust of each rotor over that of a rotor alone; see `RotorGroup.thrust_shares`."""
        return tuple(share for group in self.rotor_groups for share in group.thrust_shares)

    @property
    def most_radius_m(self) -> float:
        """Radius of the largest rotor; that of `rotor_constants` without rotors."""
        return max((c.radius_m for c in self.constants_of_rotors), default=self.rotor_constants.radius_m)

    def hover_speeds_radps(self, density_ratio: float = 1.0) -> tuple[float, ...]:
        """Return the speed of each rotor at which the thrust aloft equals the standard weight.

        Sets that lift have the same share of their full speed; a rotor of another set, infinity. `density_ratio`:
        density of the air over that of the vehicle's file.
        """
        groups = self.rotor_groups
        lifting = [group for group in groups if group.lift >= LEAST_UP]
        weight_n = self.mass_kg * STANDARD_GRAVITY_MPS2
        full_n = sum(
            density_ratio * g.constants.thrust_coefficient_n_per_radps2 * g.lift * g.constants.max_speed_radps**2
            for g in lifting
        )

        def speed(group: RotorGroup) -> float:
            if group not in lifting:
                return math.inf
            k = density_ratio * group.constants.thrust_coefficient_n_per_radps2
            if len(lifting) == 1:
                return math.sqrt(weight_n / (k * group.lift))
            return group.constants.max_speed_radps * math.sqrt(weight_n / full_n)

        return tuple(speed(group) for group in groups for _ in group.rotors)

    def make_forces(self, effects: Effects) -> list[_kernels.Force]:
        """Return new forces for one body, in the order of their own states and commands."""
        drag = _kernels.AirDrag(
            linear_n_per_mps=self.body_drag_linear_n_per_mps, quadratic_n_per_m2ps2=self.body_drag_quadratic_n_per_m2ps2
        )
        groups = self.rotor_groups
        rotors = [group.force(effects) for group in groups]
        tilts = [tilts_force(self.tilts, self.rotors, groups, rotors)] if self.tilts else []
        return [drag, *rotors, *tilts, *(force.make(effects) for force in self.forces)]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Commands of the vehicle in the order of an autopilot's controls: rotors, tilts, then those of `forces`."""
        rotors = [Command(f"rotor_{i}", signed=False) for i in range(len(self.rotors))]
        tilts = [Command(tilt.name, signed=True) for tilt in self.tilts]
        return (*rotors, *tilts, *(command for force in self.forces for command in force.commands))

    @property
    def signed_commands(self) -> frozenset[int]:
        """Indices of the commands that are -1..1."""
        return frozenset(i for i, command in enumerate(self.commands) if command.signed)

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Control surfaces of all forces, in the order of their commands."""
        return tuple(surface for force in self.forces for surface in force.moved_surfaces)

    @property
    def servos(self) -> tuple[Tilt | Surface, ...]:
        """All that a servo moves, in the order of the commands: tilts, then control surfaces."""
        return (*self.tilts, *self.surfaces)

    @property
    def rest_commands(self) -> tuple[float, ...]:
        """Commands at which rotors stop, tilts are where they hover, and surfaces are neutral."""
        return tuple(self._commands(0.0, [tilt.hover_command for tilt in self.tilts]))

    @property
    def ahead_commands(self) -> tuple[float, ...]:
        """The same with each tilt where its rotors point most ahead."""
        return tuple(self._commands(0.0, [tilt.command_of(tilt.ahead_rad(self.rotors)) for tilt in self.tilts]))

    def _commands(self, rotors: float, tilts: Sequence[float]) -> list[float]:
        commands = [rotors] * len(self.rotors) + list(tilts)
        return commands + [0.0] * (len(self.commands) - len(commands))

    @property
    def rotors_ahead(self) -> tuple[Rotor, ...]:
        """Rotors as they are in forward flight: those on a tilt where they point most ahead."""
        rotors = list(self.rotors)
        for tilt in self.tilts:
            angle_rad = tilt.ahead_rad(self.rotors)
            for i in tilt.rotors:
                rotors[i] = tilt.turned(rotors[i], angle_rad)
        return tuple(rotors)

    @property
    def up_axis(self) -> Vec3:
        """Direction in B that points up where the vehicle stands and hovers."""
        return (1.0, 0.0, 0.0) if self.stands == "on_tail" else (0.0, 0.0, 1.0)

    def upward(self, v_B: Vec3) -> float:
        """Return the part of a vector along `up_axis`."""
        return v_B[0] if self.stands == "on_tail" else v_B[2]

    @property
    def cos_tilt(self) -> Callable[[Quat], float]:
        """Function from q_WB to the cosine of the angle between `up_axis` and the vertical."""
        return cos_nose_up_of if self.stands == "on_tail" else cos_tilt_of

    def standing_quat(self, yaw_rad: float) -> Quat:
        """Return q_WB where it stands with a heading; a tailsitter's is that with its nose lowered to the horizon."""
        c, s = det_cos(0.5 * yaw_rad), det_sin(0.5 * yaw_rad)
        if self.stands == "on_feet":
            return (c, 0.0, 0.0, s)
        half = math.sqrt(0.5)  # then by 90 degrees about -y
        return (half * c, half * s, -half * c, half * s)

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
        return max(sphere.radius_m - self.upward(sphere.position_m) for sphere in self.contact_spheres)

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
