"""One object of the scene, and all objects that a world begins with.

The frame of an object is front, left, up, as a vehicle's: an object with the orientation (1, 0, 0, 0) of AirSim looks
north.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from signals.rotation import NO_TURN
from signals.samples import Quat, Vec3
from sim.scene.placed.actor import ObjectActor
from sim.scene.placed.template import Template
from sim.scene.scene_map import Actor
from sim.scene.world import World

UNSCALED: Vec3 = (1.0, 1.0, 1.0)
_DIGITS = 12


@dataclass
class SceneObject:
    """Object of the scene. `p_W`, `q_W`: its pose (FLU to ENU); `scale` along its own axes."""

    name: str
    class_name: str
    p_W: Vec3
    q_W: Quat = NO_TURN
    scale: Vec3 = UNSCALED
    body: int = 0  # of the scene's model; 0: none
    mover: Actor | None = None  # actor of the scene that moves by itself
    template: Template | None = None  # of a copy
    actor: ObjectActor | None = None
    spawned: bool = False


def scene_objects(world: World) -> dict[str, SceneObject]:
    """Return the objects of a scene by name."""
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    movers = {actor.name: actor for actor in world.map.actors}
    found = {}
    first_geom = {int(i): g for g, i in reversed(list(enumerate(world.geom_instance.tolist())))}
    for number, name in enumerate(world.instance_names):
        if number == 0 or number not in first_geom:
            continue
        geom = first_geom[number]
        body = int(model.geom_bodyid[geom])
        class_name = world.class_names[int(world.geom_class[geom])]
        if name in movers:
            found[name] = SceneObject(name, class_name, (0.0, 0.0, 0.0), mover=movers[name])
            continue
        while body and model.body_parentid[body]:
            body = int(model.body_parentid[body])
        p, q = (data.xpos[body], data.xquat[body]) if body else (data.geom_xpos[geom], np.array(NO_TURN))
        x, y, z = np.round(p, _DIGITS).tolist()  # MuJoCo's last digits depend on the machine
        w, i, j, k = np.round(q, _DIGITS).tolist()
        found[name] = SceneObject(name, class_name, (x, y, z), (w, i, j, k), body=body)
    return found
