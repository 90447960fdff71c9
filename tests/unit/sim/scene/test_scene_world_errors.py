"""Errors in a scene are reported with file and line, by the check of a bench and by loading the scene alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from signals.errors import ConfigError, Problem
from sim.scene.map_file import read_map_file
from sim.scene.scene import load_scene
from sim.world_loader import load_world

HEAD = """name: mine
description: A scene of one's own
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
"""
MAP = HEAD + "map:\n  mjcf: m.xml\n"
MJCF = """<mujoco>
<asset>
<material name="stone"/>
</asset>
<worldbody>
<geom name="floor" type="plane" size="0 0 1" material="stone"/>
<body name="house_1" pos="5 0 0"><geom type="box" size="1 1 1"/></body>
{more}
</worldbody>
</mujoco>
"""


def problems_of(folder: Path, scene: str | bytes, mjcf: str | bytes | None = None) -> list[Problem]:
    """Return the problems of the bench's check, with the folder removed from the places."""
    for name, content in (("s.yaml", scene), ("m.xml", mjcf)):
        if content is not None:
            (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError) as caught:
        load_bench(scene=str(folder / "s.yaml"))
    return [Problem(p.where.removeprefix(f"{folder}/"), p.message, p.hint) for p in caught.value.problems]


SCENES = {
    "unknown generator": (HEAD + "map: {generator: city_prak}\n", 5, "map.generator is unknown", "'city_park'"),
    "no generator": (HEAD + "map: {seed: 1}\n", 5, "map.generator is missing", ""),
    "unknown parameter": (HEAD + "map:\n  generator: city_park\n  tres: 3\n", 7, "map.tres: unknown key", "'trees'"),
    "absurd parameter": (HEAD + "map:\n  generator: city_park\n  trees: -3\n", 7, "map.trees", ""),
    "parameter no number": (HEAD + "map:\n  generator: city_park\n  hill_m: .nan\n", 7, "map.hill_m", ""),
    "negative seed": (HEAD + "map:\n  generator: city_park\n  seed: -1\n", 7, "map.seed must be at least 0", ""),
    "two sources": (HEAD + "map: {generator: city_park, mjcf: m.xml}\n", 5, "both mjcf and generator", ""),
    "no mapping": (HEAD + "map: city_park\n", 5, "map must be a mapping", ""),
    "no such map": (HEAD + "map:\n  mjcf: n.xml\n", 6, "a file that does not exist: n.xml", "s.yaml"),
    "map is a folder": (HEAD + "map:\n  mjcf: .\n", 6, "a file that does not exist", ""),
    "unknown class": (MAP + "  classes:\n    bilding: [house_1]\n", 8, "bilding is not a class", "'building'"),
    "class of nothing": (MAP + "  classes: {none: [house_1]}\n", 7, "cannot be assigned", ""),
    "known new class": (MAP + "  new_classes: [tree]\n", 7, "exists already: 'tree'", ""),
    "idle glob": (
        MAP + '  classes:\n    building: ["house_*",\n      "hose_*"]\n',
        9, "matches nothing in the map: 'hose_*'", "house_1",
    ),
    "unknown surface": (MAP + "  surfaces:\n    stone: metl\n", 8, "an unknown surface: 'metl'", "'metal'"),
    "unknown material": (MAP + "  surfaces:\n    ston: metal\n", 8, "map.surfaces.ston is not a material", "'stone'"),
    "absurd surface": (
        MAP + "  surfaces:\n    stone: {lidar_reflectivity: 2, relative_permittivity: 1,"
        " conductivity_s_per_m: 0, roughness_m: 0}\n",
        8, "lidar_reflectivity must be at most 1", "",
    ),
    "absurd sun": (HEAD + "light:\n  sun_elevation_deg: 1000\n", 6, "must be at most 90 deg", ""),
    "negative light": (HEAD + "light:\n  sun_rgb: [1, -1, 1]\n", 6, "must be at least 0", ""),
    "no number of fog": (HEAD + "light:\n  fog_per_m: .inf\n", 6, "finite number", ""),
    "unknown light": (HEAD + "light:\n  sun_azimut_deg: 1\n", 6, "unknown key", "sun_azimuth_deg"),
    "box on the take-off place": (
        HEAD + "boxes: [{name: crate, center_m: [0, 0, 1], size_m: [2, 2, 2]}]\n", 5, "inside 'crate'", "move"
    ),
    "box named as a geom": (
        MAP + "boxes: [{name: floor, center_m: [9, 0, 1], size_m: [1, 1, 1]}]\n", None, "repeated", ""
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SCENES)
def test_wrong_scene_files(case: str, tmp_path: Path) -> None:
    text, line, message, hint = SCENES[case]
    (problem,) = problems_of(tmp_path, text, MJCF.replace("{more}", ""))
    if line is not None:
        assert problem.where == f"s.yaml:{line}"
    assert message in problem.message
    assert hint in problem.hint


def test_an_empty_scene(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, "# nothing\n")
    assert (problem.where, problem.message) == ("s.yaml", "is empty")


ASSET = "</worldbody><asset>\n<{}/></asset><worldbody>"
MAPS = {
    "empty": ("", None, "is empty"),
    "cut off": ("<mujoco>\n<worldbody>\n", 3, "not valid XML"),
    "binary": (b"\x00\xff\x00", 1, "not valid XML"),
    "unknown encoding": ('<?xml version="1.0" encoding="foo"?><mujoco/>', 1, "unknown encoding"),
    "urdf": ("<robot/>", 1, "URDF"),
    "html": ("\n<html></html>", 2, "begins with <html>"),
    "endless entities": (
        "<!DOCTYPE m [<!ENTITY a '" + "a" * 100 + "'>"
        + "".join(f"<!ENTITY {b} '{f'&{a};' * 100}'>" for a, b in zip("abcde", "bcdef", strict=True))
        + "]><mujoco model='&f;'/>",
        1, "declares the entity 'a'",
    ),
    "missing mesh": ('<asset><mesh name="a" file="no.obj"/></asset>', 8, "names a file that does not exist: no.obj"),
    "missing texture": ('<asset><texture type="2d" file="no.png"/></asset>', 8, "<texture> names a file"),
    "missing side": ('<asset><texture type="cube" fileleft="no.png"/></asset>', 8, "<texture> names a file"),
    "missing include": ('<include file="no.xml"/>', 8, "<include> names a file that does not exist: no.xml"),
    "includes itself": ('<include file="m.xml"/>', 8, "includes this file itself"),
    "missing sub-model": ('<asset><model file="no.xml"/></asset>', 8, "<model> names a file that does not exist"),
    "sub-model of itself": ('<asset><model file="m.xml"/></asset>', 8, "which contains this file"),
    "mesh of nonsense": (ASSET.format('mesh file="bad.obj"'), 9, "MuJoCo cannot compile this map"),
    "mesh of no kind": (ASSET.format('mesh file="m.xml"'), 9, "no decoder found for mesh file 'm.xml'"),
    "texture of nonsense": (ASSET.format('texture name="t" type="2d" file="bad.png"'), 9, "PNG"),
    "a vehicle": ('<body>\n<body name="vehicle"/></body>', 9, "a body named 'vehicle'"),
    "a free joint": ('<body>\n<freejoint/><geom size="1"/></body>', 9, "free joint"),
    "a free joint by type": ('<body>\n<joint type="free"/><geom size="1"/></body>', 9, "free joint"),
    "no number": ('<geom size="1"\n pos="1 nan 2"/>', 8, "<geom> pos must hold finite numbers"),
    "infinite": ('<geom size="inf"/>', 8, "<geom> size must hold finite numbers"),
    "out of this world": ('<geom size="1" pos="1e30 0 0"/>', 8, "goes beyond 100000 m"),
    "wrong keyword": ('<geom type="boxx"/>', 8, "invalid keyword: 'boxx'"),
    "wrong size": ('<body pos="9 9 9">\n\n<geom type="box" size="1 1"/></body>', 10, "size 2 must be positive"),
    "wrong element": ("<goem/>", 8, "Schema violation"),
    "name taken": ('<geom name="floor" size="1" pos="9 9 9"/>', 8, "repeated name 'floor'"),
    "bends": ('<flexcomp name="f" type="grid" count="3 3 1"/>', 8, "bends by itself"),
    "too deep": ("<body>" * 300 + "</body>" * 300, 8, "nested too deeply"),
}  # fmt: skip


@pytest.mark.parametrize("case", MAPS)
def test_wrong_maps(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content, line, message = MAPS[case]
    if isinstance(content, str) and line is not None and line >= 8:
        content = MJCF.replace("{more}", content)
    (tmp_path / "bad.obj").write_text("v 0 0\nhello\n")
    (tmp_path / "bad.png").write_bytes(b"no picture")
    monkeypatch.chdir(tmp_path)
    (problem,) = problems_of(tmp_path, MAP, content)
    assert problem.where == ("m.xml" if line is None else f"m.xml:{line}")
    assert message in problem.message
    assert "0000_" not in problem.message  # the name that the file has inside
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_errors_in_an_included_file_name_that_file(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text('<x>\n<body name="b">\n<geom type="box" size="1 1"/></body></x>')
    (problem,) = problems_of(tmp_path, MAP, MJCF.replace("{more}", '<include file="more.xml"/>'))
    assert problem.where == "more.xml:3"


def test_every_missing_file_is_told_at_once(tmp_path: Path) -> None:
    more = '<asset><mesh file="a.obj"/>\n<mesh file="b.obj"/></asset>\n<include file="c.xml"/>'
    found = problems_of(tmp_path, MAP, MJCF.replace("{more}", more))
    assert sorted(p.where for p in found) == ["m.xml:10", "m.xml:8", "m.xml:9"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ('<geom name="rock" size="1"/>', "inside 'rock'"),
        ('<body name="shed"><geom type="box" size="3 3 3"/></body>', "inside 'shed'"),
        ('<body name="lid" pos="0 0 0.25"><geom type="cylinder" size="1 0.05"/></body>', "inside 'lid'"),
    ],
)
def test_the_take_off_place_must_be_free(more: str, message: str, tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, MAP, MJCF.replace("{more}", more))
    assert problem.where == "s.yaml:5"
    assert message in problem.message


@pytest.mark.parametrize("floor", ['type="plane" size="0 0 1" pos="0 0 -0.2"', 'type="box" size="1 1 1" pos="9 9 9"'])
def test_the_take_off_place_must_be_on_the_ground(floor: str, tmp_path: Path) -> None:
    text = MJCF.replace("{more}", "").replace('type="plane" size="0 0 1"', floor)
    (problem,) = problems_of(tmp_path, MAP, text)
    assert "no ground to take off from" in problem.message
    assert "map.ground" in problem.hint
    (tmp_path / "s.yaml").write_text(MAP + "  ground: true\n")
    if "plane" not in floor:
        text = text.replace('name="floor"', 'name="slab"')
        (tmp_path / "m.xml").write_text(text)
        load_bench(scene=str(tmp_path / "s.yaml"))


def test_a_bench_without_a_vehicle() -> None:
    with pytest.raises(ConfigError, match=r"vehicle: is unknown: 'x501'.*x500"):
        load_bench(settings=["vehicle=x501"])
    with pytest.raises(ConfigError, match="vehicle: must be text, not null"):
        load_bench(settings=["vehicle=null"])


def test_a_seed_for_a_map_that_takes_none() -> None:
    with pytest.raises(ConfigError, match="map_seed: has no meaning"):
        load_bench(settings=["map_seed=3"])
    assert load_bench(settings=["map_seed=null"]).config.map_seed is None


def test_a_scene_loaded_alone_tells_the_same(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(MAP + "  classes:\n    bilding: [house_1]\n")
    (tmp_path / "m.xml").write_text(MJCF.replace("{more}", ""))
    with pytest.raises(ConfigError, match=r"s\.yaml:8: map\.classes\.bilding is not a class"):
        load_world(load_scene(path))
    path.write_text(HEAD + "light:\n  fog_per_m: 3\n")
    with pytest.raises(ConfigError, match=r"s\.yaml:6: light\.fog_per_m"):
        load_scene(path)


def test_a_map_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "m.xml"
    path.write_text(MJCF.replace("{more}", ""))
    monkeypatch.setattr("sim.scene.map_file.MAX_XML_BYTES", 10)
    with pytest.raises(ConfigError, match="longer than"):
        read_map_file(path)
