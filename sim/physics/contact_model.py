"""MJCF model of scene and vehicle, with which MuJoCo computes contact.

The model holds each vehicle on a free joint, the solid geoms of the scene on the worldbody, and the solid geoms of
actors on mocap bodies. Geoms that are only visible are left out. Collision bits pair a vehicle with the scene and with
other vehicles, and neither with itself. Other vehicles, unlike the scene, also meet its rotors, as rigid flat discs,
and its arms and legs: rods from the body's origin to each contact sphere, half as thick as the sphere.

No orientation in the model is given by angles, and no collision of spheres with primitives, convex hulls or height
fields calls sin, cos or pow, whose last bit depends on the CPU. For the same reason solimp has a power of 2. Meshes
collide as their convex hulls. Contact softness follows the step:

* solref 3 steps, critically damped: a foot that lands at speed v sinks at most v * 3 steps / e (3.5 mm after a drop
  from 0.5 m at 1 ms); below two steps MuJoCo would clamp it.
* elliptic friction cones with impratio 10: friction is 10 times stiffer than the normal, so standing feet do not creep.
"""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections import OrderedDict
from collections.abc import Iterable

import mujoco
import numpy as np

from signals.errors import ConfigError
from signals.samples import Vec3
from sim.physics.vehicle import Vehicle
from sim.scene.budget import Budget
from sim.scene.compile_process import compile_mjcf
from sim.scene.scene import Scene
from sim.scene.solids import solid_geoms
from sim.scene.world import VEHICLE, World
from sim.world_loader import load_world

# Collision bits; geoms collide if the type of one meets the affinity of the other. A body never collides with itself.
_SCENE_BIT, _VEHICLE_BIT, _OTHER_VEHICLE_BIT = 1, 2, 4
ROTOR_HALF_THICKNESS_M = 0.005
_SPIN_AND_ROLL = 0.005, 0.0001  # friction against spin and roll, which condim 3 leaves out
_CONTACT_STEPS = 3.0  # time constant of a contact, in steps


def _numbers(values: Iterable[float]) -> str:
    """Return the shortest text that reads back to the same doubles."""
    return " ".join(repr(float(v)) for v in values)


def mjcf_text(scene: Scene, *vehicles: Vehicle, contact_step_s: float) -> str:
    """Return MJCF of the solid part of `scene` with each vehicle on a free joint. Geoms of a map have no names.

    Body `i` + 1 and joint `i` are those of vehicle `i`.
    """
    root = ET.Element("mujoco", model="_".join([scene.name, *(vehicle.name for vehicle in vehicles)]))
    ET.SubElement(root, "compiler", autolimits="true", balanceinertia="false")
    ET.SubElement(
        root,
        "option",
        timestep=repr(contact_step_s),
        gravity=_numbers((0.0, 0.0, -scene.gravity_mps2)),
        cone="elliptic",
        impratio="10",
        iterations="50",
        tolerance="1e-12",
    )
    default = ET.SubElement(root, "default")
    ET.SubElement(
        default,
        "geom",
        solref=_numbers((_CONTACT_STEPS * contact_step_s, 1.0)),
        solimp="0.9 0.99 0.001 0.5 2",
        condim="3",
        friction=_numbers((scene.ground_friction, *_SPIN_AND_ROLL)),
    )
    world = ET.SubElement(root, "worldbody")
    scene_bits = {"contype": str(_SCENE_BIT), "conaffinity": str(_VEHICLE_BIT)}
    if scene.has_only_boxes:
        ET.SubElement(world, "geom", {"name": "ground", "type": "plane", "size": "0 0 1"} | scene_bits)
        for box in scene.boxes:
            half = [0.5 * edge for edge in box.size_m]
            ET.SubElement(
                world,
                "geom",
                {"name": box.name, "type": "box", "pos": _numbers(box.center_m), "size": _numbers(half)} | scene_bits,
            )
    if len(vehicles) == 1:
        _add_vehicle(world, vehicles[0], VEHICLE)
    else:
        for index, vehicle in enumerate(vehicles):
            _add_rotors_and_rods(_add_vehicle(world, vehicle, f"{VEHICLE}_{index}", others=_OTHER_VEHICLE_BIT), vehicle)
    if not scene.has_only_boxes:
        _add_map(root, world, load_world(scene), scene_bits)
    return ET.tostring(root, encoding="unicode")


def _add_vehicle(worldbody: ET.Element, vehicle: Vehicle, name: str, *, others: int = 0) -> ET.Element:
    body = ET.SubElement(worldbody, "body", name=name)
    ET.SubElement(body, "freejoint", name=name)
    inertia = {"diaginertia": _numbers(vehicle.inertia_kgm2)}
    if any(vehicle.inertia_products_kgm2):
        products = [-product for product in vehicle.inertia_products_kgm2]
        inertia = {"fullinertia": _numbers((*vehicle.inertia_kgm2, *products))}
    ET.SubElement(body, "inertial", {"pos": "0 0 0", "mass": repr(vehicle.mass_kg)} | inertia)
    for sphere in vehicle.contact_spheres:
        grips = {} if sphere.friction is None else {"friction": _numbers((sphere.friction, *_SPIN_AND_ROLL))}
        ET.SubElement(
            body,
            "geom",
            grips,
            name=f"{name}_{sphere.name}",
            type="sphere",
            pos=_numbers(sphere.position_m),
            size=repr(sphere.radius_m),
            contype=str(_VEHICLE_BIT | others),
            conaffinity=str(_SCENE_BIT | others),
        )
    return body


def _add_rotors_and_rods(body: ET.Element, vehicle: Vehicle) -> None:
    """Add the geoms that meet only other vehicles."""
    bits = {"contype": str(_OTHER_VEHICLE_BIT), "conaffinity": str(_OTHER_VEHICLE_BIT)}
    for rotor, constants in zip(vehicle.rotors, vehicle.constants_of_rotors, strict=True):
        disc = _numbers((constants.radius_m, ROTOR_HALF_THICKNESS_M))
        pose = {"pos": _numbers(rotor.position_m), "quat": _turned_up(rotor.axis)}
        ET.SubElement(body, "geom", {"type": "cylinder", "size": disc} | pose | bits)
    for sphere in vehicle.contact_spheres:
        x, y, z = sphere.position_m
        length = math.sqrt(x * x + y * y + z * z)
        if length <= sphere.radius_m:
            continue
        rod = {
            "type": "capsule",
            "pos": _numbers((0.5 * x, 0.5 * y, 0.5 * z)),
            "quat": _turned_up((x / length, y / length, z / length)),
            "size": _numbers((0.5 * sphere.radius_m, 0.5 * length)),
        }
        ET.SubElement(body, "geom", rod | bits)


def _turned_up(direction: Vec3) -> str:
    """Return the quaternion that turns a geom's z axis into a unit vector by the shortest way."""
    x, y, z = direction
    return _numbers((1.0 + z, -y, x, 0.0) if z > -0.999999 else (0.0, 1.0, 0.0, 0.0))


def _add_map(root: ET.Element, worldbody: ET.Element, world: World, bits: dict[str, str]) -> None:
    """Add the solid geoms of a map in the order of `solid_geoms`: static ones first."""
    model, solids = world.model, solid_geoms(world)
    asset = ET.SubElement(root, "asset")
    kind_names = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind for kind in _KINDS}
    used: set[str] = set()
    bodies: dict[int, ET.Element] = {0: worldbody}
    for geom, body, position, quaternion in zip(
        solids.geom.tolist(), solids.body.tolist(), solids.position, solids.quaternion, strict=True
    ):
        if body not in bodies:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
            bodies[body] = ET.SubElement(worldbody, "body", name=name, mocap="true")
        kind = kind_names[int(model.geom_type[geom])]
        attributes = {"type": kind, "pos": _numbers(position), "quat": _numbers(quaternion)} | bits
        if kind in ("mesh", "hfield"):
            attributes[kind] = f"{kind}_{model.geom_dataid[geom]}"
            if attributes[kind] not in used:
                used.add(attributes[kind])
                (_add_mesh if kind == "mesh" else _add_hfield)(asset, model, geom, attributes[kind])
        else:
            attributes["size"] = _numbers(model.geom_size[geom]) if kind != "plane" else "0 0 1"
        ET.SubElement(bodies[body], "geom", attributes)


_KINDS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")


def _add_mesh(asset: ET.Element, model: mujoco.MjModel, geom: int, name: str) -> None:
    """Add the corners of the mesh's convex hull."""
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    corners = model.mesh_vert[first : first + count]
    graph = int(model.mesh_graphadr[mesh])
    if graph >= 0:
        # The graph holds the counts of corners and faces, the starts of the edge lists, and the corners' vertices.
        hull_corners = int(model.mesh_graph[graph])
        corners = corners[model.mesh_graph[graph + 2 + hull_corners : graph + 2 + 2 * hull_corners]]
    ET.SubElement(asset, "mesh", name=name, inertia="shell", vertex=_numbers(corners.astype(np.float64).ravel()))


def _add_hfield(asset: ET.Element, model: mujoco.MjModel, geom: int, name: str) -> None:
    """Add a height field; `build_model` fills in the heights."""
    field = int(model.geom_dataid[geom])
    ET.SubElement(
        asset,
        "hfield",
        name=name,
        nrow=str(model.hfield_nrow[field]),
        ncol=str(model.hfield_ncol[field]),
        size=_numbers(model.hfield_size[field]),
    )


_MAX_CACHED = 4  # contact models of maps; one takes up to a second to compile
_models: OrderedDict[tuple[int, str, float], tuple[World, mujoco.MjModel]] = OrderedDict()


def build_model(scene: Scene, *vehicles: Vehicle, contact_step_s: float) -> mujoco.MjModel:
    """Return a compiled model that belongs to the caller: nq 7, nv 6 for each vehicle.

    Raises ConfigError if a user's map cannot be compiled, or not within its limits.
    """
    if scene.has_only_boxes:
        return compile_mjcf(mjcf_text(scene, *vehicles, contact_step_s=contact_step_s), {})
    world = load_world(scene)
    types = " ".join(vehicle.model_dump_json() for vehicle in vehicles)
    parameters = f"{scene.gravity_mps2!r} {scene.ground_friction!r} {types}"
    key = (id(world.model), parameters, contact_step_s)
    if key not in _models:
        text = mjcf_text(scene, *vehicles, contact_step_s=contact_step_s)
        where = scene.file.document.where(("map",))
        try:
            model = compile_mjcf(text, {}, Budget(where) if world.map.from_file else None)
        except ValueError as error:
            message = f"has no model of contact that MuJoCo can compile: {' '.join(str(error).split())}"
            raise ConfigError.at(where, message) from None
        for field in range(model.nhfield):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_HFIELD, field)
            source = int(name.removeprefix("hfield_"))
            start, count = int(model.hfield_adr[field]), int(model.hfield_nrow[field] * model.hfield_ncol[field])
            source_start = int(world.model.hfield_adr[source])
            model.hfield_data[start : start + count] = world.model.hfield_data[source_start : source_start + count]
        _models[key] = (world, model)  # keeps the world alive, because the id of its model is part of the key
        while len(_models) > _MAX_CACHED:
            _models.popitem(last=False)
    return copy.copy(_models[key][1])


def soften_contact(model: mujoco.MjModel, contact_step_s: float) -> None:
    """Set step and contact softness of a compiled model."""
    model.opt.timestep = contact_step_s
    model.geom_solref[:, 0] = _CONTACT_STEPS * contact_step_s


def set_inertia(model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle) -> None:
    """Set mass and inertia of the only vehicle of a compiled model. `data` loses its state."""
    model.body_mass[1], model.body_inertia[1] = vehicle.mass_kg, vehicle.inertia_kgm2
    model.body_iquat[1] = (1.0, 0.0, 0.0, 0.0)
    if any(vehicle.inertia_products_kgm2):
        moments, axes = np.linalg.eigh(vehicle.inertia_tensor_kgm2)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        model.body_inertia[1] = moments
        mujoco.mju_mat2Quat(model.body_iquat[1], axes.ravel())
    mujoco.mj_setConst(model, data)
