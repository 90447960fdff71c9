"""Heights from a GeoTIFF."""

from __future__ import annotations

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hil.config import load_bench
from signals.errors import ConfigError
from sim.scene.imports.elevation import make_terrain, read_geotiff, utm
from sim.scene.scene import Site, load_scene
from sim.world_loader import load_world
from tests.worlds.example_places import LATITUDE_DEG, LONGITUDE_DEG, quarter_osm
from tests.worlds.geotiff_file import geotiff

SITE = Site(latitude_deg=LATITUDE_DEG, longitude_deg=LONGITUDE_DEG, altitude_m=400.0)


def slope_tiff(epsg: int = 4326) -> bytes:
    """Return heights that rise by 1 m each 20 m to the east, 450 m at the site."""
    step = (0.0002, 0.0001)
    n = 80
    origin = (LONGITUDE_DEG - 0.5 * n * step[0], LATITUDE_DEG + 0.5 * n * step[1])
    east_m = (np.arange(n) + 0.5 - 0.5 * n) * step[0] * 75_450.0
    return geotiff(np.tile(450.0 + east_m / 20.0, (n, 1)), origin, step, epsg)


def test_utm_against_published_values() -> None:
    x, y = utm(np.array([0.0, 45.0]), np.array([6.0, 3.0]), 31, south=False)
    assert x[0] == pytest.approx(833978.5569, abs=1e-3)
    assert (y[0], x[1]) == pytest.approx((0.0, 500_000.0), abs=1e-3)
    assert y[1] == pytest.approx(0.9996 * 4984944.378, abs=2e-3)  # the meridian from the equator to 45 degrees


def test_terrain_follows_the_file(tmp_path: Path) -> None:
    (tmp_path / "dem.tif").write_bytes(slope_tiff())
    terrain = make_terrain(read_geotiff(tmp_path / "dem.tif"), SITE, 200.0)
    points = np.array([(100.0, 0.0), (-140.0, 60.0), (37.0, -151.0)])
    np.testing.assert_allclose(terrain.height(points), points[:, 0] / 20.0, atol=0.05)
    assert terrain.height(np.zeros((1, 2)))[0] == 0.0


def test_unknown_heights_are_those_of_the_nearest_known_ones(tmp_path: Path) -> None:
    """A file that ends 40 m west of the site, and one with a hole: no height comes from the opposite edge."""
    step, n = (0.0002, 0.0001), 80
    origin = (LONGITUDE_DEG - 40.0 / 75_450.0, LATITUDE_DEG + 0.5 * n * step[1])
    heights = np.tile(450.0 + np.arange(n), (n, 1))
    heights[10:14, 8:10] = np.nan
    (tmp_path / "dem.tif").write_bytes(geotiff(heights, origin, step, 4326))
    terrain = make_terrain(read_geotiff(tmp_path / "dem.tif"), SITE, 200.0)
    west = np.array([(-60.0, 0.0), (-100.0, 0.0), (-200.0, 100.0)])
    edge = terrain.height(np.array([(-38.0, 0.0)]))[0]
    np.testing.assert_allclose(terrain.height(west), edge, atol=0.5)
    assert edge < -1.0


def test_a_quarter_on_a_slope(tmp_path: Path) -> None:
    """Buildings stand in the slope, roads and the take-off place lie on it."""
    pytest.importorskip("shapely")
    (tmp_path / "dem.tif").write_bytes(slope_tiff())
    (tmp_path / "place.osm").write_text(quarter_osm(2, 2))
    (tmp_path / "scene.yaml").write_text(
        f"name: place\ndescription: A slope\nground_friction: 0.8\n"
        f"site: {{latitude_deg: {LATITUDE_DEG}, longitude_deg: {LONGITUDE_DEG}, altitude_m: 450.0}}\n"
        "map: {osm: place.osm, elevation: dem.tif, radius_m: 150}\n"
    )
    world = load_world(load_scene(tmp_path / "scene.yaml"))
    model = world.model
    roads = np.flatnonzero(world.geom_class == world.class_names.index("road"))
    assert len(roads) > 0
    for geom in roads.tolist():
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        quat = np.zeros(9)
        mujoco.mju_quat2Mat(quat, model.geom_quat[geom])
        body = int(model.geom_bodyid[geom])
        points = (
            model.mesh_vert[first : first + count] @ quat.reshape(3, 3).T + model.geom_pos[geom] + model.body_pos[body]
        )
        far = np.abs(points[:, 0]) > 30.0
        np.testing.assert_allclose(points[far, 2], points[far, 0] / 20.0 + 0.03, atol=0.08)
    house = next(b for b in range(model.nbody) if model.body(b).name == "house_000")
    assert model.body_pos[house][2] == pytest.approx(model.body_pos[house][0] / 20.0, abs=0.6)


def test_a_file_without_its_last_heights_is_cut_off(tmp_path: Path) -> None:
    """Writers such as GDAL put the heights behind the tags, so that the tags of a cut file are whole."""
    ifd = 8
    tags = [(256, 3, 4), (257, 3, 4), (258, 3, 32), (273, 4, 8 + 2 + 12 * 5 + 4), (279, 4, 64)]
    rows = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    whole = b"II*\0" + struct.pack("<IH", ifd, len(tags)) + rows + bytes(4) + bytes(64)
    (tmp_path / "dem.tif").write_bytes(whole)
    with pytest.raises(ConfigError, match="has no place on Earth"):
        read_geotiff(tmp_path / "dem.tif")
    (tmp_path / "dem.tif").write_bytes(whole[:-1])
    with pytest.raises(ConfigError, match=r"dem\.tif: is cut off: its heights reach to byte 138, and it has 137"):
        read_geotiff(tmp_path / "dem.tif")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not a TIFF file"),
        (b"II*\0\xff\xff\xff\x7f", "is not a TIFF file, or it is cut off"),
        (slope_tiff(3857), "is in EPSG:3857, which is not read"),
        (
            slope_tiff()[:2] + slope_tiff()[2:].replace(struct.pack("<H", 33550), struct.pack("<H", 33551)),
            "has no place on Earth",
        ),
        (
            geotiff(np.zeros((4, 4)), (0.0, 1.0), (0.1, 0.1), 4326),
            "has no height at the take-off place, latitude 47.397742, longitude 8.545594 "
            "(its middle is at latitude_deg: 0.850000, longitude_deg: 0.150000)",
        ),
    ],
)
def test_bad_files_have_named_errors(data: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "dem.tif").write_bytes(data)
    with pytest.raises(ConfigError, match=r"dem\.tif") as caught:
        make_terrain(read_geotiff(tmp_path / "dem.tif"), SITE, 100.0)
    assert message in str(caught.value)


@pytest.mark.parametrize("epsg", [4326, 32632])
def test_a_geotiff_is_a_scene_of_its_own(epsg: int, tmp_path: Path) -> None:
    """Its middle is the site: the pyramid's height and place there are those of the file."""
    n, step = 40, (0.0002, 0.0001) if epsg == 4326 else (10.0, 10.0)
    row, column = np.mgrid[0:n, 0:n]
    heights = 700.0 + 0.5 * row + column
    heights[:10] = np.nan  # unknown in the north
    origin = (8.5, 47.4) if epsg == 4326 else (500_000.0, 5_150_000.0)
    (tmp_path / "hills.tif").write_bytes(geotiff(heights, origin, step, epsg))
    scene = load_scene(tmp_path / "hills.tif")
    at = read_geotiff(tmp_path / "hills.tif").at(
        np.array([scene.site.latitude_deg]), np.array([scene.site.longitude_deg])
    )
    assert scene.site.altitude_m == pytest.approx(at[0], abs=0.02)
    assert scene.site.altitude_m == pytest.approx(700.0 + 19.0 + 0.5 * 19.0, abs=1.01)
    bench = load_bench(scene=str(tmp_path / "hills.tif"))
    world = load_world(bench.scene)
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    assert world.model.ngeom == 1
    assert world.map.classes == {"ground": ("ground",)}
    rise = [top_m(world.model, data, x, 0.0) for x in (-60.0, 60.0)]
    per_m = 1.0 / (0.0002 * 75_450.0 if epsg == 4326 else 10.0)
    assert (rise[1] - rise[0]) / 120.0 == pytest.approx(per_m, rel=0.02)


@pytest.mark.parametrize("west_deg", [179.997, 179.999])
def test_heights_on_both_sides_of_the_date_line(west_deg: float, tmp_path: Path) -> None:
    """A plane that rises to the east, with its middle on either side."""
    heights = 100.0 + np.tile(np.arange(40.0), (40, 1))
    (tmp_path / "fiji.tif").write_bytes(geotiff(heights, (west_deg, -16.8), (0.0001, 0.0001), 4326))
    scene = load_scene(tmp_path / "fiji.tif")
    east_deg = west_deg + 0.00195
    assert scene.site.longitude_deg == pytest.approx(east_deg - (360.0 if east_deg > 180.0 else 0.0), abs=1e-4)
    terrain = make_terrain(read_geotiff(tmp_path / "fiji.tif"), scene.site, 150.0)
    rise_m = terrain.height(np.array([[-100.0, 50.0], [100.0, 50.0]]))
    assert (rise_m[1] - rise_m[0]) / 200.0 == pytest.approx(1.0 / (0.0001 * 106_600.0), rel=0.05)


def top_m(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float) -> float:
    geom = np.full((1, 1), -1, dtype=np.int32)
    return 500.0 - mujoco.mj_ray(
        model, data, np.array([[x], [y], [500.0]]), np.array([[0.0], [0.0], [-1.0]]), None, 1, -1, geom
    )


def test_a_geotiff_without_a_known_height_is_refused(tmp_path: Path) -> None:
    heights = np.full((4, 4), np.nan)
    (tmp_path / "sea.tif").write_bytes(geotiff(heights, (8.5, 47.4), (0.0002, 0.0001), 4326))
    with pytest.raises(ConfigError, match="holds no known height"):
        load_scene(tmp_path / "sea.tif")
