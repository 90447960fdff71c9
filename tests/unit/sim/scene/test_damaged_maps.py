"""Damaged files of maps raise nothing but named errors."""

from __future__ import annotations

import random
import re
from pathlib import Path

from signals.errors import ConfigError
from sim.scene.imports.elevation import make_terrain, read_geotiff
from sim.scene.imports.osm_file import read_osm
from sim.scene.map_file import read_map_file
from sim.scene.map_limits import size_problems
from tests.unit.sim.scene.imports.test_elevation import SITE, slope_tiff
from tests.worlds.example_places import quarter_osm


def damaged(text: str, rng: random.Random) -> str:
    """Return a text with a number, an attribute or some characters changed."""
    for _ in range(rng.choice((1, 1, 3))):
        place = rng.choice(list(re.finditer(r"-?\d+(?:\.\d+)?|\"[^\"]*\"|.{9}", text)))
        new = rng.choice(("0", "-1", "nan", "1e400", "-1e308", "99999999999", '"x"', "", "<", '" "', "180.0"))
        text = text[: place.start()] + new + text[place.end() :]
    return text


MJCF = """<mujoco><compiler angle="degree"/><size memory="1M"/><asset>
<hfield name="h" nrow="9" ncol="9" size="5 5 1 1"/>
<texture name="t" type="2d" builtin="checker" width="64" height="64"/>
<mesh name="b" builtin="sphere" params="2"/></asset>
<worldbody><body name="x" pos="5 0 1"><joint name="j" type="hinge"/><geom type="box" size="1 1 1" user="1 2"/></body>
<geom type="hfield" hfield="h"/><replicate count="4" offset="2 0 0"><geom size="0.2"/></replicate></worldbody>
<sensor><jointpos joint="j"/><user dim="3"/></sensor>
<custom><numeric name="n" size="3" data="1 2 3"/></custom></mujoco>"""


def test_damaged_mjcf_files_raise_nothing_but_named_errors(tmp_path: Path) -> None:
    rng = random.Random(6)
    path = tmp_path / "m.xml"
    refused = 0
    for _ in range(300):
        path.write_text(damaged(MJCF, rng))
        try:
            size_problems(read_map_file(path).root)
        except ConfigError:
            refused += 1
    assert 20 < refused < 280


def test_damaged_extracts_and_heights_raise_nothing_but_named_errors(tmp_path: Path) -> None:
    rng = random.Random(7)
    text, tiff = quarter_osm(1, 1), slope_tiff()
    refused = 0
    for _ in range(150):
        (tmp_path / "place.osm").write_text(damaged(text, rng))
        data = bytearray(tiff)
        for _ in range(rng.choice((1, 3, 9))):
            data[rng.randrange(len(data) - 250, len(data))] = rng.randrange(256)
        (tmp_path / "heights.tif").write_bytes(data)
        for read in (
            lambda: read_osm(tmp_path / "place.osm").middle(),
            lambda: make_terrain(read_geotiff(tmp_path / "heights.tif"), SITE, 40.0),
        ):
            try:
                read()
            except ConfigError:
                refused += 1
    assert 50 < refused < 300
