"""Scene and vehicle as an MJCF model for MuJoCo, which does the contact.

Only spheres, boxes and a plane, and no orientation in the model is given by angles: their collision functions and
compilation use no sin, cos or pow, whose last bit depends on the CPU. For the same reason solimp keeps its power
of 2. Contact softness follows the step:

* solref 3 steps, critically damped: a foot that lands at speed v sinks v * 3 steps / e at most (3.5 mm after a drop
  from 0.5 m at 1 ms); below two steps MuJoCo would clamp it.
* elliptic friction cones with impratio 10: friction is 10 times stiffer than the normal, so standing feet don't creep.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import mujoco

from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene

# Bits that pair vehicle with scene, and neither with itself.
_SCENE_BIT, _VEHICLE_BIT = 1, 2
_CONTACT_STEPS = 3.0  # time constant of a contact, in steps


def _numbers(values: Iterable[float]) -> str:
    """Shortest text that reads back to the same doubles."""
    return " ".join(repr(float(v)) for v in values)


def mjcf_text(scene: Scene, vehicle: Vehicle, *, contact_step_s: float) -> str:
    """MJCF of `scene` with `vehicle` as its only body, on a free joint."""
    root = ET.Element("mujoco", model=f"{scene.name}_{vehicle.name}")
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
        friction=_numbers((scene.ground_friction, 0.005, 0.0001)),
    )
    world = ET.SubElement(root, "worldbody")
    scene_bits = {"contype": str(_SCENE_BIT), "conaffinity": str(_VEHICLE_BIT)}
    ET.SubElement(world, "geom", {"name": "ground", "type": "plane", "size": "0 0 1"} | scene_bits)
    for box in scene.boxes:
        half = [0.5 * edge for edge in box.size_m]
        ET.SubElement(
            world,
            "geom",
            {"name": box.name, "type": "box", "pos": _numbers(box.center_m), "size": _numbers(half)} | scene_bits,
        )
    body = ET.SubElement(world, "body", name="vehicle")
    ET.SubElement(body, "freejoint", name="vehicle")
    ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(vehicle.mass_kg), diaginertia=_numbers(vehicle.inertia_kgm2))
    for sphere in vehicle.contact_spheres:
        ET.SubElement(
            body,
            "geom",
            name=f"vehicle_{sphere.name}",
            type="sphere",
            pos=_numbers(sphere.position_m),
            size=repr(sphere.radius_m),
            contype=str(_VEHICLE_BIT),
            conaffinity=str(_SCENE_BIT),
        )
    return ET.tostring(root, encoding="unicode")


def build_model(scene: Scene, vehicle: Vehicle, *, contact_step_s: float) -> mujoco.MjModel:
    """The compiled model: nq 7, nv 6."""
    return mujoco.MjModel.from_xml_string(mjcf_text(scene, vehicle, contact_step_s=contact_step_s))


def soften_contact(model: mujoco.MjModel, contact_step_s: float) -> None:
    """Set step and contact softness of a compiled model anew."""
    model.opt.timestep = contact_step_s
    model.geom_solref[:, 0] = _CONTACT_STEPS * contact_step_s
