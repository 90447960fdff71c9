"""Vehicles on ground that is not level: how they stand there, what they do beyond, and the place found instead."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hil.config import load_bench
from hil.config.scenes import on_free_ground
from signals.errors import ConfigError
from signals.rotation import cos_tilt_of, matrix_of
from sim.physics.flight_start import FlightStart
from sim.physics.footing import steepest_slope
from sim.physics.take_off import take_off_problem
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.map_section import GltfMap
from sim.scene.scene import Scene, load_scene
from tests.worlds.glb_file import GlbFile, box

TICK_NS = 4_000_000
HEAD = """name: hill
description: Ground of a test
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: hill.xml}
"""


def hill(folder: Path, slope_deg: float, *more: str, friction: float = 0.8) -> Scene:
    """Return a scene whose ground falls towards east, through the origin."""
    below_m = 1.0 / math.cos(math.radians(slope_deg))
    ground = f'<geom name="slope" type="box" size="90 90 1" pos="0 0 {-below_m:.12f}" euler="0 {slope_deg} 0"/>'
    (folder / "hill.xml").write_text(f"<mujoco><worldbody>{ground}{''.join(more)}</worldbody></mujoco>")
    (folder / "hill.yaml").write_text(HEAD.replace("0.8", f"{friction}"))
    return load_scene(folder / "hill.yaml")


def slope_of(q_WB: tuple[float, float, float, float]) -> float:
    return math.degrees(math.acos(min(cos_tilt_of(q_WB), 1.0)))


@pytest.mark.parametrize("name", ["x500", "hexa_x", "racer"])
@pytest.mark.parametrize(("slope_deg", "yaw_deg"), [(2.0, 0.0), (6.0, 90.0), (15.0, 40.0), (20.0, 200.0)])
def test_a_vehicle_stands_along_a_slope_and_stays(tmp_path: Path, name: str, slope_deg: float, yaw_deg: float) -> None:
    vehicle, scene = load_vehicle(name), hill(tmp_path, slope_deg)
    start = FlightStart(yaw_rad=math.radians(yaw_deg))
    assert take_off_problem(scene, vehicle, start) is None
    physics = VehiclePhysics(vehicle, scene, tick_ns=TICK_NS, start=start)
    begin = physics.truth
    for tick in range(500):
        end = physics.advance(tick, (0.0,) * len(vehicle.rotors))
    up_W = np.array(matrix_of(begin.q_WB)).reshape(3, 3)[:, 2]
    fall = math.radians(slope_deg)
    assert up_W == pytest.approx([math.sin(fall), 0.0, math.cos(fall)], abs=1e-3)
    assert end.p_WB == pytest.approx(begin.p_WB, abs=2e-3)
    assert slope_of(end.q_WB) == pytest.approx(slope_deg, abs=0.1)
    assert end.in_contact


def test_on_level_ground_the_vehicle_stands_as_it_did(tmp_path: Path) -> None:
    vehicle = load_vehicle("x500")
    level = VehiclePhysics(vehicle, load_scene("airfield"), tick_ns=TICK_NS)
    map_of_own = VehiclePhysics(vehicle, hill(tmp_path, 0.0), tick_ns=TICK_NS)
    assert map_of_own.truth.q_WB == level.truth.q_WB
    assert map_of_own.truth.p_WB == pytest.approx(level.truth.p_WB, abs=1e-6)


def test_the_steepest_slope_is_that_of_friction_or_of_the_feet() -> None:
    """X500: feet at (+-0.13, +-0.13) m in the file decide; on ice friction does."""
    vehicle = load_vehicle("x500")
    low = min(foot.position_m[2] - foot.radius_m for foot in vehicle.feet)
    half_m = min(abs(foot.position_m[i]) for foot in vehicle.feet for i in (0, 1))
    slope_rad, does = steepest_slope(vehicle, 5.0)
    assert (does, slope_rad) == ("tips over", pytest.approx(math.atan2(half_m, -low), abs=1e-9))
    assert steepest_slope(vehicle, 0.1) == (pytest.approx(math.atan(0.1)), "slides")


@pytest.mark.parametrize(("slope_deg", "friction", "says"), [(33.0, 0.8, "tips over"), (12.0, 0.1, "slides")])
def test_a_slope_beyond_is_refused_with_its_angle(tmp_path: Path, slope_deg: float, friction: float, says: str) -> None:
    hill(tmp_path, slope_deg, friction=friction)
    with pytest.raises(ConfigError) as caught:
        load_bench(scene=str(tmp_path / "hill.yaml"))
    (problem,) = caught.value.problems
    assert f"slopes by {slope_deg:.1f} degrees at the origin: the vehicle {says} on slopes above" in problem.message
    assert "no free, level ground was found within 200 m" in problem.hint


def test_the_place_of_a_hint_passes_the_check(tmp_path: Path) -> None:
    """A block over the origin and a roof beside it: the place is on the ground, clear of both."""
    things = [
        f'<body name="{name}" pos="{x} 0 1"><geom type="box" size="3 3 1"/></body>'
        for name, x in (("block", 0.0), ("shed", 7.0))
    ]
    scene, vehicle = hill(tmp_path, 0.0, *things), load_vehicle("x500")
    problem = take_off_problem(scene, vehicle)
    assert problem is not None
    assert "inside 'block'" in problem[0]
    place = problem.place
    assert place is not None
    assert f"set start.p_W: [{place[0]:.2f}, {place[1]:.2f}, {place[2]:.2f}]" in problem[1]
    assert place[2] == pytest.approx(0.0, abs=1e-6)
    assert take_off_problem(scene, vehicle, FlightStart(ground_W=place)) is None


@pytest.mark.parametrize("has_ground", [True, False])
def test_a_gltf_file_whose_origin_is_inside_a_house_gets_a_place_beside_it(tmp_path: Path, has_ground: bool) -> None:
    file = GlbFile()
    parts = {"house": box((-2.0, 0.0, -2.0), (2.0, 3.0, 2.0))}
    if has_ground:
        parts["lawn"] = box((-40.0, -0.2, -40.0), (40.0, 0.0, 40.0))
    for name, (vertices, triangles, _) in parts.items():
        file.node(name, file.mesh(name, (vertices, triangles, file.material(name), None)))
    path = tmp_path / "village.glb"
    path.write_bytes(file.glb())
    bench = load_bench(scene=str(path))
    assert isinstance(bench.scene.map, GltfMap)
    x, y, z = bench.scene.map.origin_m
    assert max(abs(x), abs(y)) > 2.0
    assert z == pytest.approx(0.0, abs=0.02)
    assert take_off_problem(bench.scene, bench.vehicle) is None
    assert on_free_ground(bench.scene, bench.vehicle) is bench.scene


@pytest.mark.parametrize("foot_m", [0.0, -6.0])
def test_the_model_of_a_building_alone_gets_a_plane_at_its_foot(tmp_path: Path, foot_m: float) -> None:
    """Its roof is the only solid thing that a vehicle could stand on; no ground would be around it in flight."""
    file = GlbFile()
    vertices, triangles, _ = box((-5.0, foot_m, -5.0), (5.0, foot_m + 12.0, 5.0))
    file.node("tower", file.mesh("tower", (vertices, triangles, file.material("wall"), None)))
    path = tmp_path / "tower.glb"
    path.write_bytes(file.glb())
    bench = load_bench(scene=str(path), mission=None)
    assert isinstance(bench.scene.map, GltfMap)
    x, y, z = bench.scene.map.origin_m
    assert max(abs(x), abs(y)) > 5.0
    assert z == pytest.approx(foot_m, abs=0.02)
    assert take_off_problem(bench.scene, bench.vehicle) is None
    assert take_off_problem(bench.scene, bench.vehicle, FlightStart(ground_W=(30.0, 30.0, 0.0))) is None


@pytest.mark.parametrize(("under_m", "is_free"), [(0.8, False), (1.1, False), (2.0, True)])
def test_a_vehicle_under_something_low_is_refused_and_gets_a_place(
    tmp_path: Path, under_m: float, is_free: bool
) -> None:
    """A lorry or a hollow statue: the vehicle stands below it and could not climb. The place is beside it or on it."""
    table = f'<geom name="table" type="box" size="1.5 1.5 0.1" pos="0 0 {under_m + 0.1}"/>'
    scene, vehicle = hill(tmp_path, 0.0, table), load_vehicle("x500")
    problem = take_off_problem(scene, vehicle)
    assert (problem is None) == is_free
    if problem is not None:
        assert "leaves no room to take off: 'table' is" in problem.message
        assert problem.place is not None
        assert take_off_problem(scene, vehicle, FlightStart(ground_W=problem.place)) is None
