"""The vehicle as URDF, for `/robot_description`: its body, its rotors, and the mounts of its sensors.

Frames are those of `/tf_static`. Lengths in metres, angles as roll, pitch, yaw about fixed axes; base_link is FLU.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import asin, atan2
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.mcap.topics import BODY
from signals.samples import Quat, Vec3
from sim.physics.vehicle import Vehicle

_ROTOR_M = 0.01  # drawn thickness


def robot_description(
    vehicle: Vehicle, descriptions: Mapping[str, FrameDescription], frame: Callable[[str], str]
) -> str:
    """Return the URDF. `descriptions`: of the sensors that have a mount. `frame`: name of a frame in the messages."""
    robot = Element("robot", name=vehicle.name)
    body = SubElement(robot, "link", name=frame(BODY))
    inertial = SubElement(body, "inertial")
    SubElement(inertial, "mass", value=_text(vehicle.mass_kg))
    x, y, z = (_text(value) for value in vehicle.inertia_kgm2)
    SubElement(inertial, "inertia", ixx=x, iyy=y, izz=z, ixy="0", ixz="0", iyz="0")
    for sphere in vehicle.contact_spheres:
        for kind in ("visual", "collision"):
            shape = _shape(body, kind, sphere.position_m)
            SubElement(shape, "sphere", radius=_text(sphere.radius_m))
    for rotor, constants in zip(vehicle.rotors, vehicle.constants_of_rotors, strict=True):
        shape = _shape(body, "visual", rotor.position_m)
        SubElement(shape, "cylinder", radius=_text(constants.radius_m), length=_text(_ROTOR_M))
    for description in descriptions.values():
        name = frame(description.frame_id)
        SubElement(robot, "link", name=name)
        joint = SubElement(robot, "joint", name=f"{name}_mount", type="fixed")
        SubElement(joint, "parent", link=frame(BODY))
        SubElement(joint, "child", link=name)
        SubElement(joint, "origin", xyz=_text(*description.p_BC), rpy=_text(*roll_pitch_yaw(description.q_BC)))
    indent(robot)
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode") + "\n"


def roll_pitch_yaw(q: Quat) -> Vec3:
    """Return the angles of a rotation w-x-y-z about the fixed axes x, y, z, in this order [rad]."""
    w, x, y, z = q
    sine = 2.0 * (w * y - z * x)
    if abs(sine) > 1.0 - 1e-12:  # roll and yaw turn about one axis: all of it is yaw
        side = 1.0 if sine > 0.0 else -1.0
        return (0.0, side * asin(1.0), -2.0 * side * atan2(x, w))
    return (
        atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        asin(sine),
        atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def _shape(link: Element, kind: str, p_B: Vec3) -> Element:
    part = SubElement(link, kind)
    SubElement(part, "origin", xyz=_text(*p_B), rpy="0 0 0")
    return SubElement(part, "geometry")


def _text(*numbers: float) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
