"""Compile the map of a scene to a `World`.

The map comes from a generator with a seed, the user's own MJCF file, a file of another program (sim/scene/imports), or
is a ground plane with boxes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.documents.document import shown_path
from signals.documents.validate import nearest, validate
from signals.errors import ConfigError, Problem
from signals.shortage import shortage
from sim.scene import semantics
from sim.scene.budget import Budget
from sim.scene.classes import MAX_CLASSES, class_table
from sim.scene.compile_process import compile_mjcf
from sim.scene.map_file import MapFile, read_map_file
from sim.scene.map_limits import size_problems
from sim.scene.map_section import ElevationMap, GeneratedMap, GltfMap, MapSection, MjcfMap, OsmMap
from sim.scene.maps.imported.sources import ImportSource, files_root, import_source, named_file
from sim.scene.scene import Box, Scene
from sim.scene.scene_map import SceneMap, Surface
from sim.scene.surfaces import DEFAULT_SURFACE, SURFACES
from sim.scene.world import VEHICLE, World

_SHAPES = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"))
    for kind in ("PLANE", "HFIELD", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
# A plane of size 0 is infinite in MuJoCo.
_GROUND = '<geom name="ground" type="plane" size="0 0 1"/>'


@dataclass(frozen=True)
class MapSource:
    """Section `map` of a scene, with the files that it names, if any."""

    section: MapSection | None
    file: MapFile | None = None
    text: str = ""
    imported: ImportSource | None = None
    budget: Budget | None = None  # of a map from a file

    def key(self, scene: Scene) -> str:
        """Return a hash of everything that the compiled map depends on."""
        parts: dict[str, Any] = {"map": None, "text": self.text, "boxes": [box.model_dump() for box in scene.boxes]}
        if self.section is not None:
            parts["map"] = self.section.model_dump()
        state = hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode())
        if self.imported is not None:
            state.update(self.imported.key().encode())
        for name, data in (self.file.assets if self.file is not None else {}).items():
            state.update(name.encode())
            state.update(hashlib.sha256(data).digest())
        return state.hexdigest()


def map_source(scene: Scene) -> MapSource:
    """Return the source of a scene's map; its files are read. Raises ConfigError if they cannot be used."""
    section = scene.map
    if not isinstance(section, MjcfMap):
        imported = import_source(scene)
        return MapSource(section, imported=imported, budget=imported.budget if imported is not None else None)
    path = named_file(scene, "mjcf", section.mjcf)
    budget = Budget(shown_path(path))
    file = read_map_file(path, root=files_root(scene, path), budget=budget)
    return MapSource(section, file, file.text, budget=budget)


def compile_source(scene: Scene, source: MapSource) -> World:
    """Generate or read the map of a scene, add the scene's boxes and compile it. Raises ConfigError."""
    section = source.section
    if isinstance(section, GeneratedMap):
        scene_map = _generated(scene, section)
        scene_map = replace(scene_map, mjcf=_with_boxes(scene_map.mjcf, scene.boxes))
        new_classes = tuple(name for name in scene_map.classes if name not in class_table())
        return compile_map(scene, scene_map, class_table(new_classes))
    if isinstance(section, MjcfMap):
        assert source.file is not None
        return _from_file(scene, section, source.file, source.budget)
    if section is not None:
        assert source.imported is not None
        return _imported(scene, section, source.imported)
    text = f"<mujoco><worldbody>{_GROUND}</worldbody></mujoco>"
    scene_map = SceneMap(_with_boxes(text, scene.boxes), {}, {}, {}, ())
    return compile_map(scene, scene_map, class_table())


def _generated(scene: Scene, section: GeneratedMap) -> SceneMap:
    # Imported here because most flights need none of the many generators.
    from sim.scene.maps.asset_files import own_files
    from sim.scene.maps.catalog import GENERATORS

    generator = GENERATORS.get(section.generator)
    if generator is None:
        message = f"is unknown: {section.generator!r}"
        raise ConfigError([scene.file.problem(("map", "generator"), message, nearest(section.generator, GENERATORS))])
    parameters, problems = validate(generator.parameters, section.parameters, scene.file.document, below=("map",))
    if parameters is None or problems:
        raise ConfigError(problems)
    try:
        made = generator.generate(parameters, section.seed)
    except ValueError as error:
        message = f"cannot be generated with these parameters: {error}"
        raise ConfigError([scene.file.problem(("map",), message)]) from None
    notes = tuple(f"sim/scene/assets/{name} replaces the shipped file of its name" for name in own_files())
    return replace(made, notes=(*made.notes, *notes))


def _from_file(scene: Scene, section: MjcfMap, file: MapFile, budget: Budget | None) -> World:
    class_colours, surfaces, problems = _names(scene, section)
    problems += size_problems(file.root)
    for element in file.root.walk():
        if element.tag == "freejoint" or (element.tag == "joint" and element.attributes.get("type") == "free"):
            message = "holds a free joint, but only the vehicle may fly, and the bench adds it"
            problems.append(Problem(element.where, message, "remove the joint: the body is then static"))
        elif element.tag == "body" and element.attributes.get("name") == VEHICLE:
            message = f"holds a body named {VEHICLE!r}, the name of the body that the bench adds"
            problems.append(Problem(element.where, message, "remove it, or rename it if it is scenery"))
    if problems:
        raise ConfigError(problems)
    text = file.text
    if section.ground:
        text = _insert(text, _GROUND)
    text = _with_boxes(text, scene.boxes)
    scene_map = SceneMap(text, file.assets, section.classes, surfaces, (), from_file=True)
    return compile_map(scene, scene_map, class_colours, file, budget)


def _imported(scene: Scene, section: GltfMap | OsmMap | ElevationMap, source: ImportSource) -> World:
    class_colours, surfaces, problems = _names(scene, section)
    if problems:
        raise ConfigError(problems)
    made = source.make(surfaces)
    for name, index in made.unmatched_classes:
        pattern = section.classes[name][index]
        message = f"matches nothing in the map: {pattern!r}"
        place = ("map", "classes", name, index)
        problems.append(scene.file.problem(place, message, nearest(pattern, made.names, listed=False)))
    for name in made.unmatched_surfaces:
        message = "matches no material of the map"
        problems.append(scene.file.problem(("map", "surfaces", name), message, nearest(name, made.names, listed=False)))
    if problems:
        raise ConfigError(problems)
    if made.walks:
        from sim.scene.maps.imported.walkers import with_walkers  # loads the figures of people

        made = replace(made, scene_map=with_walkers(made.scene_map, made.walks))
    scene_map = replace(made.scene_map, mjcf=_with_boxes(made.scene_map.mjcf, scene.boxes), from_file=True)
    return compile_map(scene, scene_map, class_colours, budget=source.budget)


def _names(
    scene: Scene, section: MjcfMap | GltfMap | OsmMap | ElevationMap
) -> tuple[dict[str, tuple[int, int, int]], dict[str, Surface], list[Problem]]:
    """Return the table of classes, the surfaces by material, and what is wrong with these names."""
    problems: list[Problem] = []
    for name in section.new_classes:
        if name in class_table() or section.new_classes.count(name) > 1:
            problems.append(scene.file.problem(("map", "new_classes"), f"holds a class that exists already: {name!r}"))
    class_colours = class_table(tuple(dict.fromkeys(section.new_classes)))
    if len(class_colours) > MAX_CLASSES:
        message = f"holds too many: {MAX_CLASSES} classes in all"
        problems.append(scene.file.problem(("map", "new_classes"), message))
    for name in section.classes:
        if name not in class_colours:
            hint = nearest(name, class_colours) + ", or add it to map.new_classes"
            problems.append(scene.file.problem(("map", "classes", name), "is not a class", hint))
        elif name == "none":
            problems.append(
                scene.file.problem(("map", "classes", name), "cannot be assigned: it is the class of nothing")
            )
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
    return class_colours, surfaces, problems


def _with_boxes(mjcf: str, boxes: tuple[Box, ...]) -> str:
    for box in boxes:
        centre = " ".join(repr(float(v)) for v in box.center_m)
        half = " ".join(repr(0.5 * float(v)) for v in box.size_m)
        mjcf = _insert(mjcf, f'<geom name={quoteattr(box.name)} type="box" pos="{centre}" size="{half}"/>')
    return mjcf


def _insert(mjcf: str, element: str) -> str:
    """Return the text with `element` at the end of its worldbody. No line is added, so line numbers stay true."""
    position = mjcf.rfind("</worldbody>")
    if position < 0:
        end = mjcf.rfind("</mujoco>")
        return (
            f"{mjcf[:end]}<worldbody>{element}</worldbody>{mjcf[end:]}" if end >= 0 else _with_worldbody(mjcf, element)
        )
    return mjcf[:position] + element + mjcf[position:]


def _with_worldbody(mjcf: str, element: str) -> str:
    """Return the text of an empty element, <mujoco .../>, with `element` as its worldbody."""
    return re.sub(r"/>\s*$", f"><worldbody>{element}</worldbody></mujoco>", mjcf)


def compile_map(
    scene: Scene,
    scene_map: SceneMap,
    class_colours: Mapping[str, tuple[int, int, int]],
    file: MapFile | None = None,
    budget: Budget | None = None,
) -> World:
    """Compile a map and number its classes, instances and surfaces; raises ConfigError.

    `class_colours`: class -> colour, in the order of class ids. `file`: the user's MJCF file, for its line numbers.
    `budget`: what reading the map has left of it, for a map from a file.
    """
    if scene_map.from_file and budget is None:
        budget = Budget(scene.file.document.where(("map",)))
    try:
        model = compile_mjcf(scene_map.mjcf, scene_map.assets, budget if scene_map.from_file else None)
    except (ValueError, mujoco.FatalError, UnicodeError) as error:
        if file is None and (ran_out := shortage(error)) is not None:
            raise ran_out from None
        problem = file.problem(str(error)) if file is not None else None
        raise ConfigError(
            [problem or scene.file.problem(("map",), f"cannot be compiled: {' '.join(str(error).split())}")]
        ) from None
    names = semantics.Names.of(model)
    class_ids = {name: number for number, name in enumerate(class_colours)}
    problems = []
    geom_class, unmatched = semantics.classes(model, names, scene_map.classes, class_ids)
    if file is not None:
        for name, index in unmatched:
            pattern = scene_map.classes[name][index]
            known = [*names.bodies[1:], *names.geoms]
            message = f"matches nothing in the map: {pattern!r}"
            hint = nearest(pattern, [word for word in known if word], listed=False)
            problems.append(scene.file.problem(("map", "classes", name, index), message, hint))
        for material in scene_map.surfaces:
            if material not in names.materials:
                message = "is not a material of the map"
                problems.append(
                    scene.file.problem(("map", "surfaces", material), message, nearest(material, names.materials))
                )
        problems += _unsupported_parts(model, names, file)
    if problems:
        raise ConfigError(problems)
    try:
        geom_instance, instance_names = semantics.instances(names, scene_map.actors)
        geom_surface, surfaces = semantics.surfaces(model, names, scene_map.surfaces, DEFAULT_SURFACE)
    except ValueError as error:
        raise ConfigError([scene.file.problem(("map",), str(error))]) from None
    return World(
        scene,
        scene_map,
        model,
        tuple(class_colours),
        tuple(class_colours.values()),
        instance_names,
        surfaces,
        read_only(geom_class),
        read_only(geom_instance),
        read_only(geom_surface),
        read_only(semantics.visible(model)),
    )


def _unsupported_parts(model: mujoco.MjModel, names: semantics.Names, file: MapFile) -> list[Problem]:
    """List parts of the model that the bench cannot simulate; defaults, sub-models and replicas may add such parts."""
    problems = []
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist():
        body = names.bodies[model.jnt_bodyid[joint]]
        message = "has a free joint, but only the vehicle may fly, and the bench adds it"
        problems.append(Problem(file.where("body", body), f"body {body!r} {message}"))
    if VEHICLE in names.bodies:
        message = f"holds a body named {VEHICLE!r}, the name of the body that the bench adds"
        problems.append(Problem(file.where("body", VEHICLE), message))
    for geom in np.flatnonzero(~np.isin(model.geom_type, _SHAPES)).tolist():
        message = f"geom {names.geoms[geom]!r} is of a type that the bench does not simulate (sdf?)"
        problems.append(Problem(file.where("geom", names.geoms[geom]), message, "use a mesh or a primitive"))
    if model.nflex:
        problems.append(Problem(file.root.source, "holds a flexible body, which the bench does not simulate"))
    for body in np.flatnonzero(model.body_mocapid >= 0).tolist():
        if names.parent[body] != 0:
            problems.append(Problem(file.where("body", names.bodies[body]), "is a mocap body inside another body"))
    if not all(np.all(np.isfinite(a)) for a in (model.geom_pos, model.geom_quat, model.body_pos, model.geom_size)):
        problems.append(Problem(file.root.source, "holds a pose or size that is not finite once compiled"))
    return problems


def read_only(array: NDArray) -> NDArray:
    """Make the array read-only, and return it."""
    array.setflags(write=False)
    return array
