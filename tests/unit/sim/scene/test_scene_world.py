"""Scenes as worlds: the three sources of a map, and what every geom is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from hil.config import load_bench, save_bench
from signals.errors import ConfigError
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.classes import CLASS_COLOURS, MAX_CLASSES, class_table
from sim.scene.maps import catalog
from sim.scene.scene import Box, Scene, load_scene, scene_names
from sim.scene.surfaces import DEFAULT_SURFACE, NO_SURFACE, SURFACES
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.walled_yard import TETRAHEDRON, Pacer, yard, yard_map

SCENE = """name: mine
description: A scene of one's own
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
"""


def classes_of(world: World) -> dict[str, str]:
    """Class by instance."""
    return {
        world.instance_names[instance]: world.class_names[kind]
        for instance, kind in zip(world.geom_instance, world.geom_class, strict=True)
    }


def test_without_a_map_the_world_is_the_ground_and_boxes() -> None:
    box = Box(name="crate", center_m=(5.0, 2.0, 3.0), size_m=(2.0, 4.0, 6.0))
    world = load_world(load_scene("airfield").model_copy(update={"boxes": (box,)}))
    assert world.instance_names == ("none", "ground", "crate")
    assert world.geom_instance.tolist() == [1, 2]
    assert classes_of(world) == {"ground": "ground", "crate": "object"}
    assert tuple(world.model.geom("crate").size) == (1.0, 2.0, 3.0)
    assert world.class_names[0] == "none"
    assert world.geom_visible.all()
    assert world.surfaces == (NO_SURFACE, DEFAULT_SURFACE)
    assert (world.geom_surface == 1).all()


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_has_a_world_in_which_every_vehicle_can_take_off(name: str) -> None:
    for vehicle in ("x500", "iris", "racer"):
        bench = load_bench(scene=name, settings=[f"vehicle={vehicle}"])
    world = bench.world
    n = world.model.ngeom
    assert n > 0
    assert len({len(a) for a in (world.geom_class, world.geom_instance, world.geom_surface, world.geom_visible)}) == 1
    assert world.geom_class.min() > 0
    assert world.geom_instance.max() == len(world.instance_names) - 1
    assert sorted(set(world.geom_instance.tolist())) == list(range(1, len(world.instance_names)))
    assert world.geom_surface.max() == len(world.surfaces) - 1 or len(world.surfaces) == 2
    assert len(world.class_names) == len(world.class_colours) <= MAX_CLASSES
    assert not set(world.class_names) - set(CLASS_COLOURS), "a class that the table does not have"
    with pytest.raises(ValueError, match="read-only"):
        world.geom_class[0] = 1


def test_classes_instances_and_surfaces_of_a_users_file(tmp_path: Path) -> None:
    globs = {"building": ("wall_*",), "tree": ("tree_?", "pole_0"), "vegetation": ("crown_0",), "road": ("floor",)}
    values = {"lidar_reflectivity": 0.9, "relative_permittivity": 2.0, "conductivity_s_per_m": 0.1, "roughness_m": 0.0}
    scene = yard(
        tmp_path,
        classes={**globs, "boulder": ("rock_*",)},
        new_classes=("boulder",),
        surfaces={"stone": "asphalt", "steel": values},
    )
    world = load_world(scene)
    model = world.model
    assert world.instance_names[1:] == (
        "floor", "hump", "wall_0", "tree_0", "pole_0", "ball_0", "rock_0", "leaf_0", "ghost_0"
    )  # fmt: skip
    names = [world.class_names[i] for i in world.geom_class]
    by_body = {model.body(model.geom_bodyid[i]).name: names[i] for i in range(model.ngeom)}
    assert by_body["wall_0"] == "building"
    assert by_body["tree_0"] == "tree"
    assert by_body["crown_0"] == "vegetation"  # named itself, in a body of another class
    assert by_body["rock_0"] == "boulder"
    assert by_body["ball_0"] == "object"
    assert names[:2] == ["road", "ground"]  # the floor is named, the height field is not
    crown, trunk = model.geom("trunk").id, int(model.body("crown_0").geomadr[0])
    assert world.geom_instance[crown] == world.geom_instance[trunk]
    assert world.class_names[-1] == "boulder"
    assert list(class_table(("boulder",)))[: len(CLASS_COLOURS)] == list(CLASS_COLOURS)
    surface = [world.surfaces[i] for i in world.geom_surface]
    assert surface[0] == SURFACES["asphalt"]
    assert surface[2].lidar_reflectivity == 0.9
    assert surface[3] == DEFAULT_SURFACE
    visible = {model.body(model.geom_bodyid[i]).name for i in np.flatnonzero(world.geom_visible)}
    assert "ghost_0" not in visible  # wholly transparent
    assert not world.geom_visible[model.geom_group == 4].any()
    assert world.geom_visible.sum() == model.ngeom - 2


def test_a_colour_next_to_the_default_grey_is_a_colour(tmp_path: Path) -> None:
    """As in MuJoCo: only exactly 0.5 0.5 0.5 1 gives way to the material, in what is visible and in what is drawn."""
    path = tmp_path / "greys.xml"
    path.write_text(
        '<mujoco><asset><material name="clear" rgba="1 0 0 0"/><material name="red" rgba="1 0 0 1"/></asset><worldbody>'
        '<geom size="1" material="clear"/><geom size="1" material="clear" rgba="0.500002 0.5 0.5 1"/>'
        '<geom size="1" pos="3 0 0" material="red" rgba="0.500002 0.5 0.5 1"/>'
        '<geom size="1" pos="6 0 0" material="red"/></worldbody></mujoco>'
    )
    plain = load_scene("airfield").model_dump()
    world = load_world(Scene.model_validate(plain | {"name": "greys", "map": {"mjcf": str(path)}}))
    assert world.geom_visible.tolist() == [False, True, True, True]
    geometry = FrameGeometry(world)
    renderer = FrameRenderer(geometry, CameraModel.from_fov(8, 8, 20.0))
    straight_down = (0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0)
    colours = []
    for x in (3.0, 6.0):
        out = renderer.buffers("rgb")
        renderer.render(CameraPose((x, 0.0, 4.0), straight_down), out)
        colours.append(out["rgb"][4, 4].astype(int))
    assert abs(colours[0][0] - colours[0][1]) < 40  # grey in the light of the sun and the sky
    assert colours[1][0] > colours[1][1] + 80


def test_the_last_glob_that_matches_counts(tmp_path: Path) -> None:
    world = load_world(yard(tmp_path, classes={"tree": ("*_0",), "wall": ("wall_0",)}))
    assert classes_of(world) | {"wall_0": "", "hump": "", "floor": ""} == {
        name: "" if name in ("wall_0", "hump", "floor") else "tree" for name in world.instance_names[1:]
    }
    assert classes_of(world)["wall_0"] == "wall"


def test_an_actor_is_one_instance(monkeypatch: pytest.MonkeyPatch) -> None:
    class Made:
        parameters = catalog.StrictModel

        @staticmethod
        def generate(_parameters: object, _seed: int) -> object:
            return yard_map(Pacer())

    monkeypatch.setitem(catalog.GENERATORS, "yard_with_person", Made)  # type: ignore[arg-type]
    scene = Scene.model_validate(load_scene("airfield").model_dump() | {"map": {"generator": "yard_with_person"}})
    world = load_world(scene)
    assert world.instance_names[-1] == "person_00"
    assert "person_00_head" not in world.instance_names
    assert classes_of(world)["person_00"] == "person"
    assert world.geom_actor.tolist() == [-1] * (world.model.ngeom - 2) + [0, 0]


def test_seed_of_the_map_comes_from_the_scene_or_the_bench() -> None:
    scene = Scene.model_validate(load_scene("airfield").model_dump() | {"map": {"generator": "radar_range", "seed": 2}})
    assert load_world(scene, map_seed=5).scene.map == scene.with_map_seed(5).map
    assert load_world(scene, map_seed=2).model is load_world(scene).model
    with pytest.raises(ConfigError, match="takes no seed"):
        load_world(load_scene("airfield"), map_seed=3)


FILES = {
    "mine.yaml": SCENE + "map: {mjcf: maps/main.xml, classes: {building: [house]}}\n",
    "maps/main.xml": '<mujoco><compiler meshdir="parts" texturedir="pictures"/><include file="more/assets.xml"/>'
    '<worldbody><geom name="floor" type="plane" size="0 0 1" material="chess"/>'
    '<include file="more/house.xml"/></worldbody></mujoco>',
    "maps/more/assets.xml": '<mujocoinclude><asset><mesh file="tetra.obj"/><texture name="t" type="2d" file="t.png"/>'
    '<material name="chess" texture="t"/></asset></mujocoinclude>',
    "maps/more/house.xml": '<x><body name="house" pos="9 0 1"><geom type="mesh" mesh="tetra"/></body></x>',
    "maps/parts/tetra.obj": TETRAHEDRON,
}


def user_scene(folder: Path) -> Path:
    """A scene in several files: includes, a mesh, a texture."""
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "maps/pictures").mkdir(exist_ok=True)
    assert cv2.imwrite(str(folder / "maps/pictures/t.png"), np.full((2, 2, 3), 200, np.uint8))
    return folder / "mine.yaml"


def test_a_file_with_includes_meshes_and_textures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = user_scene(tmp_path)
    monkeypatch.chdir("/")  # paths start at the scene's own file, not at the working directory
    world = load_world(load_scene(path))
    assert classes_of(world) == {"floor": "ground", "house": "building"}
    assert world.model.ntex == 1
    assert world.model.mesh(0).name == "tetra"  # the name that MuJoCo gives it, after its file


def test_an_mjcf_file_is_a_scene(tmp_path: Path) -> None:
    user_scene(tmp_path)
    scene = load_scene(tmp_path / "maps/main.xml")
    assert scene.name == "main"
    assert classes_of(load_world(scene)) == {"floor": "ground", "house": "object"}
    bench = load_bench(scene=str(tmp_path / "maps/main.xml"))
    assert bench.world.model is load_world(scene).model


def test_a_saved_bench_keeps_its_map(tmp_path: Path) -> None:
    """The folder of a run alone is enough to fly it again, bit for bit."""
    source = tmp_path / "source"
    bench = load_bench(scene=str(user_scene(source)))
    saved = save_bench(bench, tmp_path / "run")
    flown = []
    for folder in (source, None):
        if folder is None:
            for file in sorted(source.rglob("*"), reverse=True):
                file.rmdir() if file.is_dir() else file.unlink()
            bench = load_bench(saved)
        world = bench.world
        assert classes_of(world) == {"floor": "ground", "house": "building"}
        assert world.model.ntex == 1
        physics = VehiclePhysics(load_vehicle("x500"), bench.scene, 4_000_000, start=FlightStart(p_WB=(9.0, 0.0, 3.0)))
        flown.append([physics.advance(tick, (0.0,) * 4) for tick in range(200)])
    assert flown[0] == flown[1]
    assert any(s.in_contact for s in flown[0])


def test_every_generated_scene_reloads_from_its_run(tmp_path: Path) -> None:
    text = SCENE + "map: {generator: radar_range, seed: 3}\n"
    (tmp_path / "range.yaml").write_text(text)
    bench = load_bench(scene=str(tmp_path / "range.yaml"), settings=["map_seed=7"])
    again = load_bench(save_bench(bench, tmp_path / "run"))
    assert again.scene == bench.scene
    assert again.world.map.mjcf == bench.world.map.mjcf
    assert bench.scene.map == again.scene.map
    assert again.config.map_seed == 7


def test_boxes_and_ground_can_be_added_to_a_map(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><body name="a" pos="4 0 1"><geom size="1"/></body></worldbody></mujoco>'
    )
    path = tmp_path / "s.yaml"
    path.write_text(
        SCENE + "boxes: [{name: crate, center_m: [3, 3, 1], size_m: [1, 1, 1]}]\nmap: {mjcf: m.xml, ground: true}\n"
    )
    assert set(classes_of(load_world(load_scene(path)))) == {"ground", "crate", "a"}
    load_bench(scene=str(path))


def test_joints_of_a_map_stand_still(tmp_path: Path) -> None:
    """A door on a hinge is part of the building: the vehicle's joint stays the only one of the contact model."""
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/><body name="door" pos="3 0 1" quat="0 0 0 1">'
        '<joint axis="0 0 1"/><geom type="box" size="0.1 1 1" pos="0.5 0 0"/></body></worldbody></mujoco>'
    )
    scene = load_scene(tmp_path / "m.xml")
    physics = VehiclePhysics(load_vehicle("x500"), scene, 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 1.0)))
    physics.state[7] = 8.0
    states = [physics.advance(tick, (0.6,) * 4) for tick in range(150)]
    assert 2.0 < max(s.p_WB[0] for s in states) < 2.4  # the leaf is at x = 3 - 0.5, 0.1 m thick on each side
