"""Reads the scene of a bench, checks it with its map, and copies it to the folder of a run."""

from __future__ import annotations

from pathlib import Path

from hil.config.schema import Start
from signals.documents.document import shown_path
from signals.documents.validate import Located, at, validate
from signals.documents.yaml_lines import dump_yaml, read_yaml
from signals.errors import ConfigError, Problem
from sim.physics.take_off import take_off_problem
from sim.physics.vehicle import Vehicle
from sim.scene.map_file import read_map_file
from sim.scene.map_section import GltfMap, MjcfMap
from sim.scene.maps.imported.sources import files_root, import_source, named_file
from sim.scene.scene import Scene, check_suffix, is_map_file, scene_of_map
from sim.scene.scene_file import SceneFile
from sim.world_loader import load_world

_MAP_FOLDER = "scene_map"


def read_scene(path: Path) -> tuple[Scene | None, list[Problem]]:
    """Read a scene's YAML file, or a map's file as a scene. Raises ConfigError if the file cannot be read at all."""
    if is_map_file(path):
        return scene_of_map(path), []
    check_suffix(path)
    document = read_yaml(path)
    if document.data in (None, {}):
        return None, [
            Problem(document.source, "is empty", "a scene holds at least a name, a site and a ground_friction")
        ]
    scene, problems = validate(Scene, document.data, document)
    if scene is not None:
        scene = scene.from_file(SceneFile(path, document))
    return scene, problems


def on_free_ground(scene: Scene, vehicle: Vehicle) -> Scene:
    """Return the scene of a glTF file, moved so that its origin is free ground near it if nothing can take off there.

    Such a file says nothing of a take-off place: its origin may be inside a house. One without ground, such as the
    model of a house, gets a plane at its foot rather than a vehicle on its roof. Raises ConfigError for a wrong map.
    """
    if not isinstance(scene.map, GltfMap):
        return scene
    problem = take_off_problem(scene, vehicle)
    if problem is None or problem.place is None:
        return scene
    if problem.foot_m is not None:
        foot_m = round(problem.foot_m, 3)
        on_plane = _with_map(scene, ground=True, origin_m=(0.0, 0.0, foot_m))
        beside = take_off_problem(on_plane, vehicle)
        if beside is not None and beside.place is not None:
            x, y, _ = beside.place
            on_plane = _with_map(on_plane, origin_m=(x, y, foot_m))
            beside = take_off_problem(on_plane, vehicle)
        if beside is None:
            return on_plane
    return _with_map(scene, origin_m=problem.place)


def _with_map(scene: Scene, **settings: object) -> Scene:
    assert scene.map is not None
    return scene.model_copy(update={"map": scene.map.model_copy(update=settings)})


def world_problems(scene: Scene, vehicle: Vehicle | None, start: Start, located: Located) -> list[Problem]:
    """Report problems of a scene's map and of the place where the vehicle starts."""
    moved = start.p_W != Start().p_W
    if scene.is_bare and not moved:
        return []
    try:
        load_world(scene)
        take_off = take_off_problem(scene, vehicle, start.flight_start()) if vehicle is not None else None
    except ConfigError as error:
        return error.problems
    if take_off is None:
        return []
    if moved:
        return [at(located, ("start", "p_W"), take_off.message, take_off.hint)]
    place = ("boxes",) if scene.map is None else ("map",)
    return [scene.file.problem(place, take_off.message, take_off.hint)]


def save_scene(scene: Scene, source: Path, folder: Path) -> str:
    """Copy a scene to a folder, with every file that its map names. Returns the name of the new scene file.

    Weather and randomisation are left out of the copy, because the bench applies them again when it is loaded.
    """
    scene = scene.original
    imported = import_source(scene)
    if not isinstance(scene.map, MjcfMap) and imported is None:
        name = f"scene{source.suffix}"
        (folder / name).write_bytes(source.read_bytes())
        return name
    map_folder = folder / _MAP_FOLDER
    map_folder.mkdir(exist_ok=True)
    if imported is not None:
        names = imported.save(map_folder)
    else:
        assert isinstance(scene.map, MjcfMap)
        path = named_file(scene, "mjcf", scene.map.mjcf)
        map_file = read_map_file(path, root=files_root(scene, path))
        (map_folder / "map.xml").write_text(map_file.text, encoding="utf-8")
        for name, data in map_file.assets.items():
            (map_folder / name).write_bytes(data)
        names = {"mjcf": "map.xml"}
    assert scene.map is not None
    new_map = scene.map.model_copy(update={key: f"{_MAP_FOLDER}/{name}" for key, name in names.items()})
    copied = scene.model_copy(update={"map": new_map})
    head = f"# The scene of {shown_path(source)}, with its map in {_MAP_FOLDER}/.\n"
    (folder / "scene.yaml").write_text(head + dump_yaml(copied.model_dump(mode="json")), encoding="utf-8")
    return "scene.yaml"
