"""Bodies of a run's vehicles in the world that cameras, LiDARs and radars see.

The shapes follow from the vehicle file; R is the radius of a rotor and `up` its axis:

* hull: an ellipsoid of 1 : 1 : 0.6 for each contact sphere of the hull that is not at a motor
* motors: cylinders from the hub of each rotor 0.25 R down, or up from the lower rotor of a coaxial pair; arms: rods
  from the hull to the ends of the motors
* feet: their contact spheres, each with a leg from the inner half of the nearest arm
* wings: the convex bodies of the forces that carry the vehicle (`WingParameters.solids`)
* rotors: two blades of 0.92 R each, 0.18 R wide and 0.02 R thick, pitched by 12 degrees, at the rotor's true angle

Blades are solid and stand still in a picture, as with a short exposure; between two pictures they may turn by any
angle. A LiDAR's pulse is short too: as many pulses pass the disc of a rotor as its blades leave free.

The bodies are visible only: vehicles touch each other in sim/physics, not in this world. Range finder and flow sensor
see the static scene alone (sim/sensors/ground_range.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import fmod, sqrt
from struct import pack

import numpy as np

from signals.rotation import NO_TURN, minus, norm, product
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S
from signals.units import TURN_RAD
from sim import _kernels
from sim.frame.source import VEHICLE_CLASS
from sim.physics.forces.rotors import Rotor
from sim.physics.forces.wing import Corners, WingParameters
from sim.physics.vehicle import ContactSphere, Vehicle
from sim.scene import surfaces
from sim.scene.compile.world_compiler import compile_map, read_only
from sim.scene.maps.map_builder import Body, MapBuilder, roll_quat, yaw_quat
from sim.scene.world import World

_HALF_TURN_RAD = 3.141592653589793
_PITCH_RAD = 0.21
_WING_RGB = (0.88, 0.88, 0.86)
_FRAME_RGB, _MOTOR_RGB, _FRONT_RGB, _REAR_RGB = (
    (0.10, 0.10, 0.11),
    (0.45, 0.45, 0.47),
    (0.95, 0.42, 0.08),
    (0.16, 0.16, 0.17),
)


class VehicleBodies(_kernels.PlacedVehicle):
    """`Actor` of one vehicle: its airframe, and a body for each rotor. Its states come from `place`."""

    def __init__(self, name: str, vehicle: Vehicle) -> None:
        self.name = f"{VEHICLE_CLASS}:{name}"
        self.bodies = (f"{self.name}_frame", *(f"{self.name}_rotor_{i}" for i in range(len(vehicle.rotors))))
        self.max_speed_mps = float("inf")  # given from outside
        rotors = vehicle.rotors
        self._spin = [rotor.spin.sign for rotor in rotors]
        blade_m = vehicle.most_radius_m
        super().__init__(
            p_BR=[rotor.position_m for rotor in rotors],
            q_BR=[_onto(rotor.axis) for rotor in rotors],
            spin=self._spin,
            radius_m=max(
                vehicle.bounding_radius_m,
                *(norm(corner) for corners in _wing_solids(vehicle) for corner in corners),
                *(norm(rotor.position_m) + 1.02 * blade_m for rotor in rotors),
            ),
        )

    def place(self, truth: TruthState) -> None:
        """Add the state of a tick."""
        self.place_at(truth.t_ns, truth.p_WB, truth.q_WB, truth.v_WB_W, truth.w_WB_B, truth.rotor_speed_radps)

    def place_alone(self, truth: TruthState) -> None:
        """Replace all states by that of a tick. The angle of a rotor is its speed times the time."""
        speeds, t_s = truth.rotor_speed_radps, truth.t_ns / NS_PER_S
        angles = [fmod(spin * speed * t_s, TURN_RAD) for spin, speed in zip(self._spin, speeds, strict=True)]
        numbers = (*truth.p_WB, *truth.q_WB, *truth.v_WB_W, *truth.w_WB_B, *speeds, *angles)
        self.restore(pack(f"=q{len(numbers)}d", truth.t_ns, *numbers))


def with_vehicles(base: World, vehicles: Mapping[str, Vehicle]) -> World:
    """Return the world with these vehicles as actors at its end, so that everything in `base` keeps its numbers.

    Raises ConfigError if the world then has more instances or surfaces than an id can hold.
    """
    if not vehicles:
        return base
    builder = MapBuilder("vehicles")
    for name, vehicle in vehicles.items():
        _add(builder, VehicleBodies(name, vehicle), vehicle)
    class_colours = dict(zip(base.class_names, base.class_colours, strict=True))
    world = compile_map(base.scene, builder.added_to(base.map), class_colours)
    is_added = np.arange(world.model.ngeom) >= base.model.ngeom
    # The map's own patterns for classes may match the names of vehicles too.
    geom_class = np.full(world.model.ngeom, base.class_names.index(VEHICLE_CLASS), np.uint8)
    geom_class[~is_added] = base.geom_class
    return replace(
        world, geom_class=read_only(geom_class), added_people=base.added_people, added_objects=base.added_objects
    )


def _add(builder: MapBuilder, actor: VehicleBodies, vehicle: Vehicle) -> None:
    frame = builder.material("drone:frame", surfaces.CARBON_FIBRE, rgb=_FRAME_RGB)
    metal = builder.material("drone:motor", surfaces.METAL, rgb=_MOTOR_RGB)
    rotors, radii_m = vehicle.rotors, [c.radius_m for c in vehicle.constants_of_rotors]
    hull = [sphere for sphere in vehicle.hull if not _is_motor(sphere, rotors)]
    centre: Vec3 = hull[0].position_m if hull else (0.0, 0.0, 0.0)
    body, *blades = builder.actor(actor, at_origin=True)
    for sphere in hull:
        r = sphere.radius_m
        body.geom("ellipsoid", (r, r, 0.6 * r), material=frame, pos=sphere.position_m, solid=False)
    wings = _wing_solids(vehicle)
    if wings:
        foam = builder.material("drone:wing", surfaces.PLASTIC, rgb=_WING_RGB)
        for i, corners in enumerate(wings):
            mesh = builder.hull(f"{actor.name}_wing_{i}", np.array(corners))
            body.geom("mesh", asset=mesh, material=foam, solid=False)
    arm_ends: list[Vec3] = []
    for rotor, R_m in zip(rotors, radii_m, strict=True):
        motor_m = -0.125 * R_m if rotor.coaxial_below is None else 0.125 * R_m  # of its middle, along the axis
        middle = _along(rotor.position_m, rotor.axis, motor_m)
        body.geom(
            "cylinder", (0.11 * R_m, 0.125 * R_m), material=metal, pos=middle, quat=_onto(rotor.axis), solid=False
        )
        if rotor.coaxial_below is None:
            arm_ends.append(_along(rotor.position_m, rotor.axis, 2.0 * motor_m))
            body.rod(0.07 * R_m, (*centre, *arm_ends[-1]), material=frame, solid=False)
    for foot in vehicle.feet:
        hips = (_hip(foot.position_m, centre, end) for end in arm_ends)
        hip = min(hips, key=lambda p: norm(minus(p, foot.position_m)))
        body.geom("sphere", (foot.radius_m,), material=frame, pos=foot.position_m, solid=False)
        if norm(minus(hip, foot.position_m)) > 1e-3:
            body.rod(0.045 * vehicle.most_radius_m, (*hip, *foot.position_m), material=frame, solid=False)
    for rotor_body, rotor, R_m in zip(blades, rotors, radii_m, strict=True):
        ahead = rotor.position_m[0] > centre[0]
        blade = builder.material(
            "drone:blade_front" if ahead else "drone:blade_rear",
            surfaces.PROPELLER,
            rgb=_FRONT_RGB if ahead else _REAR_RGB,
        )
        _add_blades(rotor_body, blade, R_m, rotor.spin.sign)


def _add_blades(body: Body, material: str, R_m: float, spin: float) -> None:
    """Add two blades along +x and -x of a rotor. The edge that leads is the higher one."""
    for turn in (NO_TURN, yaw_quat(_HALF_TURN_RAD)):
        side = 1.0 if turn == NO_TURN else -1.0
        body.geom(
            "box",
            (0.46 * R_m, 0.09 * R_m, 0.01 * R_m),
            material=material,
            pos=(side * 0.54 * R_m, 0.0, 0.0),
            quat=product(turn, roll_quat(spin * _PITCH_RAD)),
            solid=False,
        )


def _wing_solids(vehicle: Vehicle) -> list[Corners]:
    hull = [(sphere.position_m, sphere.radius_m) for sphere in vehicle.hull]
    wings = [force for force in vehicle.forces if isinstance(force, WingParameters)]
    return [corners for wing in wings for corners in wing.solids(hull)]


def _is_motor(sphere: ContactSphere, rotors: tuple[Rotor, ...]) -> bool:
    return any(norm(minus(sphere.position_m, rotor.position_m)) < 1.5 * sphere.radius_m for rotor in rotors)


def _onto(axis: Vec3) -> Quat:
    """Return the shortest rotation that turns z onto a unit vector that points up."""
    x, y, z = axis
    size = sqrt(2.0 * (1.0 + z))  # of (1 + z, -y, x, 0)
    return ((1.0 + z) / size, -y / size, x / size, 0.0)


def _along(p: Vec3, axis: Vec3, distance_m: float) -> Vec3:
    x, y, z = axis
    return (p[0] + distance_m * x, p[1] + distance_m * y, p[2] + distance_m * z)


def _hip(p: Vec3, start: Vec3, end: Vec3) -> Vec3:
    """Return the point of the arm's inner half that is nearest to p, seen from above."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length2 = dx * dx + dy * dy
    share = ((p[0] - start[0]) * dx + (p[1] - start[1]) * dy) / length2 if length2 > 0.0 else 0.0
    share = min(0.5, max(0.0, share))
    return (start[0] + share * dx, start[1] + share * dy, start[2] + share * (end[2] - start[2]))
