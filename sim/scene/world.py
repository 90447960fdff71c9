"""The geometry of a scene: its compiled map, with class, instance and surface of every geom. Worlds are immutable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.scene import semantics
from sim.scene.added_object import AddedObject
from sim.scene.added_person import PERSON, AddedPerson
from sim.scene.scene import Scene
from sim.scene.scene_map import SceneMap, Surface
from sim.scene.surface_appearance import SurfaceAppearance, draw_surface
from sim.scene.surfaces import SKIN

VEHICLE = "vehicle"  # name of the vehicle's body


@dataclass(frozen=True, eq=False)
class World:
    """A scene and its compiled map. Arrays are indexed by geom of `model`."""

    scene: Scene
    map: SceneMap
    model: mujoco.MjModel  # compiled map.mjcf, without the vehicle
    class_names: tuple[str, ...]  # index = class id; [0] == "none"
    class_colours: tuple[tuple[int, int, int], ...]  # sRGB, for display
    instance_names: tuple[str, ...]  # index = instance id; [0] == "none"
    surfaces: tuple[Surface, ...]  # index = surface id; [0]: no surface
    geom_class: NDArray[np.uint8]
    geom_instance: NDArray[np.uint16]
    geom_surface: NDArray[np.uint8]
    geom_visible: NDArray[np.bool_]
    added_people: tuple[AddedPerson, ...] = ()  # added by randomisation
    added_objects: tuple[AddedObject, ...] = ()  # the same

    @cached_property
    def geom_appearance(self) -> tuple[SurfaceAppearance | None, ...]:
        """Random appearance of each geom; None: as the map has it."""
        appearance = self.scene.appearance
        if appearance is None or appearance.textures is None:
            return (None,) * int(self.model.ngeom)
        return tuple(self.surface_appearance.get(name) for name in self._geom_surface_name)

    @cached_property
    def surface_appearance(self) -> dict[str, SurfaceAppearance]:
        """Random appearance of each surface, by its MJCF material's name; without material, by the object's name."""
        appearance = self.scene.appearance
        if appearance is None or appearance.textures is None:
            return {}
        skin_materials = {name for name, surface in self.map.surfaces.items() if surface == SKIN}
        names = dict.fromkeys(name for name in self._geom_surface_name if not name.startswith(PERSON))
        limits, seed = appearance.textures, appearance.seed
        return {name: draw_surface(limits, seed, name, keeps_hue=name in skin_materials) for name in names}

    @cached_property
    def _geom_surface_name(self) -> tuple[str, ...]:
        names = semantics.Names.of(self.model)
        return tuple(
            names.materials[material] if material >= 0 else self.instance_names[instance]
            for material, instance in zip(self.model.geom_matid.tolist(), self.geom_instance.tolist(), strict=True)
        )

    @cached_property
    def geom_actor(self) -> NDArray[np.int32]:
        """(ngeom,) Index into `map.actors` of the actor that each geom belongs to; -1: static."""
        actor_of = {body: index for index, actor in enumerate(self.map.actors) for body in actor.bodies}
        names = semantics.Names.of(self.model)
        body_actor = [actor_of.get(names.bodies[top], -1) for top in names.top]
        return np.array(body_actor, np.int32)[self.model.geom_bodyid]

    @property
    def geom_solid(self) -> NDArray[np.bool_]:
        """(ngeom,) True for geoms that take part in collisions."""
        return (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
