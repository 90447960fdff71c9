"""Trees: solid shapes where they always were, leaf cards round them, seasons, and what rays meet in a crown."""

from __future__ import annotations

import hashlib
from functools import cache

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from sim.frame.geometry import FrameGeometry
from sim.scene.maps import textures
from sim.scene.maps.city_park import Parameters, generate
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.plants import add_tree, plant_materials
from sim.scene.maps.plants.species import SPECIES
from sim.scene.maps.season import Season
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene import load_scene
from sim.scene.scene_map import SceneMap
from sim.scene.world import World
from sim.world_loader import load_world
from tools.art.plants.cards import FORMS, bough

SEASONS: tuple[Season, ...] = ("spring", "summer", "autumn", "winter")
# Digest of type, size and pose (rounded to 1e-6) of the solid shapes of all trees of city_park, seed 1: those of the
# trees that were drawn as ellipsoids and cones, on which missions were measured.
SOLID_TREES = "dba5a5595120bd36"


@cache
def park() -> World:
    return load_world(load_scene("city_park"))


@cache
def park_in(season: Season) -> SceneMap:
    return generate(Parameters(season=season), 1)


def posed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def row_of_trees(count: int, season: Season) -> SceneMap:
    builder = MapBuilder("row")
    plant_materials(builder, season)
    rng = RandomGenerator(3, "row")
    for i in range(count):
        add_tree(builder, rng, 10.0 * i, 0.0)
    return builder.build()


def leaf_colour(scene_map: SceneMap, species: str) -> tuple[float, float, float]:
    """Return mean red and green of a species' leaves, and the share of opaque texels."""
    png = np.frombuffer(scene_map.assets[f"leaves_{species}.png"], np.uint8)
    texels = cv2.imdecode(png, cv2.IMREAD_UNCHANGED)
    opaque = texels[:, :, 3] >= 128
    _, green, red, _ = texels[opaque].mean(axis=0)
    return float(red), float(green), float(opaque.mean())


def test_trunks_and_crowns_are_solid_where_they_were() -> None:
    model = park().model
    data, lines = posed(model), []
    for geom in np.flatnonzero(model.geom_contype).tolist():
        body = model.body(model.geom_bodyid[geom]).name
        if not body.startswith("tree"):
            continue
        is_mesh = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH
        size = model.geom_aabb[geom, 3:] if is_mesh else model.geom_size[geom]
        pose = [*data.geom_xpos[geom], *np.abs(data.geom_xmat[geom])]
        lines.append(repr((body, int(model.geom_type[geom]), *np.round([*size, *pose], 6).tolist())))
        assert model.geom_group[geom] == 3
    assert hashlib.blake2b("\n".join(sorted(lines)).encode(), digest_size=8).hexdigest() == SOLID_TREES


@pytest.mark.parametrize("season", SEASONS)
@pytest.mark.parametrize("name", [name for name in SPECIES if name != "hedge"])
def test_textures_have_their_share_of_holes(name: str, season: Season) -> None:
    low, high = (0.45, 0.75) if SPECIES[name].leaves(season) else (0.15, 0.35)
    png = np.frombuffer(textures.png(f"leaves_{name}_{season}"), np.uint8)
    texels = cv2.imdecode(png, cv2.IMREAD_UNCHANGED)
    assert texels is not None
    assert low < (texels[:, :, 3] > 0).mean() < high


@pytest.mark.parametrize("form", FORMS)
def test_cards_are_shaded_as_a_volume_and_stay_near_the_solid_crown(form: str) -> None:
    for variant in (0, 1):
        mesh, skeleton = bough(form, variant, 0.0)
        vertices, normals = np.array(mesh.vertices), np.array(mesh.normals)
        axes = np.array(FORMS[form].axes)
        outward = vertices / axes**2
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        assert np.einsum("ni,ni->n", normals, outward).mean() > 0.9
        reach = np.linalg.norm(vertices / axes, axis=1)
        assert reach.max() < 1.6
        assert 0.9 < np.median(reach) < 1.1
        assert all(0 <= above < node for node, above in enumerate(skeleton.parent) if node)
        below = np.zeros(len(skeleton.nodes))
        for node, above in enumerate(skeleton.parent):
            if node:
                below[above] += skeleton.radius[node] ** 2
        inner = below > 0.0
        section = np.array(skeleton.radius) ** 2
        assert (below[inner] <= section[inner] * (1.0 + 1e-9)).all()


def test_rays_into_crowns_end_where_double_precision_ends_them_and_partly_inside() -> None:
    world = park()
    model, data = world.model, posed(world.model)
    geometry = FrameGeometry(world)
    crowns = [g for g in range(model.ngeom) if model.geom(g).name.endswith(("crown_solid", "crown_solid_0"))]
    inside = total = 0
    for geom in crowns[::3]:
        middle, radius = data.geom_xpos[geom], model.geom_rbound[geom]
        origin = middle + np.array([14.0, 5.0, 3.0])
        rng = np.random.default_rng(geom)
        d = middle + 0.6 * radius * rng.uniform(-1.0, 1.0, (400, 3)) - origin
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        ranges, geoms = np.empty(len(d)), np.empty(len(d), np.int32)
        geometry.caster.cast(origin[None], np.ascontiguousarray(d), 0.0, 200.0, ranges, geoms)
        exact_geom, exact_m, _ = cast(model, data, origin, d)
        # The reference takes the nearest triangle, which is ambiguous where two cards cross.
        same = (geoms == exact_geom) & ((geoms < 0) | (np.abs(ranges - exact_m) < 1e-4))
        assert same.mean() >= 0.995
        tree = model.geom_bodyid[np.maximum(exact_geom, 0)] == model.geom_bodyid[geom]
        first = entry_m(model, data, int(model.geom_bodyid[geom]), origin, d)
        known = np.isfinite(first) & tree
        inside += int((exact_m[known] > first[known] + 0.3).sum())
        total += int(known.sum())
    assert 0.15 < inside / total < 0.75


def entry_m(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, origin: NDArray[np.float64], d: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where each ray enters the solid ellipsoids of a tree; infinity for none."""
    first = np.full(len(d), np.inf)
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_contype == 1)).tolist():
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            continue
        into = data.geom_xmat[geom].reshape(3, 3) / model.geom_size[geom]
        o, v = (origin - data.geom_xpos[geom]) @ into, d @ into
        a, b, c = (v * v).sum(axis=1), v @ o, o @ o - 1.0
        root = b * b - a * c
        hit = root > 0.0
        first[hit] = np.minimum(first[hit], (-b[hit] - np.sqrt(root[hit])) / a[hit])
    return first


@pytest.mark.parametrize("season", SEASONS)
def test_a_season_changes_looks_but_neither_places_nor_solid_shapes(season: Season) -> None:
    other = park_in(season)
    again = generate(Parameters(season=season), 1)
    assert (again.mjcf, again.assets) == (other.mjcf, other.assets)
    red, green, opaque = leaf_colour(other, "maple")
    assert (red > green) == (season in ("autumn", "winter"))  # in winter twigs are left
    in_summer = leaf_colour(park_in("summer"), "maple")
    assert (green > 1.1 * in_summer[1]) == (season == "spring")
    assert (opaque < 0.6 * in_summer[2]) == (season == "winter")
    model = mujoco.MjModel.from_xml_string(other.mjcf, dict(other.assets))
    summer = park().model
    mine, theirs = model.geom_contype == 1, summer.geom_contype == 1
    assert np.array_equal(model.geom_size[mine], summer.geom_size[theirs])
    assert np.array_equal(model.geom_pos[mine], summer.geom_pos[theirs])


def test_trees_share_their_meshes_and_are_small() -> None:
    scene_map = row_of_trees(200, "summer")
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    triangles = np.zeros(model.nbody)
    for geom in np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.geom_group < 3)).tolist():
        triangles[model.geom_bodyid[geom]] += model.mesh_facenum[model.geom_dataid[geom]]
    assert triangles[1:].max() < 1500
    assert np.median(triangles[1:]) < 300
    leaves = {name for name in scene_map.assets if name.endswith(".obj") and "trunk" not in name}
    assert len(leaves) < 60


def test_a_mesh_with_normals_keeps_them_in_the_model() -> None:
    scene_map = row_of_trees(12, "summer")
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    leaves = [geom for geom in range(model.ngeom) if model.geom(geom).name.endswith("_leaves_0")]
    assert leaves
    for geom in leaves:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_normaladr[mesh]), int(model.mesh_normalnum[mesh])
        corner = model.mesh_facenormal[model.mesh_faceadr[mesh] : model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]]
        # The corners of a card have different normals.
        normals = model.mesh_normal[first : first + count][corner]
        assert (np.abs(normals[:, 0] - normals[:, 1]).max(axis=1) > 0.05).mean() > 0.9
