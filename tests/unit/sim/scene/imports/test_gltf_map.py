"""Maps from glTF files: geometry, look, classes, contact, and what is wrong with a file."""

from __future__ import annotations

import contextlib
import json
import random
import re
import struct
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from hil.config.scenes import read_scene, save_scene
from signals.errors import ConfigError
from sim.frame.meshes import mesh_triangles
from sim.scene.imports import gltf_file
from sim.scene.maps.imported import gltf_map, gltf_materials
from sim.scene.maps.imported.gltf_materials import srgb_of
from sim.scene.scene import Scene, load_scene
from sim.scene.surfaces import SURFACES
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.example_places import yard_glb
from tests.worlds.glb_file import GlbFile, box

EXAMPLES = Path(__file__).parents[5] / "docs" / "examples" / "places"


def world_triangles(world: World) -> np.ndarray:
    """Return the visible triangles of meshes in W, (n, 3, 3)."""
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    found = []
    for geom in np.flatnonzero(world.geom_visible & (world.model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)).tolist():
        mesh = mesh_triangles(world.model, int(world.model.geom_dataid[geom]))
        points = mesh.vertex @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        found.append(points[mesh.triangle])
    return np.concatenate(found)


def area(corners: np.ndarray) -> float:
    return float(
        0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    )


def small_file() -> GlbFile:
    file = GlbFile()
    vertex, triangle, uv = box((-1, 0, -1), (1, 2, 1))
    mesh = file.mesh("crate mesh", (vertex, triangle, file.material("wood", (0.5, 0.25, 0.1, 1.0)), uv))
    file.node("crate", mesh, translation=[10, 0, -5])
    return file


def scene_of(folder: Path, data: bytes, name: str = "place.glb") -> Scene:
    (folder / name).write_bytes(data)
    return load_scene(folder / name)


def problems_of(folder: Path, data: bytes, name: str = "place.glb") -> str:
    with pytest.raises(ConfigError) as caught:
        load_world(scene_of(folder, data, name))
    return str(caught.value)


def test_geometry_is_that_of_another_reader(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "yard.glb").write_bytes(yard_glb())
    ours = world_triangles(load_world(load_scene(tmp_path / "yard.glb")))
    theirs = np.asarray(trimesh.load(tmp_path / "yard.glb", force="scene").to_mesh().triangles)
    theirs = np.stack([theirs[:, :, 0], -theirs[:, :, 2], theirs[:, :, 1]], axis=-1)  # z up
    assert len(ours) == len(theirs)
    assert area(ours) == pytest.approx(area(theirs), rel=1e-6)
    order = [np.lexsort(np.round(c.mean(axis=1), 3).T) for c in (ours, theirs)]
    np.testing.assert_allclose(ours.mean(axis=1)[order[0]], theirs.mean(axis=1)[order[1]], atol=2e-3)


def test_scale_turn_and_take_off_place(tmp_path: Path) -> None:
    (tmp_path / "place.glb").write_bytes(small_file().glb())
    (tmp_path / "scene.yaml").write_text(
        "name: place\ndescription: A crate\nsite: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}\n"
        "ground_friction: 0.8\n"
        "map: {gltf: place.glb, scale: 0.5, yaw_deg: 90, origin_m: [1, 2, 0], classes: {crate: [wood]}, ground: true}\n"
    )
    world = load_world(load_scene(tmp_path / "scene.yaml"))
    corners = world_triangles(world).reshape(-1, 3)
    # glTF (10, 0, -5) is 10 east, 5 north; halved (5, 2.5); turned by 90 degrees (-2.5, 5); less the origin.
    np.testing.assert_allclose(corners.min(axis=0), (-2.5 - 0.5 - 1.0, 5.0 - 0.5 - 2.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), (-2.5 + 0.5 - 1.0, 5.0 + 0.5 - 2.0, 1.0), atol=1e-6)
    assert world.class_names[world.geom_class[world.geom_visible][-1]] == "crate"
    assert "ground" in world.instance_names


def test_textures_masks_and_colours_of_vertices(tmp_path: Path) -> None:
    file = small_file()
    image = np.full((8, 8, 4), 255, np.uint8)
    image[:4, :, 3] = 0
    vertex, triangle, uv = box((0, 0, 0), (1, 1, 0.1))
    net = file.material("net", texture=file.image(image), alphaMode="MASK")
    glass = file.material("pane", (0.2, 0.3, 0.4, 0.02), alphaMode="BLEND")
    file.node("net", file.mesh("net", (vertex, triangle, net, uv)))
    file.node("pane", file.mesh("pane", (vertex, triangle, glass, uv)))
    colours = file.mesh("painted", (vertex, triangle, None, None))
    shades = np.repeat(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 12, axis=0).astype("f4")
    file.json["meshes"][colours]["primitives"][0]["attributes"]["COLOR_0"] = file.accessor(shades)
    file.node("painted", colours)
    world = load_world(scene_of(tmp_path, file.glb()))
    model = world.model
    names = [model.geom(g).name for g in np.flatnonzero(world.geom_visible)]
    assert [name for name in names if name.startswith("pane")] == []  # not to be seen at all
    assert model.tex_nchannel.tolist().count(4) == 1
    painted = [g for g in np.flatnonzero(world.geom_visible) if model.geom(g).name.startswith("painted")]
    assert {tuple(model.mat_rgba[model.geom_matid[g]][:3].round(2).tolist()) for g in painted} == {(1, 0, 0), (0, 0, 1)}
    assert world.surfaces[world.geom_surface[painted[0]]].relative_permittivity > 1.0


def test_materials_named_like_those_of_the_bench_keep_their_look(tmp_path: Path) -> None:
    for name in ("contact", "ground"):
        file = small_file()
        file.json["materials"][0]["name"] = name
        model = load_world(scene_of(tmp_path, file.glb())).model
        assert model.mat(f"{name}_").rgba[:3] == pytest.approx(srgb_of(np.array([0.5, 0.25, 0.1])), abs=1e-6)


def test_surfaces_follow_from_whole_words_of_a_material(tmp_path: Path) -> None:
    expected = {
        "Street_01": "concrete", "carpet": "concrete", "skinny pole": "concrete", "tree.bark": "foliage",
        "RoofTiles2": "roof_tile", "OLD-BRICKS": "brick", "treeLeaves": "foliage", "sandstone": "stone",
    }  # fmt: skip
    file = GlbFile()
    for k, name in enumerate(expected):
        vertex, triangle, uv = box((-1, 0, -1), (1, 2, 1))
        mesh = file.mesh(f"mesh {k}", (vertex, triangle, file.material(name, (0.5, 0.25, 0.1, 1.0)), uv))
        file.node(f"crate{k}", mesh, translation=[10 * k, 0, -5])
        file.json["materials"][k]["pbrMetallicRoughness"]["metallicFactor"] = 0.0
    world = load_world(scene_of(tmp_path, file.glb()))
    crates = {world.model.geom(g).name[:6]: int(g) for g in np.flatnonzero(world.geom_visible)}
    for k, (name, surface) in enumerate(expected.items()):
        assert world.surfaces[world.geom_surface[crates[f"crate{k}"]]] == SURFACES[surface], name


def test_instances_share_a_mesh_and_mirrors_face_outwards(tmp_path: Path) -> None:
    file = small_file()
    file.node("mirror", 0, scale=[-1, 1, 1], translation=[0, 0, 5])
    file.json["nodes"][0]["extensions"] = {
        "EXT_mesh_gpu_instancing": {
            "attributes": {"TRANSLATION": file.accessor(np.array([[0, 0, 0], [4, 0, 0], [8, 0, 0]], "f4"))}
        }
    }
    world = load_world(scene_of(tmp_path, file.glb()))
    visible = np.flatnonzero(world.geom_visible & (world.model.geom_type == mujoco.mjtGeom.mjGEOM_MESH))
    assert len(visible) == 4
    assert len(set(world.model.geom_dataid[visible].tolist())) == 2
    for corners in np.split(world_triangles(world), 4):
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outwards = corners.mean(axis=1) - corners.reshape(-1, 3).mean(axis=0)
        assert (np.einsum("ij,ij->i", normal, outwards) > 0.0).all()


def test_what_is_seen_is_what_is_solid() -> None:
    """Rays from free places in the yard meet solid things where they meet visible ones."""
    world = load_world(load_scene(EXAMPLES / "yard.yaml"))
    model = world.model
    solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    model.geom_group[:] = np.where(
        solid & world.geom_visible, 1, np.where(solid, 2, np.where(world.geom_visible, 0, 5))
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rng = np.random.default_rng(3)
    differences = []
    for start in ((0, 0, 2), (18, -8, 1.5), (0, 6, 6), (18, -20, 3)):  # the second is in the courtyard
        for _ in range(150):
            ray = rng.normal(size=3) * (1, 1, 0.4)
            ray /= np.linalg.norm(ray)
            hits = []
            for groups in ([1, 1, 0, 0, 0, 0], [0, 1, 1, 0, 0, 0]):
                geom = np.full((1, 1), -1, np.int32)
                place = np.array(start, float).reshape(3, 1)
                hits.append(
                    mujoco.mj_ray(model, data, place, ray.reshape(3, 1), np.array(groups, np.uint8), 1, -1, geom)
                )
            if min(hits) >= 0.0:
                differences.append(hits[1] - hits[0])
    differences = np.array(differences)
    assert len(differences) > 350
    # A net is solid, but rays pass through it in the picture: mj_ray knows no holes. Grazing rays differ more.
    assert np.quantile(np.abs(differences), 0.97) < 0.2
    assert differences.max() < 0.5


def test_a_run_keeps_the_place(tmp_path: Path) -> None:
    source = EXAMPLES / "yard.yaml"
    scene, _ = read_scene(source)
    assert scene is not None
    folder = tmp_path / "run"
    folder.mkdir()
    kept, problems = read_scene(folder / save_scene(scene, source, folder))
    assert not problems
    assert kept is not None
    first, second = load_world(scene), load_world(kept)
    assert first.class_names == second.class_names
    np.testing.assert_array_equal(first.model.mesh_vert, second.model.mesh_vert)


def test_the_shipped_example_is_made_by_its_program(tmp_path: Path) -> None:
    (tmp_path / "yard.glb").write_bytes(yard_glb())
    (tmp_path / "yard.yaml").write_text((EXAMPLES / "yard.yaml").read_text())
    shipped, made = (load_world(load_scene(folder / "yard.yaml")) for folder in (EXAMPLES, tmp_path))
    assert shipped.instance_names == made.instance_names
    assert shipped.class_names == made.class_names
    for name in ("geom_class", "geom_instance", "geom_visible"):
        np.testing.assert_array_equal(getattr(shipped, name), getattr(made, name))
    assert len({int(k) for k in shipped.geom_class}) >= 4
    ours, theirs = world_triangles(shipped), world_triangles(made)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)
    assert np.ptp(ours.reshape(-1, 3), axis=0) == pytest.approx((120.0, 120.0, 9.0), abs=4.0)
    for name in ("mesh_texcoord", "mat_rgba", "tex_data"):
        np.testing.assert_array_equal(getattr(shipped.model, name), getattr(made.model, name))


def changed(**changes: object) -> bytes:
    file = small_file()
    for key, value in changes.items():
        place = file.json
        *path, last = key.split("__")
        for word in path:
            place = place[int(word) if word.isdigit() else word]  # type: ignore[index]
        place[int(last) if last.isdigit() else last] = value  # type: ignore[index]
    return file.glb()


def nan_file() -> bytes:
    file = small_file()
    struct.pack_into("<f", file.body, 0, float("nan"))
    return file.glb()


GOOD = small_file().glb()
PRIMITIVE = "meshes__0__primitives__0"
BAD = {
    "empty": (b"", "is empty"),
    "cut off": (GOOD[:200], "is cut off: its header says"),
    "head only": (GOOD[:15], "is cut off: a GLB file has at least 20 bytes"),
    "version 1": (b"glTF" + struct.pack("<II", 1, len(GOOD)) + GOOD[12:], "is glTF 1; version 2 is read"),
    "no json": (struct.pack("<IIIII", 0x46546C67, 2, 20, 0, 0x004E4942), "has no JSON chunk"),
    "json": (b'{"asset": {"version": "2.0"},\n "nodes": [}', "place.glb:2: is not valid JSON"),
    "json nan": (b'{"asset": {"version": "2.0"}, "x": NaN}', "NaN is not a number of JSON"),
    "other json": (b'{"type": "FeatureCollection"}', "is JSON but not glTF"),
    "wrong type": (changed(nodes__0__translation=["a", 0, 0]), "nodes[0].translation[0]"),
    "draco": (changed(extensionsRequired=["KHR_draco_mesh_compression"]), "needs KHR_draco_mesh_compression"),
    "meshopt": (changed(extensionsRequired=["EXT_meshopt_compression"]), "gltf-transform copy"),
    "draco not marked": (
        changed(**{f"{PRIMITIVE}__extensions": {"KHR_draco_mesh_compression": {}}, "accessors__0__bufferView": None}),
        "meshes[0].primitives[0] needs KHR_draco_mesh_compression",
    ),
    "no such mesh": (changed(nodes__0__mesh=7), "nodes[0] names meshes[7]"),
    "no such accessor": (changed(**{f"{PRIMITIVE}__indices": 99}), "accessors[99], which does not exist"),
    "no such buffer": (changed(bufferViews__0__buffer=5), "bufferViews[0] names buffers[5], which does not exist"),
    "no such material": (changed(**{f"{PRIMITIVE}__material": 9}), "materials[9]"),
    "circle": (changed(nodes__0__children=[0]), "nodes[0] is below itself"),
    "huge buffer": (changed(bufferViews__0__byteLength=5_000_000_000), "ends at byte 5000000000"),
    "huge accessor": (changed(accessors__0__count=2_000_000_000), "GB of memory with the values of accessors[0] to"),
    "too many values": (changed(accessors__0__count=4000), "accessors[0] needs 48000 bytes"),
    "nan": (nan_file(), "meshes[0].primitives[0].POSITION has 1 values that are not finite numbers"),
    "indices": (changed(accessors__0__count=4), "for 4 vertices"),
    "nothing": (changed(scenes=[{"nodes": []}]), "shows no mesh"),
    "far away": (changed(nodes__0__translation=[1e9, 0, 0]), "goes beyond 50 km"),
    "no such image": (
        changed(materials__0__pbrMetallicRoughness={"baseColorTexture": {"index": 0}}), "names textures[0]"
    ),
    "missing file": (
        changed(images=[{"uri": "brick.png"}]), "images[0] names a file that does not exist"
    ),
    "web address": (changed(images=[{"uri": "https://example.org/a.png"}]), "only files of the map's own folder"),
    "bad image": (
        changed(
            images=[{"uri": "data:image/png;base64,iVBORw0KGgo="}], textures=[{"source": 0}],
            materials__0__pbrMetallicRoughness={"baseColorTexture": {"index": 0}},
        ),
        "images[0] cannot be decoded",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files_have_named_errors(case: str, tmp_path: Path) -> None:
    data, message = BAD[case]
    found = problems_of(tmp_path, data)
    assert message in found
    assert "place.glb" in found


def test_a_buffer_beside_the_file_that_is_missing_or_short(tmp_path: Path) -> None:
    text = json.dumps({**small_file().json, "buffers": [{"uri": "body.bin", "byteLength": 2000}]}).encode()
    assert "buffers[0] names a file that does not exist" in problems_of(tmp_path, text, "place.gltf")
    (tmp_path / "body.bin").write_bytes(b"\0" * 100)
    assert "buffers[0] has 100 bytes instead of 2000" in problems_of(tmp_path, text, "place.gltf")


@pytest.mark.parametrize(("suffix", "kind"), [(".png", "png"), (".jpg", "jpeg"), (".webp", "webp")])
def test_images_beside_the_file_keep_their_kind_when_packed(suffix: str, kind: str, tmp_path: Path) -> None:
    file = small_file()
    (tmp_path / f"red{suffix}").write_bytes(
        cv2.imencode(suffix, np.full((8, 8, 3), (0, 0, 255), np.uint8))[1].tobytes()
    )
    file.json |= {"images": [{"uri": f"red{suffix}"}], "textures": [{"source": 0}]}
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    (tmp_path / "place.glb").write_bytes(file.glb())
    packed = gltf_file.read_gltf(tmp_path / "place.glb").packed()
    (tmp_path / "packed.glb").write_bytes(packed)
    again = gltf_file.read_gltf(tmp_path / "packed.glb")
    assert again.raw["images"][0]["mimeType"] == f"image/{kind}"
    assert np.abs(gltf_materials.decoded(again, 0).reshape(-1, 3).mean(axis=0) - (0, 0, 255)).max() < 3


def test_sizes_are_limited_before_anything_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HIL_MAP_MEMORY_GB", "1e-6")
    assert "memory with the file itself; 1e-06 GB of memory are allowed" in problems_of(tmp_path, GOOD)
    monkeypatch.undo()
    monkeypatch.setenv("HIL_MAP_MEGAPIXELS", "10e-6")
    file = small_file()
    texture = file.image(np.zeros((8, 8, 3), np.uint8))
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
    assert "needs 6.4e-05 megapixels of pictures with images[0]" in problems_of(tmp_path, file.glb())


def test_triangles_without_an_area_are_left_out_with_a_note(tmp_path: Path) -> None:
    file = small_file()
    vertex = np.array([(0, 0, 0), (1, 0, 0), (0, 0, -1), (2, 0, 0)], float)
    file.node("flat", file.mesh("flat", (vertex, np.array([(0, 1, 2), (0, 1, 3), (1, 1, 2)]), None, None)))
    world = load_world(scene_of(tmp_path, file.glb()))
    assert world.map.notes == ("2 triangles without an area are left out",)


@pytest.mark.parametrize(("edge", "noted"), [(2.0, True), (200.0, False), (20_000.0, True)])
def test_a_file_in_another_unit_is_noted_by_its_size(tmp_path: Path, edge: float, noted: bool) -> None:
    file = GlbFile()
    vertex, triangle, _ = box((0.0, 0.0, 0.0), (edge, 0.5 * edge, edge))
    file.node("crate", file.mesh("crate", (vertex, triangle, file.material("wood"), None)))
    size = f"the map is {edge:.6g} m by {edge:.6g} m, {0.5 * edge:.6g} m high"
    told = (f"{size}: set map.scale if the file is not in metres",) if noted else ()
    assert load_world(scene_of(tmp_path, file.glb())).map.notes == told


def test_patterns_without_effect_are_reported(tmp_path: Path) -> None:
    (tmp_path / "place.glb").write_bytes(small_file().glb())
    (tmp_path / "scene.yaml").write_text(
        "name: place\ndescription: A crate\nsite: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}\n"
        "ground_friction: 0.8\nmap:\n  gltf: place.glb\n  classes: {crate: [crat]}\n  surfaces: {woood: wood}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_world(load_scene(tmp_path / "scene.yaml"))
    assert "scene.yaml:7" in str(caught.value)
    assert "did you mean 'crate'?" in str(caught.value)
    assert "did you mean 'wood'?" in str(caught.value)


def test_damaged_files_raise_nothing_but_named_errors(tmp_path: Path) -> None:
    rng = random.Random(5)
    for _ in range(300):
        data = bytearray(GOOD)
        if rng.random() < 0.7:
            for _ in range(rng.choice((1, 3, 10))):
                data[rng.randrange(len(data))] = rng.randrange(256)
        else:
            numbers = list(re.finditer(rb"\d+", bytes(data[20:1200])))
            found = rng.choice(numbers)
            value = rng.choice((b"-1", b"9e99", b'"x"', b"[]"))[: found.end() - found.start()]
            data[20 + found.start() : 20 + found.end()] = value.rjust(found.end() - found.start())
        (tmp_path / "place.glb").write_bytes(data)
        with contextlib.suppress(ConfigError):
            gltf_map.map_of_gltf(gltf_file.read_gltf(tmp_path / "place.glb"), gltf_map.GltfOptions())


@pytest.mark.parametrize(
    ("grown", "moved", "section", "hint"),
    [
        (1e7, (0.0, 0.0, 0.0), "scale: 0.0001", "set map.scale: 0.0001"),
        (1.0, (60e3, 3.0, 70e3), "origin_m: [60000.0, -70000.0, 2.5]", "set map.origin_m: [60000.0, -70000.0, 2.5]"),
        (1.0, (1e6, 0.0, 5e6), "", "move the model to the origin of its file"),
    ],
)
def test_the_remedy_for_a_model_out_of_reach_works(
    grown: float, moved: tuple[float, ...], section: str, hint: str, tmp_path: Path
) -> None:
    file = GlbFile()
    vertex, triangle, _ = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    file.node("far", file.mesh("far", (grown * vertex + np.array(moved), triangle, None, None)))
    (tmp_path / "place.glb").write_bytes(file.glb())
    with pytest.raises(ConfigError, match=re.escape(hint)):
        load_world(load_scene(tmp_path / "place.glb"))
    if section:
        (tmp_path / "scene.yaml").write_text(
            "name: place\ndescription: A place\nground_friction: 0.8\n"
            "site: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}\n"
            f"map: {{gltf: place.glb, {section}}}\n"
        )
        load_world(load_scene(tmp_path / "scene.yaml"))
