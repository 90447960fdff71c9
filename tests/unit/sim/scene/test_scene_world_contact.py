"""Flying in a map: nothing is flown through, the clearance is a bound, and skipping work changes no bit."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from signals.samples import TruthState
from sim._kernels import SolidTree
from sim.physics import multirotor
from sim.physics.contact_model import build_model
from sim.physics.flight_start import FlightStart
from sim.physics.integration import Integration
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.maps import catalog
from sim.scene.scene import Scene, load_scene
from sim.scene.solids import solid_tree
from sim.sensors.ground_range import GroundRange
from sim.world_loader import load_world
from tests.worlds import cpu_masks
from tests.worlds.cpu_masks import output_of
from tests.worlds.walled_yard import Pacer, yard, yard_map

TICK_NS = 4_000_000
DOWN_B = (0.0, 0.0, -1.0)
OFF = (0.0,) * 4


@pytest.fixture(scope="module")
def walls(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The yard, compiled once."""
    return yard(tmp_path_factory.mktemp("yard"))


@pytest.fixture
def walked(monkeypatch: pytest.MonkeyPatch) -> Pacer:
    """The actor of the generated yard that `walked_yard` loads."""
    actor = Pacer(y0=2.0)

    class Made:
        parameters = catalog.StrictModel

        @staticmethod
        def generate(_parameters: object, _seed: int) -> object:
            return yard_map(actor)

    monkeypatch.setitem(catalog.GENERATORS, "walked_yard", Made)  # type: ignore[arg-type]
    return actor


_scenes = iter(range(10**6))


def walked_yard() -> Scene:
    """A scene of its own each time, so that no world of an earlier actor is found."""
    plain = load_scene("airfield").model_dump()
    return Scene.model_validate(plain | {"map": {"generator": "walked_yard", "seed": next(_scenes)}})


def fly(
    scene: Scene, start: tuple[float, ...], velocity: tuple[float, ...], ticks: int = 250, *, skipping: bool = True
) -> tuple[list[TruthState], VehiclePhysics]:
    """Thrown from `start` with the rotors at hover."""
    vehicle = load_vehicle("x500")
    physics = VehiclePhysics(
        vehicle, scene, TICK_NS, start=FlightStart(p_WB=start), integration=Integration(contact_skipping=skipping)
    )  # type: ignore[arg-type]
    physics.state[7:10] = velocity
    physics.state[13:17] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
    controls = (multirotor.hover_control(vehicle),) * 4
    return [physics.advance(tick, controls) for tick in range(ticks + 1)], physics


HALF = 0.7071067811865476
TARGETS = {  # name: (somewhere in it, direction from which it is flown into)
    "wall_0": ((6.0, 0.0, 3.0), (-HALF, -HALF, 0.0)),
    "trunk": ((0.0, 8.0, 2.0), (0.0, -1.0, 0.0)),
    "crown_0": ((0.0, 8.0, 4.2), (0.0, -1.0, 0.0)),
    "pole_0": ((0.0, -8.0, 2.0), (1.0, 0.0, 0.0)),
    "ball_0": ((-3.0, -8.0, 3.0), (0.0, 1.0, 0.0)),
    "rock_0": ((8.0, -8.0, 2.0), (0.0, 1.0, 0.0)),
    "hump": ((-12.0, 0.0, 0.8), (0.0, 0.0, 1.0)),
}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("speed", [pytest.param(5.0, marks=pytest.mark.slow), 15.0])
def test_what_is_flown_into_stops_it_and_skipping_changes_no_bit(target: str, speed: float, walls: Scene) -> None:
    target_p, direction = TARGETS[target]
    distance = 2.0  # near enough that at 5 m/s the drag does not stop it before
    start = tuple(p + distance * e for p, e in zip(target_p, direction, strict=True))
    ticks = round(250 * 1.6 * distance / speed)
    flights = [
        fly(walls, start, tuple(-speed * e for e in direction), ticks, skipping=skipping) for skipping in (True, False)
    ]
    (with_skipping, physics), (without, slow) = flights
    assert with_skipping == without
    assert physics.skips.skipped > 0
    assert slow.skips.skipped == 0
    # The origin of B is the middle of a solid sphere: what is not stopped has it on the target's far side by the end.
    before = [sum((s.p_WB[i] - target_p[i]) * direction[i] for i in range(3)) for s in with_skipping]
    assert any(s.in_contact for s in with_skipping)
    assert min(before) > 0.0
    assert min(before) < 1.8  # it came as far as what it was to hit


@pytest.mark.parametrize("speed_known", [True, False])
def test_a_person_is_hit_and_posed_only_when_near(speed_known: bool, walked: Pacer) -> None:
    if not speed_known:
        walked.max_speed_mps = math.inf
    flights, posed = [], []
    for skipping in (True, False):
        walked.posed = 0
        flights.append(fly(walked_yard(), (-1.5, -1.5, 1.2), (0.0, 7.0, 0.0), 350, skipping=skipping))
        posed.append(walked.posed)
    assert flights[0][0] == flights[1][0]
    states = flights[0][0]
    hit = next(i for i, s in enumerate(states) if s.in_contact)
    assert states[hit].p_WB[1] == pytest.approx(2.0, abs=0.8)  # at the person, whose axis is at y = 2
    for s in states:
        (x, y, _), _ = walked.bound(s.t_ns)
        if 0.25 < s.p_WB[2] < 1.25:  # beside a limb of radius 0.25 m; the vehicle's middle is a sphere of 0.06 m
            assert math.hypot(s.p_WB[0] - x, s.p_WB[1] - y) > 0.25
    assert posed[1] >= 350
    assert 0 < posed[0] < 350
    done, of = flights[0][1].actor_poses
    assert (done, of) == (posed[0], 350)
    assert flights[0][1].skips.skipped > 50


def test_a_person_walks_into_a_vehicle_that_stands(walked: Pacer) -> None:
    """The person comes along x = t - 2 and pushes it, with skipping and without the same."""
    states = {}
    for skipping in (True, False):
        walked._y0 = 0.0
        vehicle = load_vehicle("x500")
        physics = VehiclePhysics(
            vehicle,
            walked_yard(),
            TICK_NS,
            start=FlightStart(p_WB=(0.5, 0.0, 0.2289)),
            integration=Integration(contact_skipping=skipping),
        )
        states[skipping] = [physics.advance(tick, OFF) for tick in range(700)]
    assert states[True] == states[False]
    assert states[True][300].p_WB[0] == pytest.approx(0.5, abs=0.02)
    assert states[True][-1].p_WB[0] > 0.7


def test_time_of_the_scene_may_begin_later(walked: Pacer) -> None:
    """At 2 s the person passes x = 0: a vehicle that appears there touches him then, and not at 0 s."""
    touched = {}
    for start_ns in (0, 2_000_000_000):
        physics = VehiclePhysics(
            load_vehicle("x500"), walked_yard(), TICK_NS, start=FlightStart(p_WB=(0.0, 2.0, 1.0), t_ns=start_ns)
        )
        touched[start_ns] = any(physics.advance(tick, OFF).in_contact for tick in range(4))
    assert touched == {0: False, 2_000_000_000: True}


def test_clearance_is_a_lower_bound_of_mujocos_distance_and_tight(walls: Scene) -> None:
    """Against mj_geomDistance from a small sphere to every solid geom."""
    vehicle = load_vehicle("x500")
    tree = solid_tree(load_world(walls))
    model = build_model(walls, vehicle, contact_step_s=0.001)
    data = mujoco.MjData(model)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "vehicle")
    sphere = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "vehicle_body")
    scenery = np.flatnonzero(model.geom_bodyid != body).tolist()
    random = np.random.default_rng(2)
    loose = 0
    points = random.uniform((-15.0, -11.0, 0.1), (11.0, 11.0, 8.0), (400, 3))
    for point in points.tolist():
        data.qpos[:] = (*(point - model.geom_pos[sphere]), 1.0, 0.0, 0.0, 0.0)
        mujoco.mj_kinematics(model, data)
        exact = min(mujoco.mj_geomDistance(model, data, geom, sphere, 50.0, None) for geom in scenery)
        exact += float(model.geom_size[sphere, 0])
        bound = tree.distance(tuple(point))
        assert bound <= max(exact, 0.0) + 1e-6
        loose += bound < exact - 0.01
    assert loose < 0.4 * len(points)  # corners of the ellipsoid's, mesh's and tiles' boxes only


def test_tree_finds_the_nearest_of_many() -> None:
    """Against trying each one; all kinds, turned at random."""
    random = np.random.default_rng(5)
    count = 700
    q = random.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    rotations = np.zeros((count, 9))
    for row, quaternion in zip(rotations, q, strict=True):
        mujoco.mju_quat2Mat(row, quaternion)
    kind = random.choice([2, 3, 4, 5, 6], count).astype(np.int32)
    pose = np.concatenate([random.uniform(-40.0, 40.0, (count, 3)), rotations], axis=1)
    size = random.uniform(0.1, 3.0, (count, 3))
    tree = SolidTree(kind=kind, pose=pose, size=size)
    alone = [SolidTree(kind=kind[i : i + 1], pose=pose[i : i + 1], size=size[i : i + 1]) for i in range(count)]
    assert len(tree) == count
    for point in random.uniform(-60.0, 60.0, (60, 3)).tolist():
        assert tree.distance(tuple(point)) == min(one.distance(tuple(point)) for one in alone)


FLIGHTS = """
import hashlib, sys
from pathlib import Path
from tests.unit.sim.scene.test_scene_world_contact import TARGETS, fly, yard
digest = hashlib.sha256()
for (x, y, z), (ex, ey, ez) in TARGETS.values():
    start, velocity = (x + 2.0 * ex, y + 2.0 * ey, z + 2.0 * ez), (-9.0 * ex, -9.0 * ey, -9.0 * ez)
    states, physics = fly(yard(Path("FOLDER")), start, velocity, 100)
    assert any(s.in_contact for s in states)
    digest.update(repr(states).encode())
print(digest.hexdigest())
"""


def test_masked_cpu_features_change_no_bit_of_contact(tmp_path: Path) -> None:
    """With every shape: MuJoCo's collision functions, the map's compilation and the clearance."""
    text = FLIGHTS.replace("FOLDER", str(tmp_path))
    assert output_of(text, None) == output_of(text, cpu_masks.ALL)


def test_nothing_solid_is_infinitely_far_and_wrong_shapes_are_refused() -> None:
    none = SolidTree(kind=np.zeros(0, np.int32), pose=np.zeros((0, 12)), size=np.zeros((0, 3)))
    assert none.distance((0.0, 0.0, 0.0)) == math.inf
    one = np.zeros((1, 12))
    with pytest.raises(ValueError, match="kind"):
        SolidTree(kind=np.array([7], np.int32), pose=one, size=np.ones((1, 3)))
    one[0, 3] = np.nan
    with pytest.raises(ValueError, match="finite"):
        SolidTree(kind=np.array([6], np.int32), pose=one, size=np.ones((1, 3)))
    with pytest.raises(ValueError, match="length"):
        SolidTree(kind=np.array([6], np.int32), pose=np.zeros((2, 12)), size=np.ones((1, 3)))


def test_contact_model_of_a_map_holds_only_what_is_solid(walls: Scene) -> None:
    world = load_world(walls)
    vehicle = load_vehicle("x500")
    model = build_model(walls, vehicle, contact_step_s=0.001)
    assert (model.nq, model.nv) == (7, 6)
    assert model.ngeom == int(world.geom_solid.sum()) + len(vehicle.contact_spheres)
    assert world.geom_solid.sum() == world.model.ngeom - 2  # the leaf and the shape of group 4
    assert set(model.geom_solimp[:, 4].tolist()) == {2.0}
    assert np.array_equal(model.hfield_data, world.model.hfield_data)
    model.opt.timestep = 99.0
    assert build_model(walls, vehicle, contact_step_s=0.001).opt.timestep == 0.001  # each flight has its own


@pytest.mark.parametrize(
    ("over", "height"),
    [
        ((3.0, 3.0), 4.0),  # only looked at, and that is what a range finder does
        ((-8.0, -8.0), 0.0),  # solid, but not to be seen
        ((-3.0, -8.0), 3.7),  # top of the ball
        ((-12.0, 0.0), 1.8),  # top of the hump
        ((0.0, 8.0), 5.0),  # top of the crown, through the shape that is not drawn
        ((20.0, 20.0), 0.0),
    ],
)
def test_range_finder_sees_what_is_drawn(over: tuple[float, float], height: float, walls: Scene) -> None:
    physics = VehiclePhysics(load_vehicle("x500"), walls, TICK_NS, start=FlightStart(p_WB=(*over, 30.0)))
    truth = physics.advance(0, OFF)
    seen = GroundRange(physics.scene, (0.0, 0.0, 0.0), DOWN_B).distance_m(truth)
    assert seen == pytest.approx(30.0 - height, abs=1e-6)
    assert GroundRange(physics.scene, (0.0, 0.0, -0.5), DOWN_B).distance_m(truth) == pytest.approx(
        29.5 - height, abs=1e-6
    )
