"""LiDAR: clouds of worlds known by formula, rolling over motion, echoes, noise, limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest
from numpy.typing import NDArray

from signals.noise import NoiseStream
from signals.samples import PointCloudSample, TruthState
from sim.frame.geometry import FrameGeometry
from sim.frame.source import SharedFrames
from sim.scene.scene import load_scene
from sim.sensors.lidar import Lidar
from sim.sensors.lidar_echo import choose_echoes
from sim.sensors.sweep_motion import sweep_motion
from sim.world_loader import load_world
from tests.worlds.installed_sensor import installed
from tests.worlds.mjcf_world import ModelFrames, compiled, truth_at
from tests.worlds.rotation_matrices import rotation

T_NS = 100_000_000
SCENE = load_scene("airfield")
EXACT: dict[str, Any] = {
    "range_noise_m": 0.0,
    "range_resolution_m": 1e-6,
    "dropout_probability": 0.0,
    "range_at_10_percent_m": None,
}
FAN = {
    "kind": "spinning",
    "elevation_deg": (-20.0, -10.0, -2.0, 0.0, 3.0),
    "firing_ns": 2000,
    "columns": 400,
}
BALLS = (
    '<mujoco><worldbody><geom name="ground" type="plane" size="0 0 1"/>'
    '<geom name="ball" type="sphere" size="2" pos="9 3 2"/></worldbody></mujoco>'
)


def frames_of(mjcf: str, **options: Any) -> ModelFrames:
    return ModelFrames(*compiled(mjcf), **options)


def lidar(frames: Any, *, name: str = "lidar", seed: int = 1, preset: str = "vlp16", **overrides: Any) -> Lidar:
    values = ({"pattern": FAN} if preset == "vlp16" else {}) | overrides
    made = installed(name, SCENE, preset=preset, overrides=values, seed=seed, frames=frames)
    assert isinstance(made, Lidar)
    return made


def in_world(cloud: PointCloudSample) -> NDArray[Any]:
    """Points as if all were of the capture."""
    return cloud.points_L.astype(float) @ rotation(cloud.q_WL).T + cloud.p_WL


def off_surface_m(points_W: NDArray[Any], ids: NDArray[Any]) -> NDArray[Any]:
    """Distance of points from the ground (class 1) or the ball (class 2) of BALLS."""
    from_ball = np.abs(np.linalg.norm(points_W - [9, 3, 2], axis=1) - 2.0)
    return np.where(ids == 2, from_ball, np.abs(points_W[:, 2]))


def test_a_still_lidar_sees_the_surfaces_where_they_are() -> None:
    frames = frames_of(BALLS, reflectivity={"ball": 0.8, "ground": 0.3})
    turned = truth_at(5 * T_NS, q_WB=(0.8, 0.0, 0.0, 0.6), p_WB=(1.0, -1.0, 2.0))
    sensor = lidar(frames, mount_m=(0.2, -0.1, 0.3), mount_rpy_deg=(4.0, 6.0, -30.0), latency_s=0.02, **EXACT)
    cloud = sensor.sample(turned, 4)
    assert cloud[:3] == (4, 5 * T_NS, 5 * T_NS + 20_000_000)
    assert set(cloud.segmentation.tolist()) == {1, 2}
    assert off_surface_m(in_world(cloud), cloud.segmentation).max() < 2e-5
    assert np.linalg.norm(cloud.points_L, axis=1) == pytest.approx(cloud.range_m, rel=1e-6)
    # Mount: R_WL = Rz(yaw of the vehicle) Rz(-30) Ry(6) Rx(4), origin turned with the vehicle.
    assert np.array(cloud.p_WL) == pytest.approx(
        np.array([1.0, -1.0, 2.0]) + rotation((0.8, 0, 0, 0.6)) @ [0.2, -0.1, 0.3]
    )
    half = np.radians([2.0, 3.0, -15.0])
    x, y, z = [[c, *np.eye(3)[i] * s] for i, (c, s) in enumerate(zip(np.cos(half), np.sin(half), strict=True))]
    assert rotation(cloud.q_WL) == pytest.approx(
        rotation((0.8, 0, 0, 0.6)) @ rotation(z) @ rotation(y) @ rotation(x), abs=1e-12
    )
    # Lambert: reflectivity times the cosine of incidence.
    points, rays = in_world(cloud), (in_world(cloud) - cloud.p_WL) / cloud.range_m[:, None]
    ball = cloud.segmentation == 2
    normal = np.where(ball[:, None], (points - [9, 3, 2]) / 2.0, [0, 0, 1.0])
    expected = np.where(ball, 0.8, 0.3) * -np.sum(normal * rays, axis=1)
    assert cloud.intensity == pytest.approx(expected, abs=1e-4)


def test_dtypes_and_lengths() -> None:
    sensor = lidar(frames_of(BALLS))
    a = sensor.sample(truth_at(T_NS), 1)
    n = len(a.range_m)
    kinds = {
        "points_L": "<f4",
        "range_m": "<f4",
        "intensity": "<f4",
        "ring": "<u2",
        "time_offset_ns": "<i4",
        "segmentation": "|u1",
    }
    assert n > 500
    for field, kind in kinds.items():
        values = getattr(a, field)
        assert values.shape == ((n, 3) if field == "points_L" else (n,))
        assert values.dtype == np.dtype(kind)
        assert not values.flags.writeable
    assert set(a.ring.tolist()) <= set(range(5))
    assert a.time_offset_ns.min() >= -T_NS
    assert a.time_offset_ns.max() < 0
    assert ((a.intensity >= 0) & (a.intensity <= 1)).all()


def moving(t_ns: int) -> TruthState:
    """12 m/s ahead while turning at 1.5 rad/s."""
    t, rate = t_ns * 1e-9, 1.5
    half = 0.5 * rate * t
    return truth_at(
        t_ns,
        p_WB=(12.0 * t - 4.0, 0.5 * t, 2.0),
        v_WB_W=(12.0, 0.5, 0.0),
        q_WB=(math.cos(half), 0.0, 0.0, math.sin(half)),
        w_WB_B=(0.0, 0.0, rate),
    )


def test_a_rolling_sweep_is_bent_by_the_motion_and_can_be_straightened() -> None:
    sensor = lidar(frames_of(BALLS), **EXACT)
    sensor.sample(moving(2 * T_NS), 0)
    cloud = sensor.sample(moving(3 * T_NS), 1)
    straight = np.empty((len(cloud.range_m), 3))
    for i, (p_L, offset_ns) in enumerate(zip(cloud.points_L, cloud.time_offset_ns, strict=True)):
        then = moving(3 * T_NS + int(offset_ns))
        straight[i] = rotation(then.q_WB) @ p_L.astype(float) + then.p_WB
    assert (cloud.segmentation == 2).sum() > 20
    assert off_surface_m(straight, cloud.segmentation).max() < 5e-5
    assert off_surface_m(in_world(cloud), cloud.segmentation).max() > 0.3
    # Of one instant: straight without more ado.
    at_once = lidar(frames_of(BALLS), rolling=False, **EXACT).sample(moving(3 * T_NS), 1)
    assert (at_once.time_offset_ns == 0).all()
    assert off_surface_m(in_world(at_once), at_once.segmentation).max() < 5e-5


def test_the_truth_before_counts_only_if_recent() -> None:
    """After a gap of three periods the motion is told by the rates alone, as in the first sweep."""
    later = moving(9 * T_NS)._replace(a_WB_W=(1.0, 2.0, 3.0))
    fresh, gap, steady = (lidar(frames_of(BALLS), **EXACT) for _ in range(3))
    gap.sample(moving(6 * T_NS), 6)
    steady.sample(moving(8 * T_NS), 8)
    first = fresh.sample(later, 9)
    assert first == gap.sample(later, 9)
    assert first != steady.sample(later, 9)
    assert sweep_motion(later, None) != sweep_motion(later, moving(8 * T_NS))


def test_what_moves_is_met_within_half_a_part_of_the_sweep_of_where_it_is() -> None:
    """A wall that comes at 5 m/s: 25 mm with ten parts of a sweep of 0.1 s; the scene is left as of the capture."""
    wall = '<body mocap="true" pos="20 0 2"><geom type="box" size="1 50 9"/></body>'
    mjcf = f"<mujoco><worldbody>{wall}</worldbody></mujoco>"
    frames = frames_of(mjcf, speed_mps=((-5.0, 0.0, 0.0),))
    for parts, most_m in ((10, 0.025), (1, 0.25), (100, 0.0025)):
        frames.posed.clear()
        cloud = lidar(frames, subsweeps=parts, **EXACT).sample(truth_at(10 * T_NS), 9)
        wall_m = 19.0 - 5.0 * (1.0 + cloud.time_offset_ns * 1e-9)
        error_m = np.abs(cloud.points_L[:, 0] - wall_m)
        assert 0.3 * most_m < error_m.max() < most_m + 1e-3
        assert frames.t_ns == 10 * T_NS  # for who looks next
        assert len(frames.posed) == parts
        assert (np.diff(frames.posed) > 0).all()


@pytest.mark.parametrize("divergence_rad", [0.0, 0.003])
def test_people_out_of_reach_are_not_posed_and_change_no_point(
    divergence_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = load_world(load_scene("city_park"))
    pose_within = FrameGeometry.pose_within
    person = world.class_names.index("person")

    def clouds(reach_m: float) -> tuple[list[PointCloudSample], int]:
        frames = SharedFrames(world)
        sensor = lidar(frames, beam_divergence_rad=divergence_rad, max_range_m=reach_m)
        before = frames.posed
        return [sensor.sample(moving((k + 1) * T_NS), k) for k in range(2)], frames.posed - before

    found = {reach_m: clouds(reach_m) for reach_m in (3.0, 40.0)}
    monkeypatch.setattr(FrameGeometry, "pose_within", lambda geometry, _=None: pose_within(geometry))
    people, parts = len(world.map.actors), 2 * 10
    for reach_m, (some, posed) in found.items():
        everybody, all_posed = clouds(reach_m)
        assert some == everybody
        assert all_posed == people * parts  # once a part, however many rays a footprint has
        assert (posed == 0) if reach_m == 3.0 else (0 < posed < all_posed)
    assert sum((cloud.segmentation == person).sum() for cloud in found[40.0][0]) > 0


def test_noise_has_its_deviation_and_its_step() -> None:
    frames = frames_of(BALLS)
    exact, rough = lidar(frames, **EXACT), lidar(frames, **EXACT | {"range_noise_m": 0.03, "range_resolution_m": 0.004})
    errors = []
    for seq in range(6):
        true_m = exact.sample(truth_at(T_NS), seq).range_m.astype(float)
        got_m = rough.sample(truth_at(T_NS), seq).range_m.astype(float)
        assert np.abs(got_m / 0.004 - np.round(got_m / 0.004)).max() < 0.01  # float32
        errors.append(got_m - true_m)
    z = np.concatenate(errors)
    n = len(z)
    assert n > 5000
    assert abs(z.mean()) < 5 * 0.03 / math.sqrt(n)
    assert z.std() == pytest.approx(math.hypot(0.03, 0.004 / math.sqrt(12)), rel=5 / math.sqrt(2 * n))
    # Ray i of sweep `seq` has draw seq * rays + i of the named stream.
    sensor = lidar(
        frames_of('<mujoco><worldbody><geom type="sphere" size="9" pos="0 0 2"/></worldbody></mujoco>'),
        **EXACT | {"range_noise_m": 0.5},
    )
    cloud, stream = sensor.sample(truth_at(T_NS), 3), NoiseStream(1, "lidar.range")
    assert len(cloud.range_m) == 2000
    expected = [9.0 + 0.5 * stream.normal(3 * 2000 + i)[0] for i in range(2000)]
    assert cloud.range_m == pytest.approx(np.array(expected), abs=2e-6)


def wall(reflectivity: float, x_m: float) -> ModelFrames:
    text = (
        f'<mujoco><worldbody><geom name="wall" type="box" size="0.5 30 30" pos="{x_m + 0.5} 0 2"/></worldbody></mujoco>'
    )
    return frames_of(text, reflectivity={"wall": reflectivity})


def test_range_limits_and_what_stands_in_the_way() -> None:
    """A thing too near gives no point, but hides what is behind it."""
    narrow = FAN | {"elevation_deg": (0.0,), "columns": 360}
    both = (
        '<mujoco><worldbody><geom type="box" size="0.1 0.1 0.1" pos="0.5 0 2"/>'
        '<geom type="box" size="0.5 30 30" pos="10.5 0 2"/></worldbody></mujoco>'
    )
    near = lidar(frames_of(both), **EXACT | {"pattern": narrow, "min_range_m": 1.0}).sample(truth_at(T_NS), 0)
    assert not (np.abs(np.arctan2(near.points_L[:, 1], near.points_L[:, 0])) < 0.2).any()
    assert len(near.range_m) > 50
    assert len(lidar(wall(0.5, 30.0), **EXACT | {"max_range_m": 29.9}).sample(truth_at(T_NS), 0).range_m) == 0
    some = lidar(wall(0.5, 30.0), **EXACT | {"max_range_m": 29.9, "range_noise_m": 0.1}).sample(truth_at(T_NS), 0)
    assert len(some.range_m) > 0
    assert some.range_m.max() <= np.float32(29.9)


def test_echoes_by_hand() -> None:
    inf = np.inf
    range_m = np.array(
        [[5.0, 5.0, inf, 9.0], [5.1, 9.0, inf, 5.0], [9.0, inf, inf, 5.2], [9.1, 20.0, inf, 5.4], [inf, 9.2, inf, inf]]
    )
    strength = np.array(
        [[1.0, 0.1, 0.0, 0.5], [0.5, 0.4, 0.0, 0.5], [0.9, 0.0, 0.0, 0.5], [0.9, 0.2, 0.0, 0.5], [0.0, 0.4, 0.0, 0.0]]
    )
    geom = np.array([[1, 2, -1, 3], [4, 5, -1, 6], [7, -1, -1, 8], [9, 10, -1, 11], [-1, 12, -1, -1]], np.int32)
    first, last, strongest = (
        choose_echoes(range_m, strength, geom, which=which, separation_m=0.3)
        for which in ("first", "last", "strongest")
    )
    assert first.range_m == pytest.approx([(5.0 + 0.5 * 5.1) / 1.5, 5.0, inf, 5.2])
    assert first.strength == pytest.approx([0.3, 0.02, 0.0, 0.3])
    assert first.geom.tolist() == [1, 2, -1, 6]
    assert last.range_m == pytest.approx([9.05, 20.0, inf, 9.0])
    assert last.geom.tolist() == [7, 10, -1, 3]
    assert strongest.range_m == pytest.approx([9.05, 9.1, inf, 5.2])  # 0.36 against 0.3; 0.16 against 0.02 and 0.04
    assert strongest.strength == pytest.approx([0.36, 0.16, 0.0, 0.3])
    # A black surface still has a range.
    black = choose_echoes(range_m, 0.0 * strength, geom, which="first", separation_m=0.3)
    assert black.range_m == pytest.approx([5.05, 5.0, inf, 5.2])


def test_a_wide_beam_at_an_edge_meets_both_surfaces() -> None:
    edge = (
        '<mujoco><worldbody><geom name="near" type="box" size="0.5 10 10" pos="10.5 10 2"/>'
        '<geom name="far" type="box" size="0.5 60 60" pos="30.5 0 2"/></worldbody></mujoco>'
    )
    frames = frames_of(edge, reflectivity={"near": 0.9, "far": 0.2})
    fan = FAN | {"elevation_deg": (0.0,), "columns": 3600}

    def along(echo: str, **changes: Any) -> NDArray[Any]:
        options = EXACT | {"pattern": fan, "beam_divergence_rad": 0.02, "echo": echo} | changes
        cloud = lidar(frames, **options).sample(truth_at(T_NS), 0)
        angle = np.arctan2(cloud.points_L[:, 1], cloud.points_L[:, 0])
        return np.round(cloud.points_L[np.abs(angle) < 0.02, 0], 2)

    counts = {echo: int((along(echo) < 20.0).sum()) for echo in ("first", "last", "strongest")}
    plain = int((along("first", beam_divergence_rad=0.0) < 20.0).sum())
    # Half the footprint reaches 5 mrad, about three rays of 1.75 mrad, over the edge.
    assert counts["first"] - plain in (2, 3)
    assert plain - counts["last"] in (2, 3)
    assert counts["last"] < counts["strongest"] <= counts["first"]


def test_a_lidar_with_a_million_points_is_refused() -> None:
    huge = FAN | {"elevation_deg": tuple(float(x) for x in range(-80, 80)), "columns": 100_000}
    with pytest.raises(ValueError, match="16000000 points"):
        lidar(frames_of(BALLS), pattern=huge)
    with pytest.raises(pydantic.ValidationError, match="must be above min_range_m"):
        lidar(frames_of(BALLS), min_range_m=200.0)
    with pytest.raises(pydantic.ValidationError, match="echo"):
        lidar(frames_of(BALLS), echo="loudest")
