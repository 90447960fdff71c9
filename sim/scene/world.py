"""A scene as geometry: its map compiled, with class, instance and surface of every part.

The map comes from one of three sources: a generator with a seed, the user's own MJCF file, or the plain ground plane
and boxes. Compiling takes up to seconds, so the last few worlds are kept; a world is never changed.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.signals.documents.validate import nearest, validate
from hil.signals.errors import ConfigError, Problem
from sim.randomize.settings import PeopleLimits
from sim.randomize.surfaces import SurfaceLook, draw_surface
from sim.scene import semantics
from sim.scene.classes import MAX_CLASSES, class_table
from sim.scene.map_file import MapFile, read_map_file
from sim.scene.map_section import GeneratedMap, MjcfMap
from sim.scene.maps.scene_map import SceneMap, Surface
from sim.scene.maps.surfaces import SKIN
from sim.scene.scene import Box, Scene
from sim.scene.surfaces import DEFAULT_SURFACE, SURFACES

if TYPE_CHECKING:
    from sim.randomize.people import Person

_KEPT = 6  # worlds
_SHAPES = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"))
    for kind in ("PLANE", "HFIELD", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
PERSON = "random_person_"  # how the names of what randomisation adds begin
VEHICLE = "vehicle"  # the name that the vehicle's body has

# A plane is drawn as far as this and goes on for ever.
_GROUND = '<geom name="ground" type="plane" size="0 0 1"/>'


@dataclass(frozen=True, eq=False)
class World:
    """A scene and its compiled map. All arrays are by geom of `model`."""

    scene: Scene
    map: SceneMap
    model: mujoco.MjModel  # compiled map.mjcf, without the vehicle
    class_names: tuple[str, ...]  # index = class id; [0] == "none"
    class_colours: tuple[tuple[int, int, int], ...]  # to show them in
    instance_names: tuple[str, ...]  # index = instance id; [0] == "none"
    surfaces: tuple[Surface, ...]  # index = surface id; [0] is that of nothing
    geom_class: NDArray[np.uint8]
    geom_instance: NDArray[np.uint16]
    geom_surface: NDArray[np.uint8]
    geom_visible: NDArray[np.bool_]
    added_people: tuple[Person, ...] = ()  # by randomisation

    @cached_property
    def geom_look(self) -> tuple[SurfaceLook | None, ...]:
        """What randomisation makes each geom look like; None: as the map has it."""
        looks = self.scene.looks
        if looks is None or looks.textures is None:
            return (None,) * int(self.model.ngeom)
        return tuple(self.surface_looks.get(name) for name in self._geom_surface_name)

    @cached_property
    def surface_looks(self) -> dict[str, SurfaceLook]:
        """What randomisation makes of each surface, by name: the MJCF material, or the thing that has none."""
        looks = self.scene.looks
        if looks is None or looks.textures is None:
            return {}
        of_skin = {name for name, surface in self.map.surfaces.items() if surface == SKIN}
        names = dict.fromkeys(name for name in self._geom_surface_name if not name.startswith(PERSON))
        return {name: draw_surface(looks.textures, looks.seed, name, keeps_hue=name in of_skin) for name in names}

    @cached_property
    def _geom_surface_name(self) -> tuple[str, ...]:
        names = semantics.Names.of(self.model)
        return tuple(
            names.materials[material] if material >= 0 else self.instance_names[instance]
            for material, instance in zip(self.model.geom_matid.tolist(), self.geom_instance.tolist(), strict=True)
        )

    @cached_property
    def geom_actor(self) -> NDArray[np.int32]:
        """Which of `map.actors` each geom belongs to, -1 for what stands still."""
        actor_of = {body: index for index, actor in enumerate(self.map.actors) for body in actor.bodies}
        names = semantics.Names.of(self.model)
        of_body = [actor_of.get(names.bodies[top], -1) for top in names.top]
        return np.array(of_body, np.int32)[self.model.geom_bodyid]

    @property
    def geom_solid(self) -> NDArray[np.bool_]:
        """Geoms that things can collide with."""
        return (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)


def load_world(scene: Scene, *, map_seed: int | None = None) -> World:
    """The world of a scene; with `map_seed`, that of the scene with another seed. Raises ConfigError."""
    if map_seed is not None:
        try:
            scene = scene.with_map_seed(map_seed)
        except ValueError as error:
            raise ConfigError([scene.file.problem(("map",), f"takes no seed: {error}")]) from None
    made = scene.file.made.get("world")
    if made is not None and made.scene == scene:
        return made
    source = _source(scene)
    key = source.key(scene)
    world = _kept(key, lambda: _compile(scene, source))
    looks = scene.looks
    if looks is not None and looks.people is not None:
        base, limits, seed = world, looks.people, looks.seed
        key += f" {seed} {limits.model_dump_json()}"
        world = _kept(key, lambda: _with_people(base, limits, seed))
    if world.scene != scene:
        world = _worlds[key] = replace(world, scene=scene)
    scene.file.made["world"] = world
    return world


_worlds: OrderedDict[str, World] = OrderedDict()


def _kept(key: str, make: Callable[[], World]) -> World:
    if key not in _worlds:
        _worlds[key] = make()
        while len(_worlds) > _KEPT:
            _worlds.popitem(last=False)
    _worlds.move_to_end(key)
    return _worlds[key]


@dataclass(frozen=True)
class _Source:
    """What a world is compiled from: a map, or a generator that will make one."""

    section: GeneratedMap | MjcfMap | None
    file: MapFile | None = None
    text: str = ""

    def key(self, scene: Scene) -> str:
        what: dict[str, Any] = {"map": None, "text": self.text, "boxes": [box.model_dump() for box in scene.boxes]}
        if self.section is not None:
            what["map"] = self.section.model_dump()
        state = hashlib.sha256(json.dumps(what, sort_keys=True, default=str).encode())
        for name, data in (self.file.assets if self.file is not None else {}).items():
            state.update(name.encode())
            state.update(hashlib.sha256(data).digest())
        return state.hexdigest()


def _source(scene: Scene) -> _Source:
    section = scene.map
    if not isinstance(section, MjcfMap):
        return _Source(section)
    folder = scene.file.folder
    path = folder / section.mjcf
    try:
        there = path.expanduser().is_file()
    except (OSError, RuntimeError, ValueError):
        there = False
    if not there:
        message = f"names a file that does not exist: {section.mjcf}"
        raise ConfigError([scene.file.problem(("map", "mjcf"), message, f"looked beside {scene.file.document.source}")])
    file = read_map_file(path.expanduser())
    return _Source(section, file, file.text)


def _compile(scene: Scene, source: _Source) -> World:
    section = source.section
    if isinstance(section, GeneratedMap):
        made = _generated(scene, section)
        made = replace(made, mjcf=_with_boxes(made.mjcf, scene.boxes))
        further = tuple(name for name in made.classes if name not in class_table())
        return _world(scene, made, class_table(further), None)
    if isinstance(section, MjcfMap):
        assert source.file is not None
        return _from_file(scene, section, source.file)
    text = f"<mujoco><worldbody>{_GROUND}</worldbody></mujoco>"
    made = SceneMap(_with_boxes(text, scene.boxes), {}, {}, {}, ())
    return _world(scene, made, class_table(), None)


def _with_people(base: World, limits: PeopleLimits, seed: int) -> World:
    """The world with those in it whom a seed adds. What was there keeps its numbers."""
    from sim.randomize.free_ground import FreeGround  # looks at geometry, and so at worlds
    from sim.randomize.people import draw_people, map_with

    people = draw_people(limits, seed, FreeGround(base))
    if not people:
        return base
    table = dict(zip(base.class_names, base.class_colours, strict=True))
    made = _world(base.scene, map_with(people, base.map), table, None)
    # Globs of the map's own may match anything, its people's names too.
    added = np.arange(made.model.ngeom) >= base.model.ngeom
    geom_class = np.where(added, base.class_names.index("person"), made.geom_class).astype(np.uint8)
    return replace(made, geom_class=_fixed(geom_class), added_people=people)


def _generated(scene: Scene, section: GeneratedMap) -> SceneMap:
    # Not at the top: generators are many, and most flights need none.
    from sim.scene.maps.catalog import GENERATORS

    generator = GENERATORS.get(section.generator)
    if generator is None:
        message = f"is unknown: {section.generator!r}"
        raise ConfigError([scene.file.problem(("map", "generator"), message, nearest(section.generator, GENERATORS))])
    parameters, problems = validate(generator.parameters, section.parameters, scene.file.document, below=("map",))
    if parameters is None or problems:
        raise ConfigError(problems)
    try:
        return generator.generate(parameters, section.seed)
    except ValueError as error:
        message = f"cannot be generated with these parameters: {error}"
        raise ConfigError([scene.file.problem(("map",), message)]) from None


def _from_file(scene: Scene, section: MjcfMap, file: MapFile) -> World:
    problems = []
    for name in section.new_classes:
        if name in class_table() or section.new_classes.count(name) > 1:
            problems.append(scene.file.problem(("map", "new_classes"), f"holds one that there is already: {name!r}"))
    table = class_table(tuple(dict.fromkeys(section.new_classes)))
    if len(table) > MAX_CLASSES:
        message = f"holds too many: {MAX_CLASSES} classes in all"
        problems.append(scene.file.problem(("map", "new_classes"), message))
    for name in section.classes:
        if name not in table:
            hint = nearest(name, table) + ", or add it to map.new_classes"
            problems.append(scene.file.problem(("map", "classes", name), "is no class", hint))
        elif name == "none":
            problems.append(scene.file.problem(("map", "classes", name), "cannot be given: it is the class of nothing"))
    surfaces: dict[str, Surface] = {}
    for material, value in section.surfaces.items():
        if not isinstance(value, str):
            surfaces[material] = value.surface
        elif value in SURFACES:
            surfaces[material] = SURFACES[value]
        else:
            hint = nearest(value, SURFACES)
            problems.append(
                scene.file.problem(("map", "surfaces", material), f"is an unknown surface: {value!r}", hint)
            )
    for element in file.root.walk():
        if element.tag == "freejoint" or (element.tag == "joint" and element.attributes.get("type") == "free"):
            message = "holds a free joint, and nothing in a map may fly but the vehicle, which the bench adds itself"
            problems.append(Problem(element.where, message, "leave the joint out: the body then stands where it is"))
        elif element.tag == "body" and element.attributes.get("name") == VEHICLE:
            message = f"holds a body named {VEHICLE!r}, which is the name of the one that the bench adds"
            problems.append(Problem(element.where, message, "leave it out, or rename it if it only stands there"))
    if problems:
        raise ConfigError(problems)
    text = file.text
    if section.ground:
        text = _put(text, _GROUND)
    made = SceneMap(_with_boxes(text, scene.boxes), file.assets, section.classes, surfaces, ())
    return _world(scene, made, table, file)


def _with_boxes(mjcf: str, boxes: tuple[Box, ...]) -> str:
    for box in boxes:
        centre = " ".join(repr(float(v)) for v in box.center_m)
        half = " ".join(repr(0.5 * float(v)) for v in box.size_m)
        mjcf = _put(mjcf, f'<geom name={quoteattr(box.name)} type="box" pos="{centre}" size="{half}"/>')
    return mjcf


def _put(mjcf: str, element: str) -> str:
    """`element` at the end of the worldbody. It adds no line, so that the others keep theirs."""
    place = mjcf.rfind("</worldbody>")
    if place < 0:
        end = mjcf.rfind("</mujoco>")
        return f"{mjcf[:end]}<worldbody>{element}</worldbody>{mjcf[end:]}" if end >= 0 else _opened(mjcf, element)
    return mjcf[:place] + element + mjcf[place:]


def _opened(mjcf: str, element: str) -> str:
    """A text of one element without content: <mujoco .../>."""
    return re.sub(r"/>\s*$", f"><worldbody>{element}</worldbody></mujoco>", mjcf)


def _world(scene: Scene, made: SceneMap, table: Mapping[str, tuple[int, int, int]], file: MapFile | None) -> World:
    mujoco.set_mju_user_warning(_ignore)  # else it would write a log file into the working directory
    try:
        model = mujoco.MjModel.from_xml_string(made.mjcf, dict(made.assets))
    except (ValueError, mujoco.FatalError, UnicodeError) as error:
        problem = file.problem(str(error)) if file is not None else None
        raise ConfigError(
            [problem or scene.file.problem(("map",), f"cannot be compiled: {' '.join(str(error).split())}")]
        ) from None
    finally:
        mujoco.set_mju_user_warning(None)
    names = semantics.Names.of(model)
    number_of = {name: number for number, name in enumerate(table)}
    problems = []
    geom_class, idle = semantics.classes(model, names, made.classes, number_of)
    if file is not None:
        for name, index in idle:
            pattern = made.classes[name][index]
            known = [*names.bodies[1:], *names.geoms]
            message = f"matches nothing in the map: {pattern!r}"
            hint = nearest(pattern, [word for word in known if word], listed=False)
            problems.append(scene.file.problem(("map", "classes", name, index), message, hint))
        for material in made.surfaces:
            if material not in names.materials:
                message = "is no material of the map"
                problems.append(
                    scene.file.problem(("map", "surfaces", material), message, nearest(material, names.materials))
                )
        problems += _unfit(model, names, file)
    if problems:
        raise ConfigError(problems)
    try:
        geom_instance, instance_names = semantics.instances(names, made.actors)
        geom_surface, surfaces = semantics.surfaces(model, names, made.surfaces, DEFAULT_SURFACE)
    except ValueError as error:
        raise ConfigError([scene.file.problem(("map",), str(error))]) from None
    return World(
        scene,
        made,
        model,
        tuple(table),
        tuple(table.values()),
        instance_names,
        surfaces,
        _fixed(geom_class),
        _fixed(geom_instance),
        _fixed(geom_surface),
        _fixed(semantics.visible(model)),
    )


def _ignore(_warning: str) -> None:
    """Of a map that compiles, MuJoCo's warnings are about its dynamics, which are not used."""


def _unfit(model: mujoco.MjModel, names: semantics.Names, file: MapFile) -> list[Problem]:
    """What the text alone does not show: it may come from defaults, sub-models or replicas."""
    problems = []
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist():
        body = names.bodies[model.jnt_bodyid[joint]]
        message = "has a free joint, and nothing in a map may fly but the vehicle, which the bench adds itself"
        problems.append(Problem(file.where("body", body), f"body {body!r} {message}"))
    if VEHICLE in names.bodies:
        message = f"holds a body named {VEHICLE!r}, which is the name of the one that the bench adds"
        problems.append(Problem(file.where("body", VEHICLE), message))
    for geom in np.flatnonzero(~np.isin(model.geom_type, _SHAPES)).tolist():
        message = f"geom {names.geoms[geom]!r} is of a kind that the bench does not simulate (sdf?)"
        problems.append(Problem(file.where("geom", names.geoms[geom]), message, "use a mesh or a primitive"))
    if model.nflex:
        problems.append(Problem(file.root.source, "holds a flexible body, which the bench does not simulate"))
    for body in np.flatnonzero(model.body_mocapid >= 0).tolist():
        if names.parent[body] != 0:
            problems.append(Problem(file.where("body", names.bodies[body]), "is a mocap body inside another body"))
    if not all(np.all(np.isfinite(a)) for a in (model.geom_pos, model.geom_quat, model.body_pos, model.geom_size)):
        problems.append(Problem(file.root.source, "places something at no finite place once compiled"))
    return problems


def _fixed(array: NDArray) -> NDArray:
    array.setflags(write=False)
    return array
