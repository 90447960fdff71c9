"""Satellites past a scene: which are seen, what the open sky leaves unchanged, reflections in closed form."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from signals.geodesy import LocalFrame
from sim._kernels import solve_gnss
from sim.frame.source import SharedFrames
from sim.gnss.signal_paths import SignalPaths
from sim.gnss.surroundings import Surroundings
from sim.scene.scene import Scene, load_scene
from sim.sensors.catalog import PRESETS
from sim.world_loader import load_world
from tests.worlds.installed_sensor import installed
from tests.worlds.street_canyon import at, canyon, frames_of, one_wall, receiver_in

GPS = sorted(name for name, preset in PRESETS.items() if preset.kind == "gps")
PLACES = [(0.0, 0.0, 1.5), (-6.0, 14.0, 3.0), (7.5, -30.0, 10.0), (0.0, 20.0, 22.0), (0.0, 0.0, 60.0)]


def free_by_mujoco(world: Any, p_W: tuple[float, float, float], directions: np.ndarray) -> list[bool]:
    """Return for each direction whether MuJoCo's own ray meets nothing."""
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    geom = np.zeros(1, np.int32)
    return [
        mujoco.mj_ray(world.model, data, np.array(p_W), d, None, 1, -1, geom) < 0.0
        for d in np.ascontiguousarray(directions)
    ]


@pytest.mark.parametrize("p_W", PLACES)
def test_visible_satellites_are_those_that_mujoco_sees(p_W: tuple[float, float, float]) -> None:
    scene = canyon()
    gps = receiver_in(scene)
    gps.sample(at(p_W), 0)
    views = gps.receiver.views
    free = free_by_mujoco(frames_of(scene.model_dump_json()).world, p_W, np.array([view.direction for view in views]))
    assert len(views) > 15
    assert [view.state != "hidden" and view.state != "reflected" for view in views] == free
    assert gps.sky_fix.visible == sum(free)


def test_a_canyon_hides_satellites_and_its_roofs_do_not() -> None:
    low, high = receiver_in(canyon()), receiver_in(canyon())
    low.sample(at((0.0, 0.0, 1.5)), 0)
    high.sample(at((0.0, 0.0, 40.0)), 0)
    assert low.sky_fix.visible < 0.7 * high.sky_fix.visible
    assert high.sky_fix.visible == high.sky_fix.in_view
    assert min(low.sky_fix.scale) > 1.5
    assert high.sky_fix.scale == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("preset", GPS)
def test_in_the_open_a_sample_is_the_same_to_the_bit_but_for_its_satellites(preset: str) -> None:
    scene = load_scene("airfield")
    plain, seeing = (receiver_in(scene, preset=preset, sky=sky) for sky in (None, {}))
    turned = (math.cos(0.2), math.sin(0.2), 0.0, 0.0)
    for k in range(40):
        truth = at(
            (0.3 * k, -0.1 * k, 2.0), 0.2 * k, v_WB_W=(1.5, -0.5, 0.0), q_WB=turned if k > 30 else (1.0, 0.0, 0.0, 0.0)
        )
        a, b = plain.sample(truth, k), seeing.sample(truth, k)
        assert a[:-1] == b[:-1]
        assert b.satellites > 8
    assert seeing.receiver.listener.paths.rays == 0
    assert seeing.receiver.listener.clear == 40


@pytest.mark.parametrize("height_m", [1.5, 12.0, 24.0, 27.0, 200.0])
def test_rays_are_skipped_only_where_they_change_nothing(height_m: float) -> None:
    skipping, casting = (receiver_in(canyon(), sky={"skip_clear_sky": skip}) for skip in (True, False))
    for k in range(5):
        truth = at((0.0, 3.0 * k, height_m), 0.2 * k)
        assert skipping.sample(truth, k) == casting.sample(truth, k)
        assert skipping.sky_fix == casting.sky_fix
    assert casting.receiver.listener.clear == 0
    assert skipping.receiver.listener.clear == (5 if height_m > 25.0 else 0)  # the tallest house has 25 m


def test_the_fix_is_the_least_squares_solution_of_numpy() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        count = int(rng.integers(5, 30))
        directions = rng.normal(size=(count, 3))
        directions[:, 2] = np.abs(directions[:, 2]) + 0.2
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        weights, errors = rng.uniform(0.05, 1.0, count), rng.normal(0.0, 20.0, count)
        residuals = np.empty(count)
        solved, shift, variance, dilution = solve_gnss(directions, weights, errors, residuals)
        design = np.hstack([-directions, np.ones((count, 1))])
        normal = design.T @ np.diag(weights) @ design
        expected = np.linalg.solve(normal, design.T @ (weights * errors))
        assert solved
        assert shift == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert variance == pytest.approx(np.diag(np.linalg.inv(normal)), rel=1e-9)
        assert dilution == pytest.approx(np.diag(np.linalg.inv(design.T @ design)), rel=1e-9)
        assert residuals == pytest.approx(errors - design @ expected, abs=1e-9)


def test_dilutions_of_four_satellites_have_a_closed_form() -> None:
    # One at the zenith and three at the horizon, 120 degrees apart: HDOP^2 = 4/3, VDOP^2 = 4/3, TDOP^2 = 1/3.
    angles = np.radians([0.0, 120.0, 240.0])
    directions = np.array([[0.0, 0.0, 1.0], *[[math.sin(a), math.cos(a), 0.0] for a in angles]])
    _, _, _, (east, north, up, clock) = solve_gnss(directions, np.ones(4), np.zeros(4), np.empty(4))
    assert (east + north, up, clock) == pytest.approx((4.0 / 3.0, 4.0 / 3.0, 1.0 / 3.0))


def test_three_satellites_give_a_place_with_a_held_height() -> None:
    directions = np.array([[0.0, 0.6, 0.8], [0.7, -0.3, 0.648], [-0.6, -0.4, 0.693]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    height_m = 5.0
    solved, shift, _, _ = solve_gnss(directions, np.ones(3), np.zeros(3), np.empty(3), held=True, height_error=height_m)
    assert solved
    assert shift[2] == pytest.approx(height_m, abs=1e-2)
    seen = -directions @ np.array(shift[:3]) + shift[3]
    assert np.abs(seen).max() < 1e-2
    assert not solve_gnss(directions, np.ones(3), np.zeros(3), np.empty(3))[0]


def test_a_linear_fix_is_that_of_the_full_equations() -> None:
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(12, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.3
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    satellites = directions * rng.uniform(2.0e7, 2.5e7, (12, 1))
    errors = rng.normal(0.0, 50.0, 12)
    measured = np.linalg.norm(satellites, axis=1) + errors
    place, clock = np.zeros(3), 0.0
    for _ in range(10):
        away = satellites - place
        distance = np.linalg.norm(away, axis=1)
        design = np.hstack([-away / distance[:, None], np.ones((12, 1))])
        step, *_ = np.linalg.lstsq(design, measured - distance - clock, rcond=None)
        place, clock = place + step[:3], clock + step[3]
    _, shift, _, _ = solve_gnss(directions, np.ones(12), errors, np.empty(12))
    assert shift[:3] == pytest.approx(place, abs=1e-3)


def test_the_extra_path_by_a_wall_is_that_of_its_image() -> None:
    distance_m = 12.0
    scene = one_wall(distance_m)
    gps = receiver_in(scene)
    antenna = (0.0, 0.0, 2.0)
    gps.sample(at(antenna), 0)
    paths = gps.receiver.listener.paths
    directions = np.array([view.direction for view in gps.receiver.views])
    found = {r.satellite: r for r in paths.reflections(antenna, directions, 600.0)}
    expected = {}
    for number, (e, n, u) in enumerate(directions.tolist()):
        # The wall stands in the east: satellites in the west have an image there, if the point is below its top.
        if e < 0.0:
            d = distance_m / -e
            if 2.0 + d * u < 60.0 and abs(d * n) < 200.0:
                expected[number] = 2.0 * distance_m * -e
    assert expected
    assert {number: r.extra_m for number, r in found.items()} == pytest.approx(expected)
    # By the definition, without the formula: the way of a plane wave by way of the point of reflection.
    for number, r in found.items():
        s, m = directions[number], np.array(r.direction)
        point = np.array(antenna) + distance_m / m[0] * m
        way = np.linalg.norm(point - np.array(antenna)) - (point - np.array(antenna)) @ s
        assert r.extra_m == pytest.approx(way)


def test_a_hidden_satellite_is_received_by_its_reflection_and_shifts_the_fix() -> None:
    scene = canyon(width_m=16.0, height_m=30.0)
    gps = receiver_in(scene, sky={"smoothing_s": 0.0, "residual_limit_m": 1000.0})
    clean = receiver_in(scene, sky={"reflections": False, "smoothing_s": 0.0})
    by_reflection = 0
    for k, y_m in enumerate((-40.0, -20.0, 0.0, 10.0, 25.0)):
        for gps_, _ in ((gps, 0), (clean, 0)):
            gps_.sample(at((2.0, y_m, 1.5), 0.2 * k), k)
        by_reflection += gps.sky_fix.reflected
        assert clean.sky_fix.reflected == 0
        assert max(map(abs, clean.sky_fix.shift_m)) < 1e-9
    assert by_reflection > 0
    assert max(map(abs, gps.sky_fix.shift_m)) > 0.05


def test_the_doppler_of_a_reflection_is_the_rate_of_its_path() -> None:
    gps = receiver_in(one_wall(15.0))
    gps.sample(at((0.0, 0.0, 2.0)), 0)
    paths = gps.receiver.listener.paths
    directions = np.array([view.direction for view in gps.receiver.views])
    v, dt = np.array([1.5, 0.7, 0.2]), 1e-3
    before = {r.satellite: r for r in paths.reflections((0.0, 0.0, 2.0), directions, 600.0)}
    after = {r.satellite: r for r in paths.reflections(tuple(np.array([0.0, 0.0, 2.0]) + v * dt), directions, 600.0)}
    for number in before.keys() & after.keys():
        r = before[number]
        rate = r.extra_rate * float(np.dot(r.rate_direction, v))
        assert rate == pytest.approx((after[number].extra_m - r.extra_m) / dt, abs=1e-6)


def test_foliage_weakens_and_does_not_block() -> None:
    scene = load_scene("city_park")
    world = load_world(scene)
    frames = SharedFrames(world)
    around = Surroundings(frames.geometry, smallest_face_m2=4.0)
    paths = SignalPaths(around)
    tree = int(np.flatnonzero(around.geom_foliage & (world.geom_class == world.class_names.index("tree")))[0])
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    x, y, z = data.geom_xpos[tree]
    origins = np.array([[x + 0.3, y + 0.3, 0.5]] * 9)
    angles = np.radians(np.linspace(50.0, 90.0, 9))
    directions = np.stack([np.cos(angles), np.zeros(9), np.sin(angles)], axis=1)
    reach = paths.cast(origins, directions)
    assert (reach.geom < 0).any()
    assert reach.foliage_m.max() > 0.5
    assert reach.foliage_m.max() < 40.0
    assert z > 0.0


def test_the_same_samples_come_from_a_receiver_that_was_made_anew() -> None:
    runs = []
    for _ in range(2):
        gps = receiver_in(canyon())
        runs.append([gps.sample(at((0.1 * k, 1.0 * k, 1.5), 0.2 * k, v_WB_W=(0.5, 5.0, 0.0)), k) for k in range(20)])
    assert runs[0] == runs[1]


def test_a_reported_accuracy_covers_the_error_in_a_canyon() -> None:
    scene = canyon()
    frame = LocalFrame(scene.site)
    errors, stated = [], []
    for seed in range(40):
        gps = receiver_in(scene, seed=seed)
        sample = gps.sample(at((1.0, 5.0, 1.5)), 0)
        e, n, _ = frame.enu_from_geodetic(sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
        errors.append(math.hypot(e - 1.0, n - 5.0))
        stated.append(sample.horizontal_accuracy_m)
    open_sky = receiver_in(load_scene("airfield")).sample(at((0.0, 0.0, 1.5)), 0)
    assert min(stated) > 1.2 * open_sky.horizontal_accuracy_m
    assert np.sqrt(np.mean(np.square(errors))) < 2.5 * np.mean(stated)


def test_without_geometry_a_sky_is_refused() -> None:
    scene: Scene = load_scene("airfield")
    with pytest.raises(ValueError, match="needs the world's geometry"):
        installed("gps", scene, preset="m8n", overrides={"sky": {}}, rate_hz=5.0)


def test_terrain_hides_satellites(tmp_path: Path) -> None:
    heights = " ".join(str(max(0.0, row - 4) / 4.0) for row in range(9) for _ in range(9))  # rises to the south
    (tmp_path / "hill.xml").write_text(
        f'<mujoco><asset><hfield name="hill" nrow="9" ncol="9" size="400 400 300 1" elevation="{heights}"/></asset>'
        '<worldbody><geom name="hill" type="hfield" hfield="hill"/></worldbody></mujoco>'
    )
    scene = load_scene(tmp_path / "hill.xml")
    world = load_world(scene)
    gps = installed("gps", scene, preset="f9p", overrides={"sky": {}}, rate_hz=5.0, frames=SharedFrames(world))
    p_W = (0.0, 20.0, 2.0)
    gps.sample(at(p_W), 0)
    views = gps.receiver.views
    free = free_by_mujoco(world, p_W, np.array([view.direction for view in views]))
    assert [view.state in ("used", "visible") for view in views] == free
    assert 0 < sum(free) < len(free)
    assert all(view.direction[1] < 0.0 for view, is_free in zip(views, free, strict=True) if not is_free)
