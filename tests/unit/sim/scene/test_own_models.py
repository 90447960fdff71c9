"""A user's own file beside a shipped model is used instead of it."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from signals.errors import ConfigError
from signals.rotation import NO_TURN
from sim.scene import surfaces
from sim.scene.maps import asset_files, models, textures
from sim.scene.maps.city_park import Parameters, generate
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.vehicles.kinds import add_parts
from sim.scene.maps.vehicles.traffic import CarSize
from sim.scene.scene import load_scene
from sim.world_loader import load_world

# Lower body of 3.0 x 1.2 x 0.8 m in the car's paint, cabin of 1.5 x 1.0 x 0.6 m on it; glTF's y is up.
LOWER = ((-1.5, 0.0, -0.6), (1.5, 0.8, 0.6))
CABIN = ((-0.75, 0.8, -0.5), (0.75, 1.4, 0.5))
FACES = [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]


def car(*, extras: dict[str, Any] | None = None, contact: bool = False) -> bytes:
    body, views, accessors, meshes, nodes = b"", [], [], [], []
    for name, (low, high), material in (("body", LOWER, 0), ("cabin", CABIN, 1), ("contact_low", LOWER, 0)):
        if name.startswith("contact") and not contact:
            continue
        points = np.array([[(low, high)[k >> i & 1][i] for i in range(3)] for k in range(8)], "<f4")
        for data, kind, code in ((points, "VEC3", 5126), (np.array(FACES, "<u2"), "SCALAR", 5123)):
            views.append({"buffer": 0, "byteOffset": len(body), "byteLength": data.nbytes})
            accessors.append({"bufferView": len(views) - 1, "componentType": code, "count": len(data), "type": kind})
            body += data.tobytes()
        attributes = {"POSITION": len(accessors) - 2}
        primitive = {"attributes": attributes, "indices": len(accessors) - 1, "material": material}
        nodes.append({"name": name, "mesh": len(meshes)})
        meshes.append({"primitives": [primitive]})
    lime = {"baseColorFactor": [0.214, 1.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": list(range(len(nodes))), "extras": extras or {}}],
        "nodes": nodes, "meshes": meshes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
        "materials": [{"name": "paint"}, {"name": "Lime", "pbrMetallicRoughness": lime}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(body), 0x004E4942) + body
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


@pytest.fixture
def assets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Give a folder with the shipped files, to which a test may add its own."""
    for path in asset_files.ASSETS.rglob("*"):
        target = tmp_path / path.relative_to(asset_files.ASSETS)
        if path.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(path)
    monkeypatch.setattr(asset_files, "ASSETS", tmp_path)
    models.model.cache_clear()
    textures.png.cache_clear()
    yield tmp_path
    models.model.cache_clear()
    textures.png.cache_clear()


def shown(name: str) -> mujoco.MjModel:
    builder = MapBuilder("stage")
    builder.material("floor", surfaces.ASPHALT)
    add_parts(builder, builder.named_body("car", (0.0, 0.0, 0.0), NO_TURN), models.model(name), "red", 0)
    built = builder.build()
    return mujoco.MjModel.from_xml_string(built.mjcf, dict(built.assets))


def extent_m(model: mujoco.MjModel, group: int) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ends = []
    for geom in np.flatnonzero(model.geom_group == group).tolist():
        mesh = model.geom_dataid[geom]
        points = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        ends.append(points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    points = np.concatenate(ends)
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_a_car_beside_ours_is_drawn_and_solid_instead_of_it(assets: Path) -> None:
    (assets / "models/vehicles/sedan_a.own.glb").write_bytes(car())
    own, shipped = shown("vehicles/sedan_a"), shown("vehicles/sedan_b")
    assert np.allclose(extent_m(own, 0), [[-1.5, -0.6, 0.0], [1.5, 0.6, 1.4]], atol=1e-6)
    assert np.allclose(extent_m(own, 3), extent_m(own, 0), atol=1e-6)
    assert extent_m(shipped, 0)[1, 0] > 2.0
    # The paint is that of the map; the other material is that of the file.
    colours = {own.mat(own.geom_matid[geom]).name: own.mat_rgba[own.geom_matid[geom], :3] for geom in (0, 1)}
    assert colours.keys() == {"paint_coat_red", "vehicles_sedan_a_Lime"}
    assert colours["vehicles_sedan_a_Lime"] == pytest.approx((0.5, 1.0, 0.0), abs=2e-3)


def test_contact_is_by_nodes_of_that_name(assets: Path) -> None:
    (assets / "models/vehicles/sedan_a.own.glb").write_bytes(car(contact=True))
    own = shown("vehicles/sedan_a")
    assert extent_m(own, 0)[1, 2] == pytest.approx(1.4)
    assert extent_m(own, 3)[1, 2] == pytest.approx(0.8)


def test_maps_take_it_and_a_texture(assets: Path) -> None:
    before = generate(Parameters(cars=12), 1)
    for end in ("a", "b", "a_driver", "b_driver"):
        for kind in ("sedan", "hatchback", "estate", "suv"):
            (assets / f"models/vehicles/{kind}_{end}.own.glb").write_bytes(car())
    (assets / "textures/grass.own.png").write_bytes((assets / "textures/gravel.png").read_bytes())
    models.model.cache_clear()
    textures.png.cache_clear()
    after = generate(Parameters(cars=12), 1)
    cars = [name for name in after.assets if name.startswith(("sedan", "hatchback", "estate", "suv"))]
    assert cars
    assert {name.rpartition("_")[2] for name in cars if "hull" not in name} == {"paint.msh", "Lime.msh"}
    assert after.classes == before.classes
    notes = load_world(load_scene("city_park"), map_seed=77).map.notes
    assert "sim/scene/assets/textures/grass.own.png replaces the shipped file of its name" in notes
    assert after.assets["grass.png"] == before.assets["gravel.png"]


def test_a_broken_file_is_named(assets: Path) -> None:
    (assets / "models/vehicles/sedan_a.own.glb").write_bytes(car()[:300])
    with pytest.raises(ConfigError, match=r"sedan_a\.own\.glb.*is cut off"):
        models.model("vehicles/sedan_a")


def test_a_car_that_drives_needs_wheels(assets: Path) -> None:
    (assets / "models/vehicles/suv_driven.own.glb").write_bytes(car(extras={"wheel_m": 0.3}))
    with pytest.raises(ConfigError, match=r"suv_driven\.own\.glb.*lacks nodes wheel_left and wheel_right"):
        CarSize.of(models.model("vehicles/suv_driven"))


@pytest.mark.parametrize(
    ("name", "extras", "message"),
    [
        ("vehicles/bus", {"contact": [{"kind": "box", "size": [1.0], "pos": [0, 0, 0]}]}, "is not a list of boxes"),
        ("vehicles/bus", {"contact": 5}, "is not a list of boxes"),
        ("people/m_mid", {}, "lacks nodes that people/m_mid.glb has: thigh, shank"),
        ("vehicles/bicycle_ridden", {}, "lacks nodes .*: frame, saddle"),
    ],
)
def test_what_a_map_needs_is_asked_for(assets: Path, name: str, extras: dict[str, Any], message: str) -> None:
    (assets / f"models/{name}.own.glb").write_bytes(car(extras=extras))
    with pytest.raises(ConfigError, match=message):
        models.model(name)


def test_a_copy_of_ours_is_ours(assets: Path) -> None:
    """Also through the reader of users' files, which turns and checks what it reads."""
    for name in ("vehicles/van_a", "people/f_slim", "plants/whole_1", "objects/dog"):
        ours = models.model(name)
        shipped = assets / f"models/{name}.glb"
        shipped.with_suffix(".own.glb").write_bytes(shipped.read_bytes())
        models.model.cache_clear()
        own = models.model(name)
        assert own.is_own
        for piece in ours.pieces:
            a, b = ours.mesh(piece), own.mesh(piece)
            assert np.array_equal(a.vertices, b.vertices)
            assert np.array_equal(a.uvs, b.uvs)
