"""People of a scene: identity, true position over time, and pixels that a camera sees of each.

Pixels are counted in the camera's instance picture at the vehicle's true pose, rendered after the flight, so pixels
hidden by an obstacle or outside the picture do not count. Lens errors and colour noise have no effect, and a rolling
shutter is rendered as a global one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.config import SensorConfig
from hil.config.sensors.radar_checks import view_of
from signals.channels import CHANNELS
from signals.samples import TruthState
from sim.frame.mount import Mount
from sim.frame.shading import MEAN_COLOURS
from sim.frame.source import SharedFrames
from sim.scene.scene_map import actor_pose
from sim.scene.world import World


@dataclass(frozen=True)
class TruePerson:
    """One person. `actor`: index in the map's actors; None: the person stands still."""

    instance: int
    name: str
    static_m: tuple[float, float]  # x, y in W, of a person who stands still
    actor: int | None


class TruePeople:
    """All instances of the class `label` in a world."""

    def __init__(self, world: World, label: str) -> None:
        model = world.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        actors = {model.body(name).id: k for k, actor in enumerate(world.map.actors) for name in actor.bodies}
        names = list(world.class_names)
        class_index = names.index(label) if label in names else -1
        people = []
        for instance in np.unique(world.geom_instance).tolist():
            geoms = np.flatnonzero(world.geom_instance == instance)
            if not instance or int(np.bincount(world.geom_class[geoms]).argmax()) != class_index:
                continue
            bodies = [int(model.geom_bodyid[g]) for g in geoms]
            x, y, _ = data.geom_xpos[geoms].mean(axis=0).tolist()
            actor = next((actors[body] for body in bodies if body in actors), None)
            people.append(TruePerson(instance, model.body(bodies[0]).name, (x, y), actor))
        self.people = tuple(people)
        self._actors = world.map.actors

    def position_m(self, person: TruePerson, t_ns: int) -> tuple[float, float]:
        """Return x and y in W [m] at a time: the mean position of the limbs."""
        if person.actor is None:
            return person.static_m
        p_WB, *_ = actor_pose(self._actors[person.actor], t_ns)
        x, y, _ = p_WB.mean(axis=0).tolist()
        return x, y


def visible_px(
    frames: SharedFrames, camera: SensorConfig, people: Sequence[TruePerson], truths: Sequence[TruthState]
) -> NDArray[np.int64]:
    """Return the pixel counts of each person in the camera's picture at each truth state, (truths, people)."""
    view: Any = view_of(camera)
    p: Any = camera.parameters
    mount = Mount(p.mount_m, p.mount_rpy_deg)
    renderer = frames.renderer(
        view.camera, shadows=False, supersample=1, near_m=p.near_m, far_m=p.far_m, shading=MEAN_COLOURS
    )
    picture = CHANNELS["instance"].empty(view.camera.height, view.camera.width)
    instances = [person.instance for person in people]
    counts = np.zeros((len(truths), len(people)), np.int64)
    for row, truth in enumerate(truths):
        frames.expect(truth.t_ns)
        renderer.render(mount.pose(truth), {"instance": picture})
        histogram = np.bincount(picture.ravel(), minlength=max(instances, default=0) + 1)
        counts[row] = histogram[instances] if instances else 0
    return counts
