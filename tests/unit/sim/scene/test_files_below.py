"""A map reads only the files of its own folder."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from sim.scene.files_below import file_below
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.worlds.one_crate import crate, error_of

SECRET = b"root:x:0:0:a file that no map may read\n" * 10


OUTSIDE = [
    "{secret}", "../secret.bin", "inside/../../secret.bin", "%2e%2e/secret.bin", "%2E%2E%2Fsecret.bin", "link.bin",
    "file://{secret}", "FILE:{secret}", "http://example.org/secret.bin", "..\\secret.bin", "C:\\secret.bin",
    "folder/secret.bin", "link.bin%00.png", "/proc/self/root{secret}",
]  # fmt: skip


def place_with_links(folder: Path) -> Path:
    """Return a folder of a map, beside a file that it may not read, with links to that file."""
    (folder / "secret.bin").write_bytes(SECRET)
    place = folder / "place"
    (place / "inside").mkdir(parents=True)
    (place / "link.bin").symlink_to("../secret.bin")
    (place / "folder").symlink_to("..")
    return place


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("part", ["buffers", "images"])
def test_a_gltf_file_names_only_files_of_its_folder(name: str, part: str, tmp_path: Path) -> None:
    place = place_with_links(tmp_path)
    file = crate()
    file.json[part] = [{"uri": name.format(secret=tmp_path / "secret.bin"), "byteLength": 100}]
    (place / "place.gltf").write_text(json.dumps(file.json))
    found = error_of(place / "place.gltf")
    assert f"{part}[0] " in found
    assert re.search("outside the map's folder|only files of the map's own folder|holds a backslash|cannot be", found)


@pytest.mark.parametrize("name", [name for name in OUTSIDE if "%" not in name])
@pytest.mark.parametrize(
    "text",
    [
        '<include file="{}"/>',
        '<asset><mesh name="m" file="{}"/></asset>',
        '<asset><texture type="2d" name="t" file="{}"/></asset>',
        '<asset><hfield name="h" size="1 1 1 1" file="{}"/></asset>',
        '<asset><model name="m" file="{}"/></asset>',
    ],
)
def test_an_mjcf_file_names_only_files_of_its_folder(name: str, text: str, tmp_path: Path) -> None:
    place = place_with_links(tmp_path)
    (place / "m.xml").write_text(f"<mujoco>\n{text.format(name.format(secret=tmp_path / 'secret.bin'))}</mujoco>")
    assert re.search(r"m\.xml:2: <\w+> names a file that (is|holds) ", error_of(place / "m.xml"))


def test_a_scene_file_above_its_map_holds_the_folder_of_all_files(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "more.xml").write_text('<x><worldbody><geom name="b" size="1" pos="9 0 1"/></worldbody></x>')
    (tmp_path / "xml").mkdir()
    (tmp_path / "xml" / "m.xml").write_text(
        '<mujoco><include file="../parts/more.xml"/><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>'
    )
    (tmp_path / "s.yaml").write_text(
        "name: s\ndescription: A map\nsite: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}\n"
        "ground_friction: 0.8\nmap: {mjcf: xml/m.xml}\n"
    )
    assert load_world(load_scene(tmp_path / "s.yaml")).model.ngeom == 2
    assert "outside the map's folder" in error_of(tmp_path / "xml" / "m.xml")


def test_a_file_below_a_folder_is_found(tmp_path: Path) -> None:
    place = place_with_links(tmp_path)
    (place / "inside" / "near.bin").symlink_to("../own.bin")
    for name in ("own.bin", "./own.bin", "inside/../own.bin", "inside/near.bin"):
        assert file_below(place, place, name) == (place / "own.bin").resolve()
