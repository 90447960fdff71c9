"""Scene files, geodesy, magnetic field, atmosphere."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pygeomag
import pymap3d
import pytest

from signals.errors import ConfigError
from signals.geodesy import LocalFrame, ecef_from_geodetic, geodetic_from_ecef
from signals.rotation import matrix_of
from sim.physics.contact_model import build_model
from sim.physics.vehicle import load_vehicle, vehicle_names
from sim.scene import atmosphere
from sim.scene.atmosphere import geopotential_m, pressure_altitude_m, pressure_pa
from sim.scene.scene import SCENE_DIR, Site, load_scene, scene_names
from sim.sensors.magnetometer import magnetic_field_W_tesla
from sim.world_loader import load_world

ZURICH = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
SITES = [
    ZURICH,
    Site(latitude_deg=-33.86, longitude_deg=151.2, altitude_m=5.0),
    Site(latitude_deg=0.0, longitude_deg=-180.0, altitude_m=0.0),
    Site(latitude_deg=89.5, longitude_deg=-20.0, altitude_m=-100.0),
]


@pytest.mark.parametrize("site", SITES)
def test_geodesy_agrees_with_pymap3d(site: Site) -> None:
    frame = LocalFrame(site)
    random = np.random.default_rng(3)
    for scale in (10.0, 1000.0, 50_000.0):
        for p in random.uniform(-scale, scale, (40, 3)).tolist():
            lat, lon, alt = frame.geodetic_from_enu(tuple(p))
            e, n, u = pymap3d.geodetic2enu(
                lat, lon, alt, site.latitude_deg, site.longitude_deg, site.altitude_m, deg=True
            )
            assert (e, n, u) == pytest.approx(tuple(p), abs=2e-8)
            assert frame.enu_from_geodetic(lat, lon, alt) == pytest.approx(tuple(p), abs=1e-8)


def test_ecef_round_trip_and_reference() -> None:
    random = np.random.default_rng(4)
    for lat, lon, alt in random.uniform((-89, -180, -500), (89, 180, 50_000), (200, 3)).tolist():
        p = ecef_from_geodetic(lat, lon, alt)
        assert p == pytest.approx(pymap3d.geodetic2ecef(lat, lon, alt), abs=1e-8)
        assert geodetic_from_ecef(p) == pytest.approx((lat, lon, alt), abs=1e-8)


@pytest.mark.parametrize("site", SITES[:3])
def test_magnetic_field_agrees_with_the_model(site: Site) -> None:
    field = pygeomag.GeoMag().calculate(site.latitude_deg, site.longitude_deg, site.altitude_m / 1000, 2026.0)
    east, north, up = magnetic_field_W_tesla(site)
    assert (north * 1e9, east * 1e9, -up * 1e9) == pytest.approx((field.x, field.y, field.z), abs=1e-3)
    assert 2e-5 < (east * east + north * north + up * up) ** 0.5 < 7e-5


# ISO 2533 table values, by geopotential altitude.
@pytest.mark.parametrize(
    ("altitude_m", "pressure"),
    [(0, 101325.0), (1000, 89874.6), (5000, 54019.9), (11000, 22632.1), (15000, 12044.6), (20000, 5474.89)],
)
def test_standard_atmosphere(altitude_m: float, pressure: float) -> None:
    assert pressure_pa(altitude_m) == pytest.approx(pressure, rel=1e-5)
    assert pressure_altitude_m(pressure_pa(altitude_m)) == pytest.approx(altitude_m, abs=1e-8)


def test_the_exponent_of_the_atmosphere_is_that_of_the_constants_beside_it() -> None:
    (line,) = (line for line in Path(atmosphere.__file__).read_text().splitlines() if line.startswith("# g M / (R L)"))
    figures = {name: float(value) for name, value in re.findall(r"\b([gMRL]) (\d[\d.]*\d)", line)}
    assert figures["g"] * figures["M"] / (figures["R"] * figures["L"]) == pytest.approx(atmosphere.EXPONENT, abs=1e-6)


def test_the_standard_atmosphere_ends_where_it_is_modelled() -> None:
    assert geopotential_m(20_000.0) == pytest.approx(19_937.3, abs=0.1)  # ISO 2533, table 1
    for height in (-5_001.0, 20_001.0, math.nan):
        with pytest.raises(ValueError, match="from -5000 to 20000 m"):
            pressure_pa(height)


@pytest.mark.parametrize("all_pairs", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_scene_and_vehicle_compiles_as_declared(all_pairs: bool) -> None:
    for scene_name in scene_names():
        for vehicle_name in vehicle_names() if all_pairs or scene_name == "airfield" else ["x500"]:
            scene, vehicle = load_scene(scene_name), load_vehicle(vehicle_name)
            model = build_model(scene, vehicle, contact_step_s=0.001)
            assert (model.nq, model.nv) == (7, 6)
            assert model.body_mass[1] == vehicle.mass_kg
            if vehicle.inertia_products_kgm2 == (0.0, 0.0, 0.0):
                assert tuple(model.body_inertia[1]) == vehicle.inertia_kgm2
                assert tuple(model.body_iquat[1]) == (1.0, 0.0, 0.0, 0.0)
            turned = np.array(matrix_of(model.body_iquat[1])).reshape(3, 3)
            tensor = turned @ np.diag(model.body_inertia[1]) @ turned.T
            np.testing.assert_allclose(tensor, vehicle.inertia_tensor_kgm2, rtol=0.0, atol=1e-12)
            assert tuple(model.body_ipos[1]) == (0.0, 0.0, 0.0)
            assert model.ngeom == int(load_world(scene).geom_solid.sum()) + len(vehicle.contact_spheres)
            if scene.map is None:
                assert model.ngeom == 1 + len(scene.boxes) + len(vehicle.contact_spheres)
                kinds = set(model.geom_type.tolist())
                assert kinds <= {mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE}
            assert set(model.geom_solimp[:, 4].tolist()) == {2.0}  # other powers call pow()


def test_vehicle_file_errors_come_all_at_once_with_lines(tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "rigs/vehicles/x500.yaml").read_text()
    bad = text.replace("mass_kg: 2.064307692307692", "mass_kg: -1.0").replace("name: x500", "name: x500\nfett: []")
    path = tmp_path / "bad.yaml"
    path.write_text(bad)
    with pytest.raises(ConfigError) as caught:
        load_vehicle(path)
    problems = {p.message.split(":")[0].split(" ")[0]: p for p in caught.value.problems}
    assert set(problems) == {"mass_kg", "fett"}
    lines = bad.splitlines()
    for key, problem in problems.items():
        assert lines[int(problem.where.rsplit(":", 1)[1]) - 1].startswith(key)
    assert "feet" in problems["fett"].hint


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[0.023891, 0.023891, 0.044000]", "[0.02, 0.02, 0.05]", "sum of the other two"),
        ("mass_kg: 2.064307692307692", "mass_kg: .nan", "finite"),
        ("spin: ccw", "spin: left", "ccw"),
        ("name: foot_rear_left", "name: foot_front_right", "different names"),
    ],
)
def test_vehicle_physics_is_checked(old: str, new: str, says: str, tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "rigs/vehicles/x500.yaml").read_text()
    assert old in text
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=says):
        load_vehicle(path)


def test_two_boxes_of_one_name_are_named_with_their_line(tmp_path: Path) -> None:
    boxes = "".join(f"{{name: crate, center_m: [{x}, 0, 0.5], size_m: [1, 1, 1]}}, " for x in (5, 9))
    text = (SCENE_DIR / "airfield.yaml").read_text().replace("boxes: []", f"boxes: [{boxes}]")
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"mine\.yaml:8: boxes: two boxes are called 'crate'"):
        load_scene(str(tmp_path / "mine.yaml"))
