"""The scene of a bench: reading it, checking it with its map, and copying it to the folder of a run."""

from __future__ import annotations

from pathlib import Path

from signals.documents.document import shown_path
from signals.documents.validate import validate
from signals.documents.yaml_lines import dump_yaml, read_yaml
from signals.errors import ConfigError, Problem
from sim.physics.take_off import take_off_problem
from sim.physics.vehicle import Vehicle
from sim.scene.map_file import read_map_file
from sim.scene.map_section import MjcfMap
from sim.scene.scene import Scene, is_mjcf, scene_of_mjcf
from sim.scene.scene_file import SceneFile
from sim.world_loader import load_world

_MAP_FOLDER = "scene_map"


def read_scene(path: Path) -> tuple[Scene | None, list[Problem]]:
    """Read a scene's YAML file, or an MJCF file as a scene. Raises ConfigError if the file cannot be read at all."""
    if is_mjcf(path):
        return scene_of_mjcf(path), []
    document = read_yaml(path)
    if document.data in (None, {}):
        return None, [
            Problem(document.source, "is empty", "a scene holds at least a name, a site and a ground_friction")
        ]
    scene, problems = validate(Scene, document.data, document)
    if scene is not None:
        scene = scene.from_file(SceneFile(path, document))
    return scene, problems


def world_problems(scene: Scene, vehicle: Vehicle | None) -> list[Problem]:
    """Report what is wrong with the map of a scene, and with the take-off place of the vehicle."""
    if scene.plain and not scene.boxes:
        return []
    try:
        load_world(scene)
        wrong = take_off_problem(scene, vehicle) if vehicle is not None else None
    except ConfigError as error:
        return error.problems
    if wrong is None:
        return []
    place = ("map",) if scene.map is not None else ("boxes",)
    return [scene.file.problem(place, *wrong)]


def save_scene(scene: Scene, source: Path, folder: Path) -> str:
    """Copy a scene to a folder, with every file that its map names. Returns the name of the new scene file.

    Weather and randomisation are left out of the copy, because the bench applies them again when it is loaded.
    """
    scene = scene.original
    if not isinstance(scene.map, MjcfMap):
        name = f"scene{source.suffix}"
        (folder / name).write_bytes(source.read_bytes())
        return name
    read = read_map_file((scene.file.folder / scene.map.mjcf).expanduser())
    below = folder / _MAP_FOLDER
    below.mkdir(exist_ok=True)
    (below / "map.xml").write_text(read.text, encoding="utf-8")
    for name, data in read.assets.items():
        (below / name).write_bytes(data)
    kept = scene.model_copy(update={"map": scene.map.model_copy(update={"mjcf": f"{_MAP_FOLDER}/map.xml"})})
    head = f"# The scene of {shown_path(source)}, with its map in {_MAP_FOLDER}/.\n"
    (folder / "scene.yaml").write_text(head + dump_yaml(kept.model_dump(mode="json")), encoding="utf-8")
    return "scene.yaml"
