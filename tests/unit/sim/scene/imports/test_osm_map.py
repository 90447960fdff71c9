"""Maps from OpenStreetMap extracts: buildings, roofs, roads, classes, contact, and what is wrong with a file."""

from __future__ import annotations

import builtins
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from hil.apps.fly.choice import BenchChoice
from hil.config.scenes import read_scene, save_scene
from signals.errors import ConfigError
from sim.scene.imports import osm_file, osm_tags, shapes
from sim.scene.imports.osm_file import read_osm
from sim.scene.maps.imported.osm_map import take_off_place
from sim.scene.scene import load_scene
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.example_places import LATITUDE_DEG, LONGITUDE_DEG, _Extract, quarter_osm

pytest.importorskip("shapely")
from sim.scene.imports.roofs import make_roof

EXAMPLES = Path(__file__).parents[5] / "docs" / "examples" / "places"


def world_of(folder: Path, text: str, **section: Any) -> World:
    (folder / "place.osm").write_text(text, encoding="utf-8")
    keys = "".join(f", {key}: {value}" for key, value in section.items())
    (folder / "scene.yaml").write_text(
        f"name: place\ndescription: A place\nground_friction: 0.8\n"
        f"site: {{latitude_deg: {LATITUDE_DEG}, longitude_deg: {LONGITUDE_DEG}, altitude_m: 400.0}}\n"
        f"map: {{osm: place.osm{keys}}}\n"
    )
    return load_world(load_scene(folder / "scene.yaml"))


def problems_of(folder: Path, text: str | bytes, name: str = "place.osm") -> str:
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        load_world(load_scene(folder / name))
    return str(caught.value)


def geoms_of(world: World, class_name: str) -> list[int]:
    number = world.class_names.index(class_name)
    return np.flatnonzero(world.geom_class == number).tolist()


def extent(world: World, geoms: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest coordinates of meshes in W."""
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    points = []
    for geom in geoms:
        mesh = int(world.model.geom_dataid[geom])
        first, count = int(world.model.mesh_vertadr[mesh]), int(world.model.mesh_vertnum[mesh])
        vertices = world.model.mesh_vert[first : first + count]
        points.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    stacked = np.concatenate(points)
    return stacked.min(axis=0), stacked.max(axis=0)


def square(x: float, y: float, half_x: float, half_y: float) -> list[tuple[float, float]]:
    return [(x - half_x, y - half_y), (x + half_x, y - half_y), (x + half_x, y + half_y), (x - half_x, y + half_y)]


@pytest.mark.parametrize(
    ("tags", "top_m"),
    [
        ({"building": "yes", "height": "12.5"}, 12.5),
        ({"building": "yes", "height": "40 ft"}, 12.192),
        ({"building": "apartments", "building__levels": "4"}, 12.0),
        ({"building": "house", "building__levels": "2", "roof__shape": "flat"}, 6.0),
        ({"building": "house", "height": "9", "roof__shape": "gabled", "roof__height": "3"}, 9.0),
        ({"building": "house", "building__levels": "2", "roof__shape": "hipped", "roof__levels": "1"}, 9.0),
        ({"building": "warehouse"}, 8.0),
    ],
)
def test_heights(tags: dict[str, str], top_m: float, tmp_path: Path) -> None:
    out = _Extract()
    out.ring(square(30.0, 10.0, 8.0, 6.0), **tags)
    world = world_of(tmp_path, out.xml())
    kind = "house" if tags["building"] == "house" else "building"
    visible = [g for g in geoms_of(world, kind) if world.geom_visible[g]]
    low, high = extent(world, visible)
    assert low[2] == pytest.approx(0.0, abs=1e-3)
    assert high[2] == pytest.approx(top_m, abs=1e-2)
    solid_low, solid_high = extent(world, [g for g in geoms_of(world, kind) if world.model.geom_contype[g]])
    np.testing.assert_allclose(solid_high, high, atol=0.02)
    np.testing.assert_allclose(solid_low[:2], low[:2], atol=0.02)


def test_roofs_over_a_rectangle_have_their_known_volume() -> None:
    """Volumes between eaves and roof over 12 x 8 m, rise 3 m, in closed form."""
    rectangle = np.array([(-6.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-6.0, 4.0)])
    n = 400
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 12.0 - 6.0, (np.arange(n) + 0.5) / n * 8.0 - 4.0)
    points = np.stack([x.ravel(), y.ravel()], 1)
    expected = {
        "flat": 0.0,
        "gabled": 0.5 * 12 * 8 * 3,
        "skillion": 0.5 * 12 * 8 * 3,
        "pyramidal": 12 * 8 * 3 / 3,
        "hipped": 0.5 * 4 * 8 * 3 + 8 * 8 * 3 / 3,  # a prism of 4 m in the middle and the two ends of a pyramid
        "gambrel": 12 * (2 * (0.5 * 1.6 * 1.8) + 4.8 * 1.8 + 0.5 * 4.8 * 1.2),
    }
    for shape, volume in expected.items():
        roof = make_roof(shape, rectangle, 5.0, 3.0, across=False, slope=np.array([0.0, -1.0]))
        z = roof.height(points) - 5.0
        assert z.mean() * 96.0 == pytest.approx(volume, rel=2e-3, abs=1e-9), shape


def test_a_courtyard_is_open_and_walls_are_solid(tmp_path: Path) -> None:
    text = """<osm version="0.6">{}<way id="1">{}</way><way id="2">{}</way>
    <relation id="1"><member type="way" ref="1" role="outer"/><member type="way" ref="2" role="inner"/>
    <tag k="type" v="multipolygon"/><tag k="building" v="yes"/><tag k="height" v="10"/></relation></osm>"""
    places = [*square(30, 0, 20, 20), *square(30, 0, 10, 10)]
    nodes = "".join(
        f'<node id="{i + 1}" lat="{LATITUDE_DEG + y / 111_180.0:.8f}" lon="{LONGITUDE_DEG + x / 75_450.0:.8f}"/>'
        for i, (x, y) in enumerate(places)
    )
    rings = ["".join(f'<nd ref="{k}"/>' for k in ids) for ids in ((1, 2, 3, 4, 1), (5, 6, 7, 8, 5))]
    world = world_of(tmp_path, text.format(nodes, *rings))
    data = mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, data)
    for ray, wall_m in (((1, 0, 0), 10.0), ((-1, 0, 0), 10.0), ((0, 1, 0), 10.0), ((0, -1, 0), 10.0)):
        geom = np.full((1, 1), -1, np.int32)
        start, way = np.array([[30.0], [0.0], [3.0]]), np.array(ray, float).reshape(3, 1)
        groups = np.array([0, 0, 0, 1, 0, 0], np.uint8)
        assert mujoco.mj_ray(world.model, data, start, way, groups, 1, -1, geom) == pytest.approx(wall_m, abs=0.15)


def test_the_example_quarter(tmp_path: Path) -> None:
    scene, problems = read_scene(EXAMPLES / "quarter.yaml")
    assert scene is not None
    assert not problems
    world = load_world(scene)
    kinds = {world.class_names[k] for k in np.unique(world.geom_class)}
    assert {"house", "hall", "road", "sidewalk", "grass", "water", "tree", "hedge", "fence", "marking"} <= kinds
    assert (EXAMPLES / "quarter.osm").read_text() == quarter_osm()
    kept, _ = read_scene(tmp_path / save_scene(scene, EXAMPLES / "quarter.yaml", tmp_path))
    assert kept is not None
    again = load_world(kept)
    np.testing.assert_array_equal(world.model.mesh_vert, again.model.mesh_vert)
    np.testing.assert_array_equal(world.model.geom_pos, again.model.geom_pos)


_HASH = """
import hashlib, sys
from pathlib import Path
from sim.scene.budget import Budget
from sim.scene.maps.imported.osm_import import made
from sim.scene.scene import load_scene
scene = load_scene(sys.argv[1])
made_map = made({"osm": scene.file.folder / scene.map.osm}, scene.map, scene.site, Budget("map")).scene_map
state = hashlib.sha256(made_map.mjcf.encode())
for name in sorted(made_map.assets):
    state.update(made_map.assets[name])
print(state.hexdigest())
"""


def test_a_map_has_the_same_bytes_in_every_process() -> None:
    """GEOS keeps 0.0 or -0.0 by the addresses of its objects, which differ from process to process."""
    command = [sys.executable, "-c", _HASH, str(EXAMPLES / "quarter.yaml")]
    found = {
        subprocess.run(
            command, env={**os.environ, "PYTHONHASHSEED": str(seed)}, cwd=EXAMPLES.parents[2], check=True,
            capture_output=True, text=True,
        ).stdout
        for seed in range(6)
    }  # fmt: skip
    assert len(found) == 1


@pytest.mark.slow
def test_a_district_of_500_buildings_by_its_file_name(tmp_path: Path) -> None:
    (tmp_path / "district.osm").write_text(quarter_osm(10, 9))
    scene = load_scene(tmp_path / "district.osm")
    world = load_world(scene)
    bodies = [name for name in world.instance_names if name.startswith(("house_", "building_"))]
    assert len(bodies) >= 500
    assert abs(scene.site.latitude_deg - LATITUDE_DEG) < 2e-4


def test_road_width_and_rules_for_classes(tmp_path: Path) -> None:
    out = _Extract()
    out.way([(-50, 20), (50, 20)], highway="residential", lanes="3")
    out.way([(-50, 40), (50, 40)], highway="track", width="4.5", name="Lane")
    out.spot(0, -20, natural="tree", species="Tilia")
    world = world_of(tmp_path, out.xml(), classes='{terrain: ["highway=track"], bush: ["species=T*"]}')
    low, high = extent(world, geoms_of(world, "road"))
    assert high[1] - low[1] == pytest.approx(9.0, abs=0.02)
    low, high = extent(world, geoms_of(world, "terrain"))
    assert high[1] - low[1] == pytest.approx(4.5, abs=0.02)
    assert "tree_000" in {world.instance_names[world.geom_instance[g]] for g in geoms_of(world, "bush")}
    with pytest.raises(ConfigError, match="matches nothing in the map: 'building=church'"):
        world_of(tmp_path, out.xml(), classes='{hall: ["building=church"]}')


def test_repaired_and_dropped_shapes_are_counted(tmp_path: Path) -> None:
    out = _Extract()
    out.ring([(20, 0), (40, 20), (40, 0), (20, 20)], building="yes")  # a bow tie
    out.ring([(-30, 0), (-30, 0.0), (-20, 0), (-25, 0)], building="yes")  # no area
    out.way([(60, 0), (70, 0), (70, 10)], building="yes")  # not closed
    out.ring(square(0, 60, 5, 5), building="yes", height="tall", roof__shape="cross_gable")
    text = out.xml().replace('<way id="3">', '<way id="3"><nd ref="999"/>')
    notes = " / ".join(world_of(tmp_path, text).map.notes)
    for part in (
        "1 buildings have an outline that crosses itself and are repaired", "1 buildings have no size",
        "1 buildings have an outline that is not closed", "buildings state no height", "1 roofs have the nearest shape",
        "1 ways name nodes that the extract does not hold",
    ):  # fmt: skip
        assert part in notes


def test_water_at_the_take_off_place_is_told(tmp_path: Path) -> None:
    """Only the ground is solid, so that a vehicle stands in a lake; a lake beside it is nothing to tell."""
    for x, told in ((0.0, True), (30.0, False)):
        out = _Extract()
        out.ring(square(x, 0, 20, 20), natural="water")
        out.ring(square(0, 60, 5, 5), building="yes", height="6")
        assert any("water is at the take-off place" in note for note in world_of(tmp_path, out.xml()).map.notes) == told


ENTITIES = """<?xml version="1.0"?><!DOCTYPE osm [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<osm version="0.6"><node id="1" lat="1" lon="2"><tag k="name" v="&b;"/></node></osm>"""
BAD = {
    "empty": ("", "is empty"),
    "no node": ('<osm version="0.6"></osm>', "is empty: it holds no node"),
    "cut off": ('<osm version="0.6">\n<node id="1" lat="1" lon="2"/>\n<way', "place.osm:3: is not valid XML"),
    "other xml": ("<gpx></gpx>", "place.osm:1: is XML but not OpenStreetMap: it begins with <gpx>"),
    "entities": (ENTITIES, "has a document type declaration"),
    "external": (
        '<!DOCTYPE osm SYSTEM "file:///etc/passwd"><osm version="0.6"/>', "has a document type declaration"
    ),
    "not a number": ('<osm>\n<node id="1" lat="x" lon="2"/></osm>', "place.osm:2: holds a wrong value"),
    "off the earth": ('<osm><node id="1" lat="95" lon="2"/></osm>', "node 1 is not on Earth"),
    "nan": ('<osm><node id="1" lat="nan" lon="2"/></osm>', "node 1 is not on Earth"),
    "no id": ('<osm><node lat="1" lon="2"/></osm>', "an element has no attribute 'id'"),
    "nothing": (
        '<osm><node id="1" lat="1" lon="2"/><node id="2" lat="1" lon="2.001"/><way id="3"><nd ref="1"/></way></osm>',
        "holds nothing that a map shows: no building, way or area with its tags and nodes",
    ),
    "compressed": (b"\x1f\x8b\x08\x00\x00\x00", "is compressed (unpack it: gunzip or bunzip2)"),
    "binary": (b"\x00\x01\x02\x03", "is not valid XML"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files_have_named_errors(case: str, tmp_path: Path) -> None:
    text, message = BAD[case]
    assert message in problems_of(tmp_path, text)


def test_a_long_file_and_a_far_site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = _Extract()
    out.ring(square(0, 60, 5, 5), building="yes")
    monkeypatch.setattr(osm_file, "MAX_BYTES", 100)
    (tmp_path / "place.osm").write_text(out.xml())
    with pytest.raises(ConfigError, match="is longer than"):
        read_osm(tmp_path / "place.osm")
    monkeypatch.undo()
    text = out.xml().replace("47.39", "46.39")
    with pytest.raises(
        ConfigError, match=r"has nothing within 500 m of the site \(its middle is at latitude_deg: 46\.39"
    ):
        world_of(tmp_path, text)


@pytest.mark.parametrize("bounds", ["", '<bounds minlat="-16.9" minlon="-180" maxlat="-16.7" maxlon="180"/>'])
def test_an_extract_on_both_sides_of_the_date_line(bounds: str, tmp_path: Path) -> None:
    places = [(-16.8001, 179.9995), (-16.8001, -179.9999), (-16.7999, -179.9999), (-16.7999, 179.9995)]
    nodes = "".join(f'<node id="{i}" lat="{lat}" lon="{lon}"/>' for i, (lat, lon) in enumerate(places, 1))
    way = "".join(f'<nd ref="{i}"/>' for i in (1, 2, 3, 4, 1))
    path = tmp_path / "fiji.osm"
    path.write_text(f'<osm version="0.6">{bounds}{nodes}<way id="1">{way}<tag k="leisure" v="park"/></way></osm>')
    assert read_osm(path).middle() == pytest.approx((-16.8, 179.9998))
    scene = load_scene(path)
    assert scene.site.longitude_deg == pytest.approx(179.9998, abs=1e-4)
    low, high = extent(world := load_world(scene), geoms_of(world, "grass"))
    assert high[0] - low[0] == pytest.approx(0.0006 * 106_600.0, rel=0.05)


def test_pbf_with_and_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "place.osm.pbf").write_bytes(b"not a PBF file at all")
    original = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name == "osmium":
            raise ImportError(name)
        return original(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match="osmium, which reads these, is not installed"):
        read_osm(tmp_path / "place.osm.pbf")
    monkeypatch.undo()
    osmium = pytest.importorskip("osmium")
    with pytest.raises(ConfigError, match="cannot be read as OpenStreetMap PBF"):
        read_osm(tmp_path / "place.osm.pbf")
    (tmp_path / "quarter.osm").write_text(quarter_osm(2, 2))
    with osmium.SimpleWriter(str(tmp_path / "quarter.osm.pbf")) as writer:
        for item in osmium.FileProcessor(str(tmp_path / "quarter.osm")):
            writer.add(item)
    xml, pbf = read_osm(tmp_path / "quarter.osm"), read_osm(tmp_path / "quarter.osm.pbf")
    assert (xml.ways, xml.node_tags) == (pbf.ways, pbf.node_tags)
    assert xml.nodes.keys() == pbf.nodes.keys()
    np.testing.assert_allclose(list(xml.nodes.values()), list(pbf.nodes.values()), atol=1e-7)


@pytest.mark.parametrize(
    ("text", "value"),
    [("12", 12.0), ("12,5 m", 12.5), ("40'", 12.192), ("6'6\"", 1.9812), ("tall", None), ("-3", None), ("1e9", None)],
)
def test_lengths(text: str, value: float | None) -> None:
    found = osm_tags.length_m(text)
    assert found is None if value is None else found == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [("0", 0.0), ("330", 330.0), ("45°", 45.0), ("nw", 315.0), ("N", 0.0), ("361", None), ("up", None), (None, None)],
)
def test_directions(text: str | None, value: float | None) -> None:
    assert osm_tags.direction_deg(text) == value


def test_a_bench_faces_where_its_direction_says(tmp_path: Path) -> None:
    directions = {"0": (0.0, 1.0), "90": (1.0, 0.0), "330": (-0.5, 0.75**0.5)}
    out = _Extract()
    for i, text in enumerate(directions):
        out.spot(20.0 + 5.0 * i, 0.0, amenity="bench", direction=text)
    model = world_of(tmp_path, out.xml()).model
    for i, facing in enumerate(directions.values()):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body(f"bench_{i:03d}").quat)
        assert turn.reshape(3, 3)[:2, 1] == pytest.approx(facing, abs=1e-6)  # its y is where a sitting person looks


def test_a_road_of_every_known_surface_has_its_material(tmp_path: Path) -> None:
    text = quarter_osm(1, 1)
    road = '<tag k="highway" v="residential"/>'
    assert road in text
    for surface, material in osm_tags.SURFACES.items():
        paved = text.replace(road, f'{road}<tag k="surface" v="{surface}"/>')
        world = world_of(tmp_path, paved)
        assert f"osm_{material}" in {world.model.material(m).name for m in world.model.geom_matid if m >= 0}, surface


def test_without_shapely_the_error_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    importlib.import_module("sim.scene.maps.imported.osm_map")  # binds the true shapely, for the tests after this one
    monkeypatch.setattr(shapes, "shapely", None)
    (tmp_path / "place.osm").write_text(quarter_osm(2, 2))
    with pytest.raises(ConfigError, match=r'pip install "hil-bench\[scenes\]"'):
        take_off_place(read_osm(tmp_path / "place.osm"), 100.0)


def test_a_mission_elsewhere_on_earth_does_not_count(tmp_path: Path) -> None:
    (tmp_path / "place.osm").write_text(quarter_osm(2, 2))
    choice = BenchChoice(Path(__file__).parents[5] / "hil.yaml", scene=str(tmp_path / "place.osm"))
    assert choice.load().mission is None
