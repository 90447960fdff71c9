"""Maps: every generator, several seeds. What must hold is measured on the compiled model."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import types
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.scene import surfaces
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.figure import LIMBS
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.scene_map import SceneMap, actor_pose

NAMES = tuple(GENERATORS)
WALKED = ("city_park", "urban_delivery", "training_village", "radar_range")  # maps with people who move
SEEDS = (1, 2, 3)
EVERY_SEED = [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 4, 5))]
GEOM = mujoco.mjtObj.mjOBJ_GEOM
BODY = mujoco.mjtObj.mjOBJ_BODY


@cache
def made(name: str, seed: int) -> SceneMap:
    generator = GENERATORS[name]
    return generator.generate(generator.parameters(), seed)


@cache
def compiled(name: str, seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    scene_map = made(name, seed)
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def digest(scene_map: SceneMap) -> str:
    h = hashlib.blake2b(scene_map.mjcf.encode(), digest_size=16)
    for name, content in sorted(scene_map.assets.items()):
        h.update(name.encode() + content)
    h.update(repr((sorted(scene_map.classes.items()), sorted(scene_map.surfaces.items()))).encode())
    for actor in scene_map.actors:
        h.update(repr(actor.bodies).encode() + b"".join(a.tobytes() for a in actor_pose(actor, 12_345_678_901)))
    return h.hexdigest()


def owner(model: mujoco.MjModel, geom: int) -> str:
    """Name that classes go by: the world's child body that the geom belongs to, or the geom itself."""
    body = int(model.geom_bodyid[geom])
    if body == 0:
        return str(mujoco.mj_id2name(model, GEOM, geom))
    return str(mujoco.mj_id2name(model, BODY, int(model.body_rootid[body])))


def visible(model: mujoco.MjModel, geom: int) -> bool:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return bool(model.geom_group[geom] < 3 and rgba[3] > 0.0)


def world_box(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axis-aligned box round a geom's own (oriented) box."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    middle = data.geom_xpos[geom] + rotation @ centre
    reach = np.abs(rotation) @ half
    return middle - reach, middle + reach


@pytest.mark.parametrize("seed", EVERY_SEED)
@pytest.mark.parametrize("name", NAMES)
def test_compiles_and_is_finite(name: str, seed: int) -> None:
    model, _ = compiled(name, seed)
    scene_map = made(name, seed)
    assert "nan" not in scene_map.mjcf
    for array in (model.geom_pos, model.geom_quat, model.geom_size, model.mesh_vert, model.body_pos, model.body_quat):
        assert np.isfinite(array).all()
    assert (np.abs(model.body_pos) < {"landscape_mountains": 700.0, "airstrip": 1200.0}.get(name, 200.0)).all()


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_bytes_and_another_seed_another_map(name: str) -> None:
    generator = GENERATORS[name]
    again = generator.generate(generator.parameters(), SEEDS[0])
    assert digest(again) == digest(made(name, SEEDS[0]))
    assert len({made(name, seed).mjcf for seed in SEEDS}) == len(SEEDS)


def test_same_bytes_in_another_process() -> None:
    code = (
        "import sys; sys.path.insert(0, '.')\n"
        "from tests.unit.sim.scene import test_scene_maps as t\n"
        "print(' '.join(t.digest(t.made(name, 1)) for name in t.NAMES))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": "77"}
    )
    assert run.stdout.split() == [digest(made(name, 1)) for name in NAMES]


@pytest.mark.parametrize("seed", EVERY_SEED)
@pytest.mark.parametrize("name", NAMES)
def test_every_visible_geom_has_exactly_one_class_and_a_surface(name: str, seed: int) -> None:
    model, _ = compiled(name, seed)
    scene_map = made(name, seed)
    for geom in range(model.ngeom):
        if not visible(model, geom):  # drawn by a mesh
            assert (model.geom_group[geom], model.geom_contype[geom]) == (3, 1)
            continue
        named = owner(model, geom)
        classes = [c for c, globs in scene_map.classes.items() if any(fnmatchcase(named, g) for g in globs)]
        assert len(classes) == 1, (named, classes)
        material = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MATERIAL, int(model.geom_matid[geom]))
        surface = scene_map.surfaces[material]
        assert 0.0 < surface.lidar_reflectivity <= 1.0
        assert surface.relative_permittivity >= 1.0
        assert surface.conductivity_s_per_m >= 0.0
        assert 0.0 < surface.roughness_m < 0.1


@pytest.mark.parametrize("seed", EVERY_SEED)
@pytest.mark.parametrize("name", NAMES)
def test_actors_are_mocap_bodies_of_their_own(name: str, seed: int) -> None:
    model, _ = compiled(name, seed)
    scene_map = made(name, seed)
    bodies = [body for actor in scene_map.actors for body in actor.bodies]
    assert len(bodies) == len(set(bodies)) == model.nmocap
    assert len({actor.name for actor in scene_map.actors}) == len(scene_map.actors)
    for actor in scene_map.actors:
        p, q, _, _ = actor_pose(actor, 0)
        for i, body in enumerate(actor.bodies):
            assert body.startswith(f"{actor.name}_")
            number = mujoco.mj_name2id(model, BODY, body)
            assert model.body_mocapid[number] >= 0
            # The model's own pose is the one at t = 0.
            assert np.allclose(model.body_pos[number], p[i], atol=1e-12)
            assert np.allclose(model.body_quat[number], q[i], atol=1e-12)


def probe_hits(name: str, seed: int, places: list[tuple[float, float]], radius_m: float) -> set[str]:
    """Solid things that touch an upright cylinder of 0.1 to 30 m height at `places`."""
    scene_map = made(name, seed)
    probes = "".join(
        f'<body name="probe{i}" pos="{x} {y} 15.05"><freejoint/>'
        f'<geom name="probe{i}" type="cylinder" size="{radius_m} 14.95" mass="1" contype="2" conaffinity="1"/></body>'
        for i, (x, y) in enumerate(places)
    )
    text = scene_map.mjcf.replace("</worldbody>", probes + "</worldbody>")
    model = mujoco.MjModel.from_xml_string(text, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = {owner(model, int(g)) for contact in data.contact[: data.ncon] for g in contact.geom}
    return {n for n in names if not n.startswith(("probe", "person_"))}


@pytest.mark.parametrize("seed", EVERY_SEED)
@pytest.mark.parametrize("name", NAMES)
def test_takeoff_area_and_goal_are_free(name: str, seed: int) -> None:
    places = [(0.0, 0.0), (70.0, 60.0)] if name == "training_village" else [(0.0, 0.0)]
    assert probe_hits(name, seed, places, 4.0) == set()


@pytest.mark.parametrize("name", WALKED[:3])
def test_people_keep_off_the_takeoff_area(name: str) -> None:
    actors = made(name, 1).actors
    assert actors
    for actor in actors:
        for k in range(200):
            (x, y, _), _ = actor.bound(k * 400_000_000)
            assert (x * x + y * y) ** 0.5 > 4.0


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_village_leaves_corridors_between_tall_things_and_bars_the_straight_way(seed: int) -> None:
    model, data = compiled("training_village", seed)
    boxes: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    for geom in range(model.ngeom):
        # Drawn meshes lie on solid boxes; the box round a mesh is turned with its axes of inertia.
        if model.geom_bodyid[geom] == 0 or model.geom_contype[geom] == 0:
            continue
        low, high = world_box(model, data, geom)
        if high[2] < 9.8:
            continue
        name = owner(model, geom)
        # A tree's own box is wider than the tree; nothing else of the small things may be that high.
        assert name.startswith(("hall_", "tower_", "tree_")), name
        if not name.startswith("tree_"):
            assert high[2] <= 15.1
            old = boxes.get(name, (low, high))
            boxes[name] = np.minimum(old[0], low), np.maximum(old[1], high)
    assert len(boxes) >= 4
    names = sorted(boxes)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            gap = np.maximum(np.maximum(boxes[a][0] - boxes[b][1], boxes[b][0] - boxes[a][1])[:2], 0.0)
            assert np.hypot(*gap) >= 4.0, (a, b)
    start, way = np.array([0.0, 0.0, 10.0]), np.array([70.0, 60.0, 0.0])
    hit = np.zeros(1, dtype=np.int32)
    distance = mujoco.mj_ray(model, data, start, way / np.linalg.norm(way), None, 1, -1, hit)
    assert 0.0 < distance < np.linalg.norm(way)


def tessellated(model: mujoco.MjModel) -> int:
    """Triangles of MuJoCo's renderer at its default quality, counted low: plain boxes, tubes in one piece."""
    slices, stacks = int(model.vis.quality.numslices), int(model.vis.quality.numstacks)
    assert (slices, stacks) == (28, 16)
    ball = 2 * slices * (stacks - 1)
    each = {
        mujoco.mjtGeom.mjGEOM_PLANE: 2,
        mujoco.mjtGeom.mjGEOM_SPHERE: ball,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: ball,
        mujoco.mjtGeom.mjGEOM_CAPSULE: ball + 2 * slices,
        mujoco.mjtGeom.mjGEOM_CYLINDER: 4 * slices,
        mujoco.mjtGeom.mjGEOM_BOX: 12,
    }
    total = 0
    for geom in range(model.ngeom):
        kind = mujoco.mjtGeom(int(model.geom_type[geom]))
        data_id = int(model.geom_dataid[geom])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            total += int(model.mesh_facenum[data_id])
        elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
            total += 2 * int(model.hfield_nrow[data_id] - 1) * int(model.hfield_ncol[data_id] - 1)
        else:
            total += each[kind]
    return total


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_city_park_is_rich_and_not_padded(seed: int) -> None:
    model, _ = compiled("city_park", seed)
    assert tessellated(model) >= 100_000
    assert 250 <= np.count_nonzero(model.geom_group < 3) <= 700  # drawn
    assert 250 <= np.count_nonzero(model.geom_contype) <= 600  # solid
    assert model.ngeom <= 1200
    assert len(made("city_park", seed).actors) == 8
    kinds = [owner(model, g).rsplit("_", 1)[0] for g in range(model.ngeom)]
    for kind, at_least in (("tree", 50), ("bench", 12), ("lamp", 15), ("playground", 20), ("water", 4), ("hill", 1)):
        assert kinds.count(kind) >= at_least, kind


def height_below(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float, z: float) -> tuple[float, str]:
    """Return the height of the surface below a point, and its geom."""
    hit = np.zeros(1, dtype=np.int32)
    distance = mujoco.mj_ray(model, data, np.array([x, y, z]), np.array([0.0, 0.0, -1.0]), None, 1, -1, hit)
    return z - distance, owner(model, int(hit[0]))


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_paths_of_the_park_are_free(seed: int) -> None:
    model, data = compiled("city_park", seed)
    points = [
        tuple(model.mesh_vert[v] @ rotation.T + data.geom_xpos[g])
        for g in range(model.ngeom)
        if owner(model, g).startswith("path_") and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        for rotation in (data.geom_xmat[g].reshape(3, 3),)
        for v in range(model.mesh_vertadr[model.geom_dataid[g]], _vertices_end(model, g), 5)
    ]
    assert len(points) > 100
    for x, y, _ in points:
        z, name = height_below(model, data, float(x), float(y), 2.0)
        assert z < 0.06 or name.startswith(("person_", "pavement_", "water_")), (x, y, z, name)


def _vertices_end(model: mujoco.MjModel, geom: int) -> int:
    mesh = int(model.geom_dataid[geom])
    return int(model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])


@pytest.mark.parametrize("seed", EVERY_SEED)
@pytest.mark.parametrize("name", WALKED)
def test_nobody_walks_through_anything(name: str, seed: int) -> None:
    model, data = compiled(name, seed)
    # People out of the way: rays look at what stands.
    group = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    actors = made(name, seed).actors
    assert actors
    people = [g for g in range(model.ngeom) if owner(model, g).startswith("person_")]
    model.geom_group[people] = 1
    try:
        for actor in actors:
            for k in range(60):
                (x, y, z), _ = actor.bound(k * 1_370_000_000)
                for dx, dy in ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25)):
                    eye = np.array([x + dx, y + dy, z + 1.0])
                    hit = np.zeros(1, dtype=np.int32)
                    distance = mujoco.mj_ray(model, data, eye, np.array([0.0, 0.0, -1.0]), group, 1, -1, hit)
                    assert eye[2] - distance < 0.17, (actor.name, owner(model, int(hit[0])), x, y)
    finally:
        model.geom_group[people] = 0


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_doors_of_the_suburb_can_be_reached_and_zones_are_clear(seed: int) -> None:
    model, data = compiled("urban_delivery", seed)
    doors = zones = 0
    for geom in range(model.ngeom):
        name = str(mujoco.mj_id2name(model, GEOM, geom))
        if name.startswith("house_") and name.endswith("_door"):
            doors += 1
            out = data.geom_xmat[geom].reshape(3, 3)[:, 0]
            x, y, _ = data.geom_xpos[geom] + 0.9 * out
            z, below = height_below(model, data, float(x), float(y), 2.0)
            assert z < 0.2 or below.startswith("person_"), (name, z, below)
        if name.startswith("drop_zone_") and name.endswith("_field"):
            zones += 1
            size = model.geom_size[geom]
            rotation = data.geom_xmat[geom].reshape(3, 3)
            for u, v in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                corner = data.geom_xpos[geom] + rotation @ np.array([u * size[0], v * size[1], 0.0])
                z, below = height_below(model, data, float(corner[0]), float(corner[1]), 30.0)
                assert z < 0.2, (name, z, below)
    assert doors == 24
    assert zones == 8


SOLID = ("_proxy", "_solid", "_post", "_chimney", "_lid", "_slab")
LOOSE = ("_glass", "_paint", "_tyre", "_plumage", "_leaves", "_sleeve", "_mark", "_frames", "_lanes")


def test_solid_and_visual_geoms_are_told_apart() -> None:
    unmatched = {*SOLID, *LOOSE}
    for name in ("city_park", "urban_delivery", "training_village"):
        model, _ = compiled(name, 1)
        assert set(model.geom_contype.tolist()) == {0, 1}
        assert (model.geom_contype == model.geom_conaffinity).all()
        for geom in range(model.ngeom):
            named = str(mujoco.mj_id2name(model, GEOM, geom))
            for suffix in (*SOLID, *LOOSE):
                if named.endswith(suffix):
                    unmatched.discard(suffix)
                    assert model.geom_contype[geom] == (suffix in SOLID), named
    assert not unmatched


def test_builder_refuses_what_would_break_later() -> None:
    builder = MapBuilder("test")
    with pytest.raises(ValueError, match="no texture bark"):
        builder.material("bark", surfaces.BARK, texture="bark")
    builder.material("bark", surfaces.BARK)
    assert builder.material("bark", surfaces.BARK) == "bark"
    with pytest.raises(ValueError, match="two materials named bark"):
        builder.material("bark", surfaces.BARK, rgb=(0.4, 0.3, 0.2))
    with pytest.raises(ValueError, match="no material leaf"):
        builder.ground("plane", (0.0, 0.0, 1.0), material="leaf")
    builder.ground("plane", (0.0, 0.0, 1.0), material="bark", name="floor")
    with pytest.raises(ValueError, match="two geoms named floor"):
        builder.ground("plane", (0.0, 0.0, 1.0), material="bark", name="floor")
    builder.named_body("thing", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="two bodies named thing"):
        builder.named_body("thing", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def test_the_generator_in_the_docs_works() -> None:
    text = (Path(__file__).resolve().parents[4] / "docs" / "scenes.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    # Annotations of pydantic models are looked up in their module.
    module = types.ModuleType("avenue")
    sys.modules["avenue"] = module
    try:
        exec(compile(code, "docs/scenes.md", "exec"), module.__dict__)
        scene_map = module.generate(module.Parameters(trees=3), 4)
    finally:
        del sys.modules["avenue"]
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    assert model.nmocap == len(LIMBS)
    assert sum(str(mujoco.mj_id2name(model, BODY, i)).startswith("tree_") for i in range(model.nbody)) == 3


@pytest.mark.parametrize("name", NAMES)
def test_docs_list_every_parameter_and_class(name: str) -> None:
    text = (Path(__file__).resolve().parents[4] / "docs" / "scenes.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` | `"))
    for parameter in GENERATORS[name].parameters.model_fields:
        assert f"`{parameter}`" in row
    for seed in SEEDS:
        for class_name in made(name, seed).classes:
            assert f"`{class_name}`" in text, class_name
