"""Maps that ask for too much memory or time are refused by name, before anything is allocated."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from signals.errors import ConfigError
from sim.scene.budget import map_limits
from sim.scene.imports.osm_file import MAX_WAY_NODES, read_osm
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.worlds.one_crate import crate, error_of


def zeros(accessors: int, count: int) -> bytes:
    """Return a glTF file whose accessors have values without any data: 36 bytes of memory for each of `count`."""
    meshes = [{"primitives": [{"attributes": {"POSITION": i}}]} for i in range(accessors)]
    values = [{"componentType": 5126, "count": count, "type": "VEC3"}] * accessors
    nodes = [{"mesh": i} for i in range(accessors)]
    scenes = [{"nodes": list(range(accessors))}]
    data = {"asset": {"version": "2.0"}, "scenes": scenes, "nodes": nodes, "meshes": meshes, "accessors": values}
    return json.dumps(data).encode()


def instances(nodes: int, each: int) -> bytes:
    file = crate()
    place = file.accessor(np.zeros((each, 3), "f4"))
    node = {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": place}}}}
    file.json |= {"nodes": [node] * nodes, "scenes": [{"nodes": list(range(nodes))}]}
    return file.glb()


def png_head(width: int, height: int) -> bytes:
    """Return a PNG of 16 bits whose head states a size, without the pixels."""
    head = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def with_picture(picture: bytes) -> bytes:
    file = crate()
    file.json["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(picture).decode()}]
    file.json["textures"] = [{"source": 0}]
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    return file.glb()


def many_objects(text: str) -> bytes:
    return b'{"asset": {"version": "2.0"}, "nodes": [' + text.encode() * 1000 + b"{}]}"


HOSTILE = {
    "zeros": (zeros(100, 15_000_000), "needs 54 GB of memory with the values of accessors[0] to accessors[99]"),
    "instances": (instances(1, 210_000), "needs 2.1e+05 objects with nodes[0]"),
    "picture": (with_picture(png_head(11585, 11585)), "for images[0], a picture of 11585 x 11585 pixels"),
    "long picture": (with_picture(png_head(2**31 - 1, 2)), "megapixels of pictures with images[0]"),
    "picture of another kind": (with_picture(b"II*\0" + b"\0" * 100), "images[0] cannot be decoded"),
    "nodes": (many_objects("{}," * 66), "has 66001 nodes; 65000 are allowed"),
    "objects of JSON": (many_objects("{}," * 4500), "GB of memory with its JSON"),
    "no right transform": (crate(matrix=[0.0] * 16).glb(), "nodes[0] has a transform"),
    "endless transform": (crate(scale=[1e200, 1e200, 1e200]).glb(), "nodes[0] has a transform"),
    "short transform": (crate(matrix=[1.0] * 9).glb(), "nodes[0].matrix"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_gltf_file_that_asks_for_too_much_is_refused_by_name(case: str, tmp_path: Path) -> None:
    data, message = HOSTILE[case]
    (tmp_path / "place.glb").write_bytes(data)
    found = error_of(tmp_path / "place.glb")
    assert message in found
    assert found.startswith(str(tmp_path / "place.glb"))


def test_a_flat_scale_is_a_flat_mesh(tmp_path: Path) -> None:
    file = crate(scale=[1.0, 0.0, 1.0])
    normals = np.tile(np.array([0.0, 1.0, 0.0], "f4"), (24, 1))
    file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = file.accessor(normals)
    (tmp_path / "place.glb").write_bytes(file.glb())
    world = load_world(load_scene(tmp_path / "place.glb"))
    assert np.ptp(world.model.mesh_vert[:24], axis=0).min() < 1e-6


def test_limits_are_those_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "place.glb").write_bytes(instances(1, 20))
    monkeypatch.setenv("HIL_MAP_OBJECTS", "30")
    assert "30 objects are allowed for a whole map" in error_of(tmp_path / "place.glb")
    monkeypatch.setenv("HIL_MAP_OBJECTS", "100")
    load_world(load_scene(tmp_path / "place.glb"))
    monkeypatch.setenv("HIL_MAP_CPU_S", "much")
    with pytest.raises(ConfigError, match=r"\$HIL_MAP_CPU_S: must be a number above 0, not 'much'"):
        map_limits()


def osm(text: str) -> str:
    return f'<osm version="0.6">{text}</osm>'


NODE = '<node id="{}" lat="47.0" lon="8.0"/>'
HOSTILE_OSM = {
    "tag": (osm(f'<node id="1" lat="47" lon="8"><tag k="note" v="{"x" * 20_000}"/></node>'), "a tag of 20004 char"),
    "endless tag": (osm(f'<node id="1" lat="47" lon="8"><tag k="note" v="{"x" * 900_000}"/></node>'), "an element or"),
    "way": (osm(NODE.format(1) + '<way id="1">' + '<nd ref="1"/>' * (MAX_WAY_NODES + 1)), "a way of more than"),
    "bounds": (osm('<bounds minlat="nan" minlon="8" maxlat="48" maxlon="9"/>' + NODE.format(1)), "not on Earth"),
    "half bounds": (osm('<bounds minlat="47"/>' + NODE.format(1)), "no attribute 'minlon'"),
}


@pytest.mark.parametrize("case", HOSTILE_OSM)
def test_an_extract_that_asks_for_too_much_is_refused_by_line(case: str, tmp_path: Path) -> None:
    text, message = HOSTILE_OSM[case]
    (tmp_path / "place.osm").write_text(text)
    with pytest.raises(ConfigError, match=r"place\.osm:1: ") as caught:
        read_osm(tmp_path / "place.osm")
    assert message in str(caught.value)
