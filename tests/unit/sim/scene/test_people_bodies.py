"""Bodies of people: closed meshes, limbs without gaps, true heights, one label, and contact as it was."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.view.points import looking_at, pose_of
from signals.units import TURN_RAD
from sim._kernels import resting_leg
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames, channel_array
from sim.scene.maps import wheelchair
from sim.scene.maps.clothes import BOTTOMS, TOPS, Colours, draw_look
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.models import model as shipped
from sim.scene.maps.people import PersonTraits, add_cyclist, add_still_person, add_walker, add_wheelchair_user
from sim.scene.maps.walk_path import WalkPath
from sim.scene.maps.walker import Roller, Walker
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene import load_scene
from sim.scene.scene_map import actor_pose
from sim.scene.world import World
from sim.world_loader import load_world
from tools.art.people.body_build import BUILDS
from tools.art.people.body_meshes import PARTS

WAY = WalkPath([(0.0, 0.0), (9.0, 0.0), (9.0, 5.0), (0.0, 5.0)], 1.2)


@pytest.mark.parametrize("build", [*BUILDS, "wheelchair"])
def test_meshes_are_closed_and_face_outwards(build: str) -> None:
    made = shipped(f"people/{build}")
    assert set(made.pieces) == ({"tyres", "frame", "seat"} if build == "wheelchair" else set(PARTS))
    for part in made.pieces:
        mesh = made.mesh(part)
        vertices = np.round(mesh.vertices.astype(np.float64), 6) + 0.0
        corner = np.unique(vertices, axis=0, return_inverse=True)[1].ravel()[mesh.triangles]
        edges = Counter((int(t[k]), int(t[(k + 1) % 3])) for t in corner for k in range(3))
        assert all(n == 1 and edges[b, a] == 1 for (a, b), n in edges.items()), part
        p, q, r = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
        assert np.einsum("ij,ij->", p, np.cross(q, r)) > 0.0, part


def seen(world: World, frames: SharedFrames, t_ns: int, azimuth_rad: float, up_rad: float) -> NDArray[np.uint16]:
    """Return the instances in a picture of the person of the radar range from 4 m."""
    camera = CameraModel.from_fov(300, 400, 36.0)
    (x, y, z), _ = world.map.actors[0].bound(t_ns)
    level = 4.0 * math.cos(up_rad)
    at = (x + level * math.cos(azimuth_rad), y + level * math.sin(azimuth_rad), z + 4.0 * math.sin(up_rad))
    frames.expect(t_ns)
    out = {name: channel_array(name, camera) for name in ("instance", "segmentation")}
    renderer = frames.renderer(camera, near_m=0.05, far_m=100.0, supersample=1, shadows=False)
    renderer.render(Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose(pose_of(looking_at("x", at, (x, y, z)))), out)
    is_person = out["segmentation"] == world.class_names.index("person")
    assert len(np.unique(out["instance"][is_person])) == 1
    return out["instance"] * is_person


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_walking_body_has_no_gaps(seed: int) -> None:
    world = load_world(load_scene("radar_walk_away"), map_seed=seed)
    frames = SharedFrames(world)
    for k in range(6):
        t_ns = 1_000_000_000 + k * 190_000_000
        for azimuth, up in ((0.0, 0.02), (0.25, 0.02), (0.5, 0.1), (0.8, 0.02), (0.1, 0.125)):
            mask = seen(world, frames, t_ns, azimuth * TURN_RAD, up * TURN_RAD) > 0
            parts, _, sizes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
            assert mask.sum() > 4000
            assert parts == 2, (k, azimuth, sorted(sizes[1:, 4]))


def built(height_m: float, seed: int) -> tuple[mujoco.MjModel, mujoco.MjData, Figure]:
    builder = MapBuilder("people")
    add_still_person(builder, RandomGenerator(seed, "p"), (0.0, 0.0, 0.0), 0.0, traits=PersonTraits(height_m=height_m))
    made = builder.build()
    model = mujoco.MjModel.from_xml_string(made.mjcf, dict(made.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data, Figure(height_m, child=height_m < 1.4)


def span(model: mujoco.MjModel, data: mujoco.MjData, words: tuple[str, ...]) -> tuple[float, float]:
    """Return the lowest and highest z of the drawn geoms whose names contain one of the words."""
    low, high = math.inf, -math.inf
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH).tolist():
        if any(word in model.geom(geom).name for word in words):
            mesh = model.geom_dataid[geom]
            begin = model.mesh_vertadr[mesh]
            points = model.mesh_vert[begin : begin + model.mesh_vertnum[mesh]]
            z = (points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])[:, 2]
            low, high = min(low, float(z.min())), max(high, float(z.max()))
    return low, high


@pytest.mark.parametrize("height_m", [1.12, 1.57, 1.74, 1.93])
def test_heights_are_those_of_the_figure(height_m: float) -> None:
    for seed in range(4):
        model, data, figure = built(height_m, seed)
        sole, _ = span(model, data, ("foot",))
        _, crown = span(model, data, ("head_head",))
        chin, _ = span(model, data, ("head_head",))
        knee = figure.ankle_m + figure.shank_m
        assert abs(sole) < 0.004
        assert crown == pytest.approx(0.994 * height_m, abs=0.025 * height_m)
        assert chin < 0.87 * height_m  # the neck reaches into the collar
        low, high = span(model, data, ("shank_l",))
        assert low < figure.ankle_m
        assert knee < high < knee + 0.06 * height_m


def test_a_child_has_a_larger_head_for_its_height() -> None:
    adult, child = BUILDS["m_mid"], BUILDS["child"]
    assert child.figure.leg_m < adult.figure.leg_m

    def head_m(build: str) -> float:
        return float(np.ptp(shipped(f"people/{build}").mesh("hair_short").vertices[:, 2]))

    assert head_m("child") > 1.15 * head_m("m_mid")


def test_contact_is_by_the_shapes_of_the_figure_alone() -> None:
    builder = MapBuilder("people")
    walker = add_walker(builder, RandomGenerator(1, "p"), WAY, traits=PersonTraits(height_m=1.7))
    made = builder.build()
    model = mujoco.MjModel.from_xml_string(made.mjcf, dict(made.assets))
    solid = model.geom_contype == 1
    assert (solid == (model.geom_group == 3)).all()
    assert (solid == (model.geom_type != mujoco.mjtGeom.mjGEOM_MESH)).all()
    limb = [model.body(int(model.geom_bodyid[g])).name for g in np.flatnonzero(solid)]
    shapes = sorted(Figure(1.7).shapes(), key=lambda shape: LIMBS.index(shape.limb))
    assert limb == [f"{walker.name}_{shape.limb}" for shape in shapes]
    for geom, shape in zip(np.flatnonzero(solid), shapes, strict=True):
        assert model.geom_size[geom][: len(shape.size)].tolist() == list(shape.size)


def test_clothes_draw_from_a_generator_of_their_own() -> None:
    """Five draws, as before there were clothes: the height and four colours."""
    for soldier in (False, True):
        rng, same = RandomGenerator(3, "p"), RandomGenerator(3, "p")
        walker = add_walker(MapBuilder("people"), rng, WAY, traits=PersonTraits(soldier=soldier))
        assert walker.figure.height_m == same.between(1.55, 1.93)
        for _ in range(4):
            same.unit()
        assert rng.unit() == same.unit()


SPECIAL = """name: s
description: d
site: {latitude_deg: 1, longitude_deg: 1, altitude_m: 1}
ground_friction: 0.8
map: {generator: %s, seed: 3, walkers: 0, children: 2, wheelchairs: 2}
"""


@pytest.mark.parametrize("generator", ["city_park", "urban_delivery"])
def test_children_walk_and_wheelchairs_roll(generator: str, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SPECIAL % generator)
    world = load_world(load_scene(tmp_path / "s.yaml"))
    actors = [actor for actor in world.map.actors if actor.name.startswith("person")]
    assert [type(actor) for actor in actors] == [Walker, Walker, Roller, Roller]
    assert all(1.0 < actor.figure.height_m < 1.41 for actor in actors[:2])
    step_ns = 2_000
    for roller in actors[2:]:
        for t_ns in range(1_000_000_000, 60_000_000_000, 1_765_432_100):
            p0, p1 = (actor_pose(roller, t_ns + side * step_ns)[0] for side in (-1, 1))
            p, _, v, _ = actor_pose(roller, t_ns)
            assert np.abs((p1 - p0) / (2e-9 * step_ns) - v).max() < 1e-5
            assert np.ptp(p[:3, 2]) > 0.4  # upright
    geoms = [world.model.geom(g) for g in range(world.model.ngeom)]
    of_one = [int(world.geom_instance[g.id]) for g in geoms if g.name.startswith(actors[2].name)]
    assert len(set(of_one)) == 1
    assert any("wheelchair_tyres" in g.name for g in geoms)


def test_a_grey_shirt_and_grey_trousers_have_materials_of_their_own() -> None:
    builder = MapBuilder("people")
    for k, colours in enumerate((Colours("grey", "black", "a", "dark"), Colours("black", "grey_dark", "a", "dark"))):
        for seed in range(8):
            draw_look(builder, RandomGenerator(seed, "p"), colours, name=f"p{k}{seed}")
    made = builder.build()
    model = mujoco.MjModel.from_xml_string(made.mjcf, dict(made.assets))
    for name, rgb in (("cloth_grey_plain", TOPS["grey"]), ("cloth_grey_dark_plain", BOTTOMS["grey_dark"])):
        assert model.mat(name).rgba[:3] == pytest.approx(rgb, abs=1e-6)


def test_all_looks_can_be_built() -> None:
    builder, rng = MapBuilder("people"), RandomGenerator(5, "p")
    for k in range(200):
        traits = PersonTraits(soldier=k % 5 == 0, height_m=1.2 if k % 7 == 0 else None)
        add_still_person(builder, rng, (float(k), 0.0, 0.0), 0.0, seat_m=0.45 * (k % 3 == 0), traits=traits)
    made = builder.build()
    parts = {name.split("_m_")[0].split("_f_")[0].split("_child")[0] for name in made.assets if name.endswith(".msh")}
    assert {name.removesuffix(".msh") for name in parts} == set(PARTS)


def test_a_bag_hangs_from_the_hand_that_carries_it() -> None:
    seen = 0
    for seed in range(120):
        model, data, _ = built(1.74, seed)
        low, high = span(model, data, ("shopping_bag",))
        if math.isfinite(high):
            seen += 1
            assert 0.1 < low < high < 0.5 * 1.74  # an arm that hangs ends there
    assert seen >= 5


@pytest.mark.parametrize("height_m", [0.9, 1.2, 1.41, 1.42, 1.95])
def test_feet_rest_on_the_footrests_of_a_wheelchair(height_m: float) -> None:
    builder = MapBuilder("people")
    traits = PersonTraits(height_m=height_m)
    roller = add_wheelchair_user(builder, RandomGenerator(1, "p"), WAY, traits=traits)
    p, q, _, _ = actor_pose(roller, 1_000_000_000)
    assert np.isfinite(p).all()
    assert np.isfinite(q).all()
    size = height_m / 1.75 if height_m < 1.42 else 1.0
    for foot in ("foot_l", "foot_r"):
        sole_m = p[LIMBS.index(foot), 2] - roller.figure.ankle_m
        assert sole_m == pytest.approx(size * wheelchair.FOOTREST_M, abs=0.003)


def test_a_leg_that_cannot_reach_is_refused() -> None:
    figure = Figure(1.0, child=True)
    with pytest.raises(ValueError, match="does not reach its foot"):
        resting_leg(figure.lengths_m, 0.05, 0.6, 0.4, 0.04)


def test_bound_holds_the_meshes() -> None:
    kinds = (add_walker, add_wheelchair_user, add_cyclist)
    for seed in range(18):
        builder = MapBuilder("people")
        height_m = {13: 1.0, 16: 1.2, 17: 1.2}.get(seed)
        kinds[seed % 3](builder, RandomGenerator(seed, "p"), WAY, traits=PersonTraits(height_m=height_m))
        made = builder.build()
        model = mujoco.MjModel.from_xml_string(made.mjcf, dict(made.assets))
        data = mujoco.MjData(model)
        for t_ns in range(0, 2_000_000_000, 230_000_000):
            begin = 0
            for actor in made.actors:
                n = len(actor.bodies)
                p, q, _, _ = actor_pose(actor, t_ns)
                data.mocap_pos[begin : begin + n], data.mocap_quat[begin : begin + n] = p, q
                begin += n
            mujoco.mj_kinematics(model, data)
            bounds = {body: actor.bound(t_ns) for actor in made.actors for body in actor.bodies}
            for geom in np.flatnonzero(model.geom_group < 3).tolist():
                mesh = model.geom_dataid[geom]
                points = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
                placed = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
                centre, radius = bounds[model.body(int(model.geom_bodyid[geom])).name]
                assert np.linalg.norm(placed - centre, axis=1).max() <= radius, model.geom(geom).name
