"""Cyclists: what turns follows the distance, hands and feet hold on, and rider and bicycle are two instances."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.view.points import looking_at, pose_of
from sim import _kernels
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames, channel_array
from sim.scene.maps import urban_delivery
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.cyclist import Cyclist, ride
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import PersonTraits, add_cyclist
from sim.scene.maps.vehicles import bicycle_layout as city
from sim.scene.maps.vehicles.ridden_bicycle import RiddenBicycle
from sim.scene.maps.walk_path import WalkPath
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene import load_scene
from sim.scene.scene_map import actor_pose
from sim.scene.world import World
from sim.world_loader import load_world

Float64 = NDArray[np.float64]

HEIGHTS_M = [1.10, 1.40, 1.43, 1.57, 1.75, 1.93, 2.05]
TIMES_NS = (0, 1_000_000_000, 3_210_000_000, 9_876_543_210, 31_415_926_535, 100_000_000_000)


def riding(height_m: float, speed_mps: float = 4.5, ground_m: float = 0.0) -> tuple[Cyclist, RiddenBicycle, MapBuilder]:
    builder = MapBuilder("cyclist")
    path = WalkPath([(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)], speed_mps, corner_m=6.0, start_lap=0.3)
    rng, traits = RandomGenerator(7, "p"), PersonTraits(height_m=height_m)
    person, bicycle = add_cyclist(builder, rng, path, ground_m=ground_m, traits=traits)
    return person, bicycle, builder


def turned(q: Float64) -> Float64:
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, q)
    return R.reshape(3, 3)


def point(pose: tuple[Float64, ...], body: int, local: tuple[float, float, float]) -> Float64:
    return np.asarray(pose[0][body] + turned(pose[1][body]) @ local)


def joint(actor: Cyclist, pose: tuple[Float64, ...], limb: str, end: float) -> Float64:
    """Return the upper (1) or lower (-1) joint of a limb."""
    lengths = {"upper_arm": "upper_arm_m", "forearm": "forearm_m", "thigh": "thigh_m", "shank": "shank_m"}
    half = 0.5 * getattr(actor.figure, lengths[limb.rsplit("_", 1)[0]])
    return point(pose, LIMBS.index(limb), (0.0, 0.0, end * half))


@pytest.mark.parametrize("height_m", HEIGHTS_M)
@pytest.mark.parametrize("speed_mps", [3.0, 6.0])
def test_wheels_and_cranks_follow_the_distance(height_m: float, speed_mps: float) -> None:
    person, bicycle, _ = riding(height_m, speed_mps, ground_m=0.4)
    wheel_m, crank_m = bicycle.size * city.WHEEL_M, bicycle.size * city.CRANK_M
    rolled = bicycle.wheel_turns_per_m * math.tau * wheel_m
    assert rolled == pytest.approx(1.0, abs=0.02)  # a lap has a whole number of turns
    assert bicycle.crank_turns_per_m == pytest.approx(0.5 * bicycle.wheel_turns_per_m, rel=0.05)
    for t_ns in TIMES_NS:
        _, s_m, v_mps = bicycle.path.progress(t_ns)
        x, y, c, s, *_ = bicycle.path.place(s_m)
        pose = actor_pose(bicycle, t_ns)
        heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        assert np.abs(turned(pose[1][0]) - heading).max() < 1e-9
        wheel, cranks = (math.tau * s_m * k for k in (bicycle.wheel_turns_per_m, bicycle.crank_turns_per_m))
        for body, angle in ((1, wheel), (2, wheel), (3, cranks)):
            # A mark ahead of the axle at the start goes down first.
            mark = heading.T @ turned(pose[1][body]) @ [1.0, 0.0, 0.0]
            assert np.abs(mark - [math.cos(angle), 0.0, -math.sin(angle)]).max() < 1e-9
        assert pose[0][1:3, 2] == pytest.approx([0.4 + wheel_m] * 2, abs=1e-12)
        axle = [bicycle.size * value for value in city.CRANK_AXLE_M]
        for body, sign in ((4, 1.0), (5, -1.0)):
            at = heading.T @ (pose[0][body] - [x, y, 0.4])
            circle = [axle[0] + sign * crank_m * math.cos(cranks), 0.0, axle[1] - sign * crank_m * math.sin(cranks)]
            assert np.abs(at - circle).max() < 1e-9
            assert np.abs(turned(pose[1][body]) - heading).max() < 1e-9  # level
        assert person.phase(t_ns) == pytest.approx(cranks / math.tau % 1.0, abs=1e-9)
        assert v_mps <= 1.0001 * speed_mps


@pytest.mark.parametrize("height_m", HEIGHTS_M)
def test_feet_are_on_the_pedals_and_hands_at_the_bar(height_m: float) -> None:
    person, bicycle, _ = riding(height_m)
    grip_x, grip_y, grip_z = (bicycle.size * value for value in city.GRIP_M)
    for t_ns in range(0, 8_000_000_000, 137_000_000):
        rider, ridden = actor_pose(person, t_ns), actor_pose(bicycle, t_ns)
        for side, sign, body in (("l", 1.0, 4), ("r", -1.0, 5)):
            pedal = point(ridden, body, (0.0, sign * bicycle.size * city.PEDAL_Y_M, bicycle.size * city.PEDAL_HALF_M))
            ball = point(rider, LIMBS.index(f"foot_{side}"), (0.075 * height_m, 0.0, -person.figure.ankle_m))
            assert np.linalg.norm(ball - pedal) < 0.001
            grip = point(ridden, 0, (grip_x, sign * grip_y, grip_z))
            assert np.linalg.norm(rider[0][LIMBS.index(f"hand_{side}")] - grip) < 0.03
            # Joints hold together, knees bend forward, and elbows do not lock.
            knee = joint(person, rider, f"thigh_{side}", -1.0)
            ankle, hip = rider[0][LIMBS.index(f"foot_{side}")], joint(person, rider, f"thigh_{side}", 1.0)
            assert np.linalg.norm(knee - joint(person, rider, f"shank_{side}", 1.0)) < 1e-9
            assert np.linalg.norm(ankle - joint(person, rider, f"shank_{side}", -1.0)) < 1e-9
            forward = turned(ridden[1][0])[:, 0]
            assert (knee - 0.5 * (hip + ankle)) @ forward > 0.02
            assert np.linalg.norm(hip - ankle) < 0.97 * person.figure.leg_m
            elbow = joint(person, rider, f"upper_arm_{side}", -1.0)
            shoulder = joint(person, rider, f"upper_arm_{side}", 1.0)
            wrist = joint(person, rider, f"forearm_{side}", -1.0)
            assert np.linalg.norm(elbow - joint(person, rider, f"forearm_{side}", 1.0)) < 1e-9
            hand = point(rider, LIMBS.index(f"hand_{side}"), (0.0, 0.0, person.figure.hand_m))
            assert np.linalg.norm(wrist - hand) < 1e-9
            arm = person.figure.upper_arm_m + person.figure.forearm_m
            assert 0.6 * arm < np.linalg.norm(shoulder - wrist) < 0.95 * arm
        seat = point(ridden, 0, (bicycle.saddle_m[0], 0.0, bicycle.saddle_m[1]))
        assert 0.04 * height_m < rider[0][0][2] - seat[2] < 0.07 * height_m


def test_a_childs_bicycle_is_smaller() -> None:
    assert riding(1.10)[1].size < riding(1.40)[1].size < riding(1.43)[1].size == riding(1.93)[1].size == 1.0


def test_velocities_are_the_derivatives_of_the_poses() -> None:
    h = 20_000
    for actor in riding(1.75)[:2]:
        for t_ns in range(500_000_000, 25_000_000_000, 1_234_567_890):
            before, now, after = (actor_pose(actor, t) for t in (t_ns - h, t_ns, t_ns + h))
            assert np.abs((after[0] - before[0]) / (2e-9 * h) - now[2]).max() < 1e-5
            for i in range(len(actor.bodies)):
                rate = (turned(after[1][i]) - turned(before[1][i])) / (2e-9 * h) @ turned(now[1][i]).T
                assert np.abs(np.array([rate[2, 1], rate[0, 2], rate[1, 0]]) - now[3][i]).max() < 1e-4
            assert np.linalg.norm(now[2][0]) <= actor.max_speed_mps


def test_poses_are_functions_of_time_and_a_lap_closes() -> None:
    for actor in riding(1.6)[:2]:
        lap_ns = round(1e9 * actor.path.lap_s)
        first = {t_ns: actor_pose(actor, t_ns) for t_ns in TIMES_NS}
        for t_ns in reversed(TIMES_NS):
            assert all((a == b).all() for a, b in zip(first[t_ns], actor_pose(actor, t_ns), strict=True))
            for a, b in zip(first[t_ns], actor_pose(actor, t_ns + lap_ns), strict=True):
                assert np.minimum(np.abs(a - b), np.abs(a + b) if a.shape[1] == 4 else np.inf).max() < 1e-6


def test_legs_that_do_not_reach_are_refused() -> None:

    fits = ride(Figure(1.75))
    legs = (*fits.legs[:-7], fits.legs[-7], fits.legs[-6] + 0.2, *fits.legs[-5:])
    with pytest.raises(ValueError, match="do not reach the pedals"):
        _kernels.Walker(
            seated=fits.rows, legs=legs, path=riding(1.75)[0].path, cycles_per_m=0.2, ground_m=0.0, bound_z_m=1.0,
            bound_radius_m=1.0,
        )  # fmt: skip


SCENE = """name: s
description: d
site: {latitude_deg: 1, longitude_deg: 1, altitude_m: 1}
ground_friction: 0.8
map: {generator: %s, seed: 3, walkers: 1, %s cyclists: 3}
"""
FEW = {"city_park": "trees: 0, bushes: 0,", "urban_delivery": "trees: 0, parked_vehicles: 0,"}


@pytest.mark.parametrize("generator", FEW)
def test_a_scene_has_cyclists_with_labels(generator: str, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SCENE % (generator, FEW[generator]))
    world = load_world(load_scene(tmp_path / "s.yaml"))
    people = [actor for actor in world.map.actors if isinstance(actor, Cyclist)]
    bicycles = [actor for actor in world.map.actors if isinstance(actor, RiddenBicycle)]
    assert [f"bicycle_{actor.name}" for actor in people] == [actor.name for actor in bicycles]
    assert len(people) == 3
    names = [world.model.body(int(world.model.geom_bodyid[g])).name for g in range(world.model.ngeom)]
    instances = set()
    for kind, actors in (("person", people), ("bicycle", bicycles)):
        for actor in actors:
            geoms = [g for g, name in enumerate(names) if name in actor.bodies]
            assert {int(world.geom_class[g]) for g in geoms} == {world.class_names.index(kind)}
            (instance,) = {int(world.geom_instance[g]) for g in geoms}
            assert world.instance_names[instance] == actor.name
            assert (world.geom_instance == instance).sum() == len(geoms)
            assert any(world.model.geom_contype[g] for g in geoms)
            instances.add(instance)
            assert 3.0 <= actor.path.speed_mps <= 6.0
    assert len(instances) == 6
    _seen_from_ahead(world, people[0], bicycles[0])


def _seen_from_ahead(world: World, person: Cyclist, bicycle: RiddenBicycle) -> None:
    """Check that a picture shows both instances, which come nearer at the speed of the ride."""
    t_ns = 2_000_000_000
    p, _, v, _ = actor_pose(person, t_ns)
    speed_mps = float(np.linalg.norm(v[1]))
    camera, frames = CameraModel.from_fov(240, 240, 20.0), SharedFrames(world)
    at = p[1] + 8.0 * v[1] / speed_mps
    frames.expect(t_ns)
    out = {name: channel_array(name, camera) for name in ("instance", "radial_velocity")}
    renderer = frames.renderer(camera, near_m=0.05, far_m=100.0, supersample=1, shadows=False)
    pose = pose_of(looking_at("x", tuple(at.tolist()), tuple(p[0].tolist())))
    renderer.render(Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose(pose), out)
    for actor in (person, bicycle):
        shown = out["instance"] == world.instance_names.index(actor.name)
        assert shown.sum() > 300
        assert -np.median(out["radial_velocity"][shown]) == pytest.approx(speed_mps, rel=0.1)


@pytest.mark.parametrize("generator", ["city_park", "urban_delivery"])
def test_cyclists_change_nothing_else(generator: str) -> None:

    made = GENERATORS[generator]
    without, with_them = (made.generate(made.parameters(cyclists=n), 3) for n in (0, 2))
    models = [mujoco.MjModel.from_xml_string(m.mjcf, dict(m.assets)) for m in (without, with_them)]
    poses = [
        {m.geom(g).name: (m.geom_pos[g].tolist(), m.body_pos[m.geom_bodyid[g]].tolist()) for g in range(m.ngeom)}
        for m in models
    ]
    assert poses[0].items() <= poses[1].items()
    assert len(with_them.actors) == len(without.actors) + 4 > 4


@pytest.mark.parametrize("seed", [1, 2])
def test_cyclists_keep_clear_of_parked_vehicles(seed: int) -> None:
    scene_map = urban_delivery.generate(urban_delivery.Parameters(cyclists=2, trees=0), seed)
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    parked = [
        g for g in range(model.ngeom)
        if model.geom_group[g] < 3 and model.body(model.geom_bodyid[g]).name.startswith(("car_", "van_", "bus_", "lor"))
    ]  # fmt: skip
    assert len(parked) > 50
    R = data.geom_xmat[parked].reshape(-1, 3, 3)
    centres = data.geom_xpos[parked] + np.einsum("nij,nj->ni", R, model.geom_aabb[parked, :3])
    for bicycle in (actor for actor in scene_map.actors if isinstance(actor, RiddenBicycle)):
        for k in range(60):
            p, q, _, _ = actor_pose(bicycle, k * 700_000_000)
            own = turned(q[0])
            half = np.einsum("nij,nj->ni", np.abs(own.T @ R), model.geom_aabb[parked, 3:])
            gap = np.abs((centres - p[0]) @ own) - half - [0.9, 0.32, 0.0]
            assert gap[:, :2].max(axis=1).min() > 0.1
