"""Ground and boxes: rest, landing, and proof that skipping contact work changes no bit."""

from __future__ import annotations

import pytest

from hil.signals.samples import TruthState
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle, vehicle_names
from sim.scene.scene import Box, Scene, load_scene

TICK_NS = 4_000_000
OFF = (0.0,) * 4
VEHICLES = vehicle_names()


@pytest.fixture(scope="module")
def airfield() -> Scene:
    return load_scene("airfield")


def upright(truth: TruthState) -> float:
    """Cosine of the tilt."""
    _, x, y, _ = truth.q_WB
    return 1.0 - 2.0 * (x * x + y * y)


@pytest.mark.parametrize("name", VEHICLES)
def test_stands_still(name: str, airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle(name), airfield, TICK_NS, initial_yaw_rad=0.7)
    start = physics.advance(0, OFF)
    assert start.in_contact
    for tick in range(1, 1251):
        truth = physics.advance(tick, OFF)
        assert truth.p_WB == pytest.approx(start.p_WB, abs=1e-6)
        assert max(abs(v) for v in truth.v_WB_W + truth.w_WB_B) < 1e-6
        assert truth.in_contact
    assert start.p_WB[2] == pytest.approx(physics.vehicle.standing_height_m, abs=1e-4)


@pytest.mark.parametrize("name", VEHICLES)
def test_idling_rotors_do_not_walk_it(name: str, airfield: Scene) -> None:
    """Half the hover thrust with a yaw torque: the feet hold it."""
    physics = QuadrotorPhysics(load_vehicle(name), airfield, TICK_NS)
    start = physics.advance(0, OFF)
    hover = physics.vehicle.hover_control
    for tick in range(1, 1251):
        truth = physics.advance(tick, (0.5 * hover, 0.5 * hover, 0.4 * hover, 0.4 * hover))
    assert truth.p_WB == pytest.approx(start.p_WB, abs=2e-3)
    assert abs(truth.q_WB[3]) < 5e-3


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, 0.05)])
def test_drop_from_half_a_metre_comes_to_rest(name: str, tilt: tuple[float, float], airfield: Scene) -> None:
    vehicle = load_vehicle(name)
    height = vehicle.standing_height_m
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=(0.0, 0.0, height + 0.5))
    w = (1.0 - tilt[0] ** 2 - tilt[1] ** 2) ** 0.5
    physics.state[3:7] = (w, tilt[0], tilt[1], 0.0)
    truth = physics.advance(0, OFF)
    lowest_foot = 0.0
    for tick in range(1, 751):
        truth = physics.advance(tick, OFF)
        lowest_foot = min(lowest_foot, truth.p_WB[2] - height if tilt == (0.0, 0.0) else 0.0)
    assert lowest_foot > -5e-3
    assert truth.p_WB[2] == pytest.approx(height, abs=1e-3)
    assert max(abs(v) for v in truth.v_WB_W + truth.w_WB_B) < 1e-4
    assert upright(truth) > 0.99999


def test_lands_with_sideways_speed_without_tipping(airfield: Scene) -> None:
    vehicle = load_vehicle("x500")
    physics = QuadrotorPhysics(vehicle, airfield, TICK_NS, initial_p_WB=(0.0, 0.0, vehicle.standing_height_m + 0.05))
    physics.state[7:10] = (0.4, -0.3, -0.7)
    worst = 1.0
    truth = physics.advance(0, OFF)
    for tick in range(1, 751):
        truth = physics.advance(tick, OFF)
        worst = min(worst, upright(truth))
    assert worst > 0.9
    assert upright(truth) > 0.99999
    assert max(abs(v) for v in truth.v_WB_W) < 1e-4


def test_upside_down_rests_on_its_hull(airfield: Scene) -> None:
    physics = QuadrotorPhysics(load_vehicle("x500"), airfield, TICK_NS, initial_p_WB=(0.0, 0.0, 0.2))
    physics.state[3:7] = (0.0, 1.0, 0.0, 0.0)
    physics.advance(0, OFF)
    for tick in range(1, 501):
        truth = physics.advance(tick, OFF)
    assert upright(truth) < -0.99
    assert 0.03 < truth.p_WB[2] < 0.1


def hop(scene: Scene, *, contact_skipping: bool) -> tuple[list[TruthState], QuadrotorPhysics]:
    """Stand, take off open-loop with a small turn, fly, fall, land, stand."""
    physics = QuadrotorPhysics(load_vehicle("x500"), scene, TICK_NS, contact_skipping=contact_skipping)
    h = physics.vehicle.hover_control
    plan = [(50, OFF), (220, (1.04 * h,) * 4), (20, (h, h, 1.002 * h, 1.002 * h)), (100, (0.97 * h,) * 4)]
    plan += [(250, (0.95 * h,) * 4), (200, OFF)]
    states = [physics.advance(0, OFF)]
    for ticks, controls in plan:
        for _ in range(ticks):
            states.append(physics.advance(len(states), controls))
    return states, physics


def test_contact_skipping_changes_no_bit(airfield: Scene) -> None:
    with_skipping, fast = hop(airfield, contact_skipping=True)
    without, slow = hop(airfield, contact_skipping=False)
    assert with_skipping == without
    assert slow.skips.skipped == 0
    assert fast.skips.skipped > 100
    assert fast.skips.touching == slow.skips.touching > 100
    assert fast.skips.skipped + fast.skips.queried == slow.skips.queried
    assert max(s.p_WB[2] for s in with_skipping) > 0.7  # it did fly
    assert with_skipping[-1].in_contact
    assert upright(with_skipping[-1]) > 0.9999


def test_contact_skipping_near_boxes_changes_no_bit(airfield: Scene) -> None:
    wall = Box(name="wall", center_m=(3.0, 0.0, 5.0), size_m=(0.4, 20.0, 10.0))
    scene = airfield.model_copy(update={"boxes": (wall,)})
    flights = []
    for contact_skipping in (True, False):
        physics = QuadrotorPhysics(
            load_vehicle("x500"), scene, TICK_NS, contact_skipping=contact_skipping, initial_p_WB=(0.0, 0.0, 6.0)
        )
        physics.state[7] = 5.0
        flights.append([physics.advance(0, OFF)] + [physics.advance(k, (0.75,) * 4) for k in range(1, 400)])
    assert flights[0] == flights[1]
    assert any(s.in_contact for s in flights[0])
    reach = load_vehicle("x500").bounding_radius_m
    assert max(s.p_WB[0] for s in flights[0]) < 2.8 + 5e-2  # it bounced off, and did not go through
    assert max(s.p_WB[0] for s in flights[0]) > 2.8 - reach


def test_box_stops_a_fall(airfield: Scene) -> None:
    roof = Box(name="roof", center_m=(0.0, 0.0, 2.0), size_m=(4.0, 4.0, 4.0))
    scene = airfield.model_copy(update={"boxes": (roof,)})
    vehicle = load_vehicle("iris")
    physics = QuadrotorPhysics(vehicle, scene, TICK_NS, initial_p_WB=(0.0, 0.0, 4.5))
    physics.advance(0, OFF)
    for tick in range(1, 501):
        truth = physics.advance(tick, OFF)
    assert truth.p_WB[2] == pytest.approx(4.0 + vehicle.standing_height_m, abs=1e-3)
    assert truth.in_contact


def test_two_flights_in_one_process_do_not_touch_each_other(airfield: Scene) -> None:
    alone, _ = hop(airfield, contact_skipping=True)
    a = QuadrotorPhysics(load_vehicle("x500"), airfield, TICK_NS)
    b = QuadrotorPhysics(load_vehicle("iris"), airfield, TICK_NS)
    a.advance(0, OFF)
    b.advance(0, OFF)
    for tick in range(1, 60):
        b.advance(tick, (0.9,) * 4)
        truth = a.advance(tick, OFF if tick <= 50 else (1.04 * a.vehicle.hover_control,) * 4)
        assert truth == alone[tick]
