"""Contact of a vehicle with the scene: the place, the normal and the geom that it touches."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from signals.samples import Vec3
from sim.scene.scene import Scene
from sim.scene.solids import solid_geoms
from sim.world_loader import load_world

_VEHICLE_BODY = 1  # of the contact model of one vehicle


class SceneContact(NamedTuple):
    """Contact of a vehicle with a geom of the scene."""

    geom: int  # its id in the scene's model
    name: str  # of the object that the geom belongs to
    point_W: Vec3
    normal_W: Vec3  # away from the scene
    depth_m: float


def deepest_contact(model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> SceneContact | None:
    """Return the deepest contact in `data`, of the contact model of one vehicle in `scene`; None without contact."""
    if not data.ncon:
        return None
    contact = data.contact[int(np.argmin(data.contact.dist))]
    a, b = (int(geom) for geom in contact.geom)
    of_vehicle = model.geom_bodyid == _VEHICLE_BODY
    vehicle_is_second = bool(of_vehicle[b])
    # The normal points from the first geom to the second.
    x, y, z = contact.frame[:3].tolist()
    normal = (x, y, z) if vehicle_is_second else (-x, -y, -z)
    touched = a if vehicle_is_second else b
    # The contact model holds the static solid geoms, then the vehicle's, then those of each actor's body.
    row = touched - int(np.count_nonzero(of_vehicle[:touched]))
    world = load_world(scene)
    solids = solid_geoms(world)
    geom = int(solids.geom[np.argsort(solids.body, kind="stable")[row]])
    name = world.instance_names[world.geom_instance[geom]]
    px, py, pz = contact.pos.tolist()
    return SceneContact(geom, name, (px, py, pz), normal, max(0.0, -float(contact.dist)))
