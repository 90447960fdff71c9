"""Parts of the SLAM against closed forms: motion correction, matching, tiles, weights, search, geodesy, strapdown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hil.apps.view.command import load_frames
from signals.geodesy import LocalFrame
from signals.samples import TruthState
from sim.scene.scene import Site
from tests.worlds.installed_sensor import installed
from tests.worlds.slam_yard import HEIGHT_M, IMU_NS, RINGS_DEG, Circle, wall_distance_m

from hil_companion.explore.mapping.sweep import FreshSweeps  # isort: skip
from hil_companion.navigation.geodesy import LocalPlane  # isort: skip
from hil_companion.navigation.inertial import InertialFilter  # isort: skip
from hil_companion.explore.mapping.maps import Maps  # isort: skip
from hil_companion.explore.mapping.matcher import match  # isort: skip
from hil_companion.explore.mapping.particles import Particles  # isort: skip
from hil_companion.explore.mapping.scan import Scan, make_scan  # isort: skip
from hil_companion.explore.mapping.search import search  # isort: skip
from hil_companion.explore.mapping.slam_settings import SlamSettings  # isort: skip
from hil_companion.explore.mapping.sweep import Sweep, make_sweep  # isort: skip
from hil_companion.explore.mapping.maps import CELLS, Tiles  # isort: skip
from hil_companion.frame import Sample as ClientSample  # isort: skip

T_NS = 3_500_000_000


def flown(circle: Circle) -> InertialFilter:
    """Return a filter after exact rows up to T_NS."""
    inertial = InertialFilter(circle.start)
    times = list(range(0, T_NS + 1, IMU_NS))
    inertial.add_rows(times, *circle.imu(times))
    inertial.advance(T_NS)
    return inertial


def swept(circle: Circle, inertial: InertialFilter, elevation_deg: tuple[float, ...] = RINGS_DEG) -> Sweep:
    settings = SlamSettings(lidar_p_BL=circle.lidar_p_BL, lidar_elevation_deg=elevation_deg)
    return make_sweep(inertial, circle.sweep(T_NS), settings)


def scanned(sweep: Sweep, height_m: float = HEIGHT_M) -> Scan:
    return make_scan(sweep, SlamSettings(flight_height_m=height_m), HEIGHT_M)


def in_world(xy: np.ndarray, p: np.ndarray, yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return xy @ np.array([[c, s], [-s, c]]) + p[:2]


def test_strapdown_of_a_circle_and_a_sweep_on_it_made_straight() -> None:
    circle = Circle()
    inertial = flown(circle)
    p, R = circle.at(T_NS * 1e-9)
    assert np.linalg.norm(inertial.p - p) < 5e-3
    assert np.abs(inertial.R - R).max() < 2e-4
    scan = scanned(swept(circle, inertial))
    yaw = float(np.arctan2(R[1, 0], R[0, 0]))
    # Every upright point lies on a wall, none on ground or roof, and the sweep's distortion is removed.
    assert len(scan.all_xy) > 150
    off = wall_distance_m(in_world(scan.all_xy, p, yaw))
    assert np.percentile(off, 95) < 0.01
    assert off.max() < 0.13  # the mean of both walls in the cell of a corner
    assert len(scan.band_xy) > 150
    assert np.percentile(wall_distance_m(in_world(scan.band_xy, p, yaw)), 95) < 0.01
    # The normals are along the axes, as the walls'.
    normal = in_world(scan.match_xy + scan.normal_xy, p, yaw) - in_world(scan.match_xy, p, yaw)
    some = (scan.normal_xy != 0.0).any(axis=1)
    assert some.mean() > 0.8
    assert np.mean(np.abs(normal[some]).max(axis=1) > 0.999) > 0.95
    # Without motion correction this fails: the vehicle moved 0.2 m during the sweep.
    still = InertialFilter(circle.start)
    still.advance(T_NS)
    still.p, still.q = inertial.p, inertial.q
    bent = scanned(swept(circle, still))
    assert np.percentile(wall_distance_m(in_world(bent.all_xy, p, yaw)), 95) > 0.1


def test_a_beam_says_free_only_while_it_is_at_the_height_of_the_flight() -> None:
    circle = Circle(rest_s=10.0)
    inertial = flown(circle)
    sweep = swept(circle, inertial)
    for height_m, nearest, farthest in ((HEIGHT_M, 5.0, 30.0), (HEIGHT_M + 2.0, 0.0, 0.0)):
        scan = scanned(sweep, height_m)
        assert scan.reach_m.max() <= farthest
        assert np.median(scan.reach_m) >= nearest
    # No cell beyond a wall is free.
    angle = (np.arange(len(scan.reach_m)) + 0.5) / len(scan.reach_m) * 2.0 * np.pi - np.pi
    reach = scanned(sweep).reach_m
    ends = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    xy = in_world(ends, circle.place(0.0), circle.start[3])
    assert xy[:, 0].max() < 24.3
    assert xy[:, 0].min() > -22.1
    assert xy[:, 1].max() < 19.4
    assert xy[:, 1].min() > -17.2


def test_rings_that_look_elsewhere_than_told_say_nothing_by_beams_without_echo() -> None:
    circle = Circle()
    inertial = flown(circle)
    told = swept(circle, inertial)
    assert told.ray_H is not None
    firing_order = tuple(e for pair in zip(RINGS_DEG[:8], RINGS_DEG[8:], strict=True) for e in pair)
    for wrong in (firing_order, RINGS_DEG[:4], tuple(e + 2.0 for e in RINGS_DEG)):
        sweep = swept(circle, inertial, wrong)
        assert sweep.ray_H is None
        # The rings are sorted by elevation all the same.
        np.testing.assert_array_equal(sweep.p_H, told.p_H)


def test_rings_of_the_benchs_lidars_look_where_clients_are_told() -> None:
    scene, _, frames = load_frames("airfield", None)
    for preset in ("vlp16", "os1_64", "hdl32e"):
        lidar: Any = installed("lidar", scene, preset=preset, frames=frames)
        zero = (0.0, 0.0, 0.0)
        truth = TruthState(25, 100_000_000, (0.0, 0.0, 4.0), (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (), False)
        cloud = lidar.sample(truth, 0)
        points = np.asarray(cloud.points_L, float)
        slope = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
        told = np.array(lidar.ring_elevations_deg)
        assert np.abs(slope - told[cloud.ring]).max() < 0.5, preset
        if preset == "vlp16":
            assert SlamSettings().lidar_elevation_deg == lidar.ring_elevations_deg
    frames.close()


def corner_scan(offset: tuple[float, float] = (0.0, 0.0), *, second: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of a wall at y = 6.07 and another at x = 8.03, seen from `offset`."""
    t = np.arange(-6.0, 6.0, 0.11)
    xy = np.stack([t, np.full(len(t), 6.07)], axis=-1)
    normal = np.tile([0.0, -1.0], (len(t), 1))
    if second:
        xy = np.concatenate([xy, np.stack([np.full(len(t), 8.03), t], axis=-1)])
        normal = np.concatenate([normal, np.tile([-1.0, 0.0], (len(t), 1))])
    return xy - np.array(offset), normal


def mapped(particles: int, *, second: bool = True) -> Maps:
    maps = Maps(particles, 0.25, 64.0, 20.0, (0.0, 0.0))
    xy, normal = corner_scan(second=second)
    scan = Scan(xy, normal, xy, xy[:0], np.zeros(720, np.float32))
    for _ in range(3):
        maps.insert(np.arange(particles), np.zeros((particles, 3)), scan)
    return maps


def test_matching_finds_the_pose_to_a_millimetre_whatever_the_grid() -> None:
    maps = mapped(2)
    xy, normal = corner_scan((0.13, -0.09))
    c, s = np.cos(-0.01), np.sin(-0.01)
    turned = xy @ np.array([[c, s], [-s, c]])
    found = match(maps, np.zeros((2, 3)), np.diag([1.0, 1.0, 100.0]), turned, normal @ np.array([[c, s], [-s, c]]))
    assert np.abs(found.pose[0] - (0.13, -0.09, 0.01)).max() < 2e-3
    assert found.inliers.min() > 0.95


def test_matching_along_a_wall_gives_no_information() -> None:
    maps = mapped(1, second=False)
    xy, normal = corner_scan((0.1, 0.05), second=False)
    found = match(maps, np.zeros((1, 3)), np.diag([100.0, 100.0, 1e4]), xy, normal)
    assert abs(found.pose[0, 0]) < 0.02  # stays at the predicted pose
    assert abs(found.pose[0, 1] - 0.05) < 3e-3
    assert found.spread[0, 0, 0] > 50.0 * found.spread[0, 1, 1]


def test_search_finds_what_matching_cannot_reach() -> None:
    maps = mapped(1)
    xy, _ = corner_scan((3.4, -2.7))
    c, s = np.cos(-0.2), np.sin(-0.2)
    found = search(
        maps.hit_xy(0), xy @ np.array([[c, s], [-s, c]]), np.zeros(3), window_m=6.0, window_rad=0.3, cell_m=0.25
    )
    assert np.abs(found.pose[:2] - (3.4, -2.7)).max() < 0.4
    assert abs(found.pose[2] - 0.2) < 0.03
    assert found.share > 0.8
    nowhere = search(maps.hit_xy(0), xy + 400.0, np.zeros(3), window_m=1.0, window_rad=0.1, cell_m=0.25)
    assert nowhere.share < 0.5


def test_tiles_are_shared_until_written_and_the_pool_stays_bounded() -> None:
    particles, across = 6, 4
    tiles = Tiles(particles, across, np.int16)
    whole = np.zeros((particles, across * across, CELLS), np.int16)  # expected cells of each particle, without sharing
    random = np.random.default_rng(2)
    for turn in range(300):
        count = int(random.integers(1, 12))
        pairs = random.choice(particles * across * across, count, replace=False)
        who, where = pairs // (across * across), pairs % (across * across)
        at = tiles.writable(who, where)
        assert len(set(at.tolist())) == count
        cell = int(random.integers(CELLS))
        tiles.pool[at, cell] = turn + 1
        whole[who, where, cell] = turn + 1
        if turn % 3 == 0:
            ancestors = random.integers(0, particles, particles)
            tiles.resample(ancestors)
            whole = whole[ancestors]
    assert (tiles.pool[tiles.table] == whole).all()
    assert (tiles.pool[0] == 0).all()
    assert len(tiles.pool) <= 3 * particles * across * across


def test_resampling_keeps_weights_and_fixes_keep_a_shift() -> None:
    particles = Particles(1000, (0.0, 0.0, 0.0), 1)
    particles.pose[:, 0] = np.arange(1000) < 500
    particles.weigh(np.where(particles.pose[:, 0] > 0.5, np.log(3.0), 0.0))
    assert particles.n_eff == pytest.approx(1.0 / (500 * (3 / 2000) ** 2 + 500 * (1 / 2000) ** 2))
    before = particles.mean()[0]
    particles.resample()
    assert particles.mean()[0] == pytest.approx(before, abs=1e-3)
    assert particles.n_eff == pytest.approx(1000.0)
    # The receiver's shift is estimated: after n fixes its variance is 1 / (1 / V + n / s^2).
    one = Particles(1, (0.0, 0.0, 0.0), 1)
    one.first_fix(4.0)
    for _ in range(50):
        one.add_fix(np.array([2.0, -1.0]), np.zeros(2), 2.25, 0.0)
    variance = 1.0 / (1.0 / 4.0 + 50 / 2.25)
    assert one.shift_variance == pytest.approx(variance)
    assert one.shift[0] == pytest.approx(np.array([2.0, -1.0]) * (1.0 - variance / 4.0))
    one.add_fix(np.array([500.0, 0.0]), np.zeros(2), 2.25, 0.0)  # a jump
    assert one.shift[0, 0] < 2.1


def test_local_plane_agrees_with_the_benchs_geodesy() -> None:
    site = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
    frame = LocalFrame(site)
    plane = LocalPlane(site.latitude_deg, site.longitude_deg, site.altitude_m)
    for p_W in ((120.0, -80.0, 30.0), (-5.0, 3.0, 0.0), (700.0, 700.0, 10.0)):
        off = np.array(plane.enu(*frame.geodetic_from_enu(p_W))) - p_W
        assert np.linalg.norm(off[:2]) < (0.005 if max(p_W) < 500.0 else 0.15)


def test_which_sweeps_are_new() -> None:
    def sweep(t_ns: int, shift: float = 0.0) -> ClientSample:
        points = np.arange(300, dtype=np.float32).reshape(-1, 3) + np.float32(shift)
        return ClientSample("lidar", 0, t_ns, t_ns, {}, {"points_L": points})

    here, there = np.zeros(3), np.array([0.3, 0.0, 0.0])
    still = FreshSweeps()
    assert still.is_new(sweep(10), now_ns=10, p_W=here)
    assert not still.is_new(sweep(10), now_ns=20, p_W=here)  # repeated
    assert not still.is_new(sweep(40), now_ns=30, p_W=here)  # in the future
    assert still.is_new(sweep(50), now_ns=50, p_W=here)  # at rest, without noise
    assert not still.is_new(sweep(60), now_ns=60, p_W=there)  # stuck
    assert still.is_new(sweep(70, 1.0), now_ns=70, p_W=there)
    noisy = FreshSweeps()
    for k in range(8):
        assert noisy.is_new(sweep(10 * k, 0.01 * k), now_ns=10 * k, p_W=here)
    assert not noisy.is_new(sweep(90, 0.07), now_ns=90, p_W=here)  # a noisy LiDAR never repeats
