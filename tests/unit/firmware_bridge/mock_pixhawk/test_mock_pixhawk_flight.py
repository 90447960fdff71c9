"""Closed loop: the mock flies the simulated X500 through its real messages, in one process."""

import math

import pytest

from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.mock_pixhawk.ids import MissionState
from firmware_bridge.mock_pixhawk.modes import Mode
from signals.mission import MissionItem
from tests.worlds.mock_pixhawk_world import World, messages, results, sticks, texts

# The rectangle's corners in W (m east, north), from the plan.
GROUND_M = 0.229  # height of the X500's centre of mass when it stands
NAN = math.nan
M_PER_DEGE7_N, M_PER_DEGE7_E = 0.0111174, 0.0075437


def set_mode(world, mode):
    world.command(176, 1, mode.value.main, mode.value.sub)


def airborne(altitude=5.0, ground_m=GROUND_M, **autopilot):
    """Return a vehicle that has taken off and holds at `altitude` metres above home."""
    world = World(params=[f"MIS_TAKEOFF_ALT={altitude}", *autopilot.pop("params", ())], **autopilot)
    world.run(5.0)
    set_mode(world, Mode.TAKEOFF)
    world.step()
    world.command(400, 1)
    world.run_until(lambda w: w.autopilot.vehicle.mode is Mode.LOITER, 20.0)
    world.run(2.0)
    assert world.truth.p_WB[2] - ground_m == pytest.approx(altitude, abs=0.3)
    return world


def east_north(world):
    return world.truth.p_WB[0], world.truth.p_WB[1]


def speed(world):
    return math.hypot(*world.truth.v_WB_W[:2])


def landed_and_disarmed(world):
    return not world.autopilot.vehicle.armed


def test_another_airframe():
    world = airborne(vehicle="iris", ground_m=0.11)
    place = east_north(world)
    world.run(5.0)
    assert math.dist(place, east_north(world)) < 0.2
    world.command(192, 4, 1, 0, 0.0, 47.397742 + 20 / 111_174, 8.545594, NAN)
    world.run(10.0)
    assert east_north(world)[1] == pytest.approx(20.0, abs=0.4)
    assert abs(world.autopilot.firmware.estimate.euler[2]) < 0.1  # commanded to face north
    set_mode(world, Mode.LAND)
    world.run_until(landed_and_disarmed, 30.0)


def test_takeoff_holds_and_landing_disarms():
    world = airborne()
    east, north = east_north(world)
    frames = world.run(5.0)
    assert math.dist((east, north), east_north(world)) < 0.15
    assert messages(frames, "EXTENDED_SYS_STATE")[-1].landed_state == 2
    set_mode(world, Mode.LAND)
    touchdown = []
    world.each_tick = lambda w: touchdown.append(w.truth.v_WB_W[2]) if w.truth.in_contact else None
    frames = world.run_until(landed_and_disarmed, 30.0)
    assert "Disarmed by landing" in texts(frames)
    assert min(touchdown) > -0.6  # slow near the ground
    assert math.dist((east, north), east_north(world)) < 0.3


def test_takeoff_to_a_commanded_altitude():
    world = World()
    world.run(5.0)
    world.command(400, 1)
    world.step()
    world.command(22, NAN, 0, 0, NAN, NAN, NAN, 488.0 + 7.0)
    frames = world.run(0.01)
    assert results(frames) == [(22, 0)]
    world.run_until(lambda w: w.autopilot.vehicle.mode is Mode.LOITER, 20.0)
    assert world.truth.p_WB[2] == pytest.approx(7.0, abs=0.3)


def test_return_climbs_comes_home_and_lands():
    world = airborne(params=["RTL_RETURN_ALT=12", "RTL_DESCEND_ALT=10"])
    world.command(192, 8, 1, 0, NAN, 47.397742 + 30 / 111_174, 8.545594, NAN)
    world.run(12.0)
    assert east_north(world)[1] == pytest.approx(30.0, abs=0.5)
    set_mode(world, Mode.RTL)
    heights = []
    world.each_tick = lambda w: heights.append(w.truth.p_WB[2])
    world.run_until(landed_and_disarmed, 60.0)
    assert max(heights) == pytest.approx(12.0 + GROUND_M, abs=0.4)
    assert math.hypot(*east_north(world)) < 0.3
    assert world.autopilot.vehicle.mode is Mode.LOITER


def test_reposition_at_a_speed_and_only_in_flight():
    world = World()
    world.run(5.0)
    world.command(192, -1, 1, 0, NAN, 47.3979, 8.5456, 495.0)
    assert results(world.run(0.01)) == [(192, 2)]
    world = airborne()
    world.command(192, 2, 1, 0, NAN, 47.397742 + 20 / 111_174, 8.545594, 488.0 + 5.0)
    world.run(5.0)
    assert speed(world) == pytest.approx(2.0, abs=0.2)
    world.run(9.0)
    assert east_north(world)[1] == pytest.approx(20.0, abs=0.4)


def target(world, **fields):
    zeros = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    head = {"time_boot_ms": 0, "target_system": 1, "target_component": 1, "coordinate_frame": 1, "type_mask": 0}
    world.send("SET_POSITION_TARGET_LOCAL_NED", **(head | zeros | fields))


def stream(world, seconds, **fields):
    """Send offboard setpoints at 10 Hz."""
    frames = []
    for _ in range(round(seconds * 10)):
        target(world, **fields)
        frames += world.run(0.1)
    return frames


def test_offboard_position_then_velocity_then_loss():
    world = airborne()
    set_mode(world, Mode.OFFBOARD)
    assert results(world.run(0.01)) == [(176, 1)]  # no setpoints yet
    stream(world, 1.0, type_mask=0xDF8, x=8.0, y=3.0, z=-6.0)
    set_mode(world, Mode.OFFBOARD)
    frames = stream(world, 9.0, type_mask=0xDF8, x=8.0, y=3.0, z=-6.0)
    assert (176, 0) in results(frames)
    assert east_north(world) == pytest.approx((3.0, 8.0), abs=0.3)
    stream(world, 4.0, type_mask=0xDC7, vx=1.0, vy=-0.5, vz=0.0)
    v = world.truth.v_WB_W
    assert (v[1], v[0]) == pytest.approx((1.0, -0.5), abs=0.15)
    frames = world.run(1.2)
    assert "Failsafe activated: no offboard signal" in texts(frames)
    assert world.autopilot.vehicle.mode is Mode.LOITER
    world.run(6.0)
    assert speed(world) < 0.2


def test_position_mode_flies_by_velocity_and_holds_when_the_sticks_are_let_go():
    world = airborne()
    sticks(world, 0.2)
    set_mode(world, Mode.POSCTL)
    sticks(world, 0.5)
    sticks(world, 3.0, x=400)
    # The X500 faces east; full stick is 10 m/s, the dead zone 0.1.
    assert world.truth.v_WB_W[0] == pytest.approx(10.0 * 0.3 / 0.9, abs=0.3)
    sticks(world, 4.0)
    held = east_north(world)
    sticks(world, 3.0)
    assert math.dist(held, east_north(world)) < 0.2
    sticks(world, 2.0, z=1000)
    assert world.truth.v_WB_W[2] > 1.0
    sticks(world, 1.0)
    frames = world.run(1.0)
    assert "Failsafe activated: manual control lost" in texts(frames)
    assert world.autopilot.vehicle.mode is Mode.RTL


def mission_item(seq, command, *, east=0.0, north=0.0, up=8.0, params=(0.0, 0.0, 0.0, NAN), frame=3):
    lat, lon = 473_977_420 + round(north / M_PER_DEGE7_N), 85_455_940 + round(east / M_PER_DEGE7_E)
    return MissionItem(seq, frame, command, 0, 1, *params, lat, lon, up)


def fly_mission(items, limit_s=150.0, watch=lambda world: None):
    world = World()
    station = GroundStation(items)
    world.extra = station.step
    world.each_tick = watch
    frames = world.run_until(lambda w: station.phase is Phase.DONE, limit_s)
    return world, [m.seq for m in messages(frames, "MISSION_ITEM_REACHED")], frames


def test_speeds_holds_and_jumps():
    top = [0.0]

    def watch(world):
        top[0] = max(top[0], speed(world))

    started = 0.0
    items = [
        mission_item(0, 22),
        mission_item(1, 178, frame=2, params=(1.0, 6.0, -1.0, 0.0)),
        mission_item(2, 16, east=30.0),
        mission_item(3, 16, east=0.0, params=(3.0, 0.0, 0.0, NAN)),
        mission_item(4, 177, frame=2, params=(2.0, 1.0, 0.0, 0.0)),
        mission_item(5, 20, frame=2),
    ]
    world, reached, frames = fly_mission(items, watch=watch)
    assert reached == [0, 1, 2, 3, 4, 2, 3, 4, 5]
    assert 5.5 < top[0] < 6.4
    assert world.t_s - started > 6.0
    assert math.hypot(*east_north(world)) < 0.4
    current = [m for m in messages(frames, "MISSION_CURRENT") if m.mission_state == 3]
    assert {m.total for m in current} == {6}


def test_a_mission_is_paused_and_resumed():
    items = [mission_item(0, 22), mission_item(1, 16, east=40.0), mission_item(2, 21, east=40.0, up=0.0)]
    world = World()
    station = GroundStation(items)
    world.extra = station.step
    world.run_until(lambda w: east_north(w)[0] > 10.0, 60.0)
    world.extra = lambda t_ns, frames: b""
    set_mode(world, Mode.LOITER)
    world.run(4.0)
    assert speed(world) < 0.15
    assert world.autopilot.navigator.state() == MissionState.PAUSED
    set_mode(world, Mode.MISSION)
    frames = world.run_until(landed_and_disarmed, 60.0)
    assert [m.seq for m in messages(frames, "MISSION_ITEM_REACHED")] == [1, 2]
    assert east_north(world)[0] == pytest.approx(40.0, abs=0.4)


def test_a_mission_of_jumps_alone_ends_instead_of_hanging():
    items = [mission_item(0, 177, frame=2, params=(0.0, -1.0, 0.0, 0.0))]
    world = World()
    station = GroundStation(items, fly=False)
    world.extra = station.step
    world.run(5.0)
    world.autopilot.navigator.load(items)
    world.command(300)
    frames = world.run(0.1)
    assert "Mission rejected: it only jumps" in texts(frames)


def test_gps_loss_in_flight_descends_and_lands():
    world = airborne(4.0)
    world.gps_on = False
    frames = world.run_until(landed_and_disarmed, 60.0)
    said = texts(frames)
    assert said.index("GPS lost") < said.index("Failsafe activated: no valid position, descending")
    assert world.truth.p_WB[2] == pytest.approx(GROUND_M, abs=0.02)


def test_ground_station_loss_acts_only_if_asked_to():
    for action, mode in ((0, Mode.LOITER), (2, Mode.RTL)):
        world = airborne(params=[f"NAV_DLL_ACT={action}", "COM_DL_LOSS_T=5"])
        world.send("HEARTBEAT", type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3)
        frames = world.run(5.5)
        assert "Connection to ground station lost" in texts(frames)
        assert world.autopilot.vehicle.mode is mode


def test_termination_on_the_ground_disarms():
    world = World()
    world.run(5.0)
    world.command(400, 1)
    world.run(0.1)
    world.command(185, 1)
    world.run(0.1)
    assert world.answered
    assert not world.autopilot.vehicle.armed
    world.command(400, 1)
    assert results(world.run(0.01)) == [(400, 1)]


def test_disarming_in_the_air_needs_force():
    world = airborne()
    world.command(400, 0)
    assert results(world.run(0.01)) == [(400, 2)]
    world.command(400, 0, 21196)
    assert results(world.run(0.01)) == [(400, 0)]
    assert world.controls == (0.0,) * 16


def test_a_mission_that_begins_too_far_away_does_not_start():
    items = [mission_item(0, 22), mission_item(1, 16, north=11_000.0)]
    world = World()
    world.extra = GroundStation(items, fly=False).step
    world.run(5.0)
    world.autopilot.navigator.load([items[1]])
    world.command(300)
    frames = world.run(0.1)
    assert results(frames) == [(300, 1)]
    assert "Preflight Fail: first waypoint is 11.0 km away, MIS_DIST_1WP is 10 km" in texts(frames)


def test_a_mission_resumed_keeps_the_speed_of_the_leg():
    items = [
        mission_item(0, 22),
        mission_item(1, 178, frame=2, params=(1.0, 3.0, -1.0, 0.0)),
        mission_item(2, 16, east=40.0),
        mission_item(3, 178, frame=2, params=(1.0, 8.0, -1.0, 0.0)),
        mission_item(4, 16, east=100.0),
    ]
    world = World()
    world.extra = GroundStation(items).step
    world.run_until(lambda w: east_north(w)[0] > 5.0, 60.0)
    world.extra = lambda t_ns, frames: b""
    set_mode(world, Mode.LOITER)
    world.run(3.0)
    set_mode(world, Mode.MISSION)
    world.run(6.0)
    assert speed(world) == pytest.approx(3.0, abs=0.3)
    world.run_until(lambda w: east_north(w)[0] > 75.0, 60.0)
    assert speed(world) == pytest.approx(8.0, abs=0.5)
