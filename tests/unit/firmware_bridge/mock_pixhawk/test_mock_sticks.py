"""Flying the mock by MANUAL_CONTROL: every manual mode, from take-off to landing, and sticks that fall silent."""

from __future__ import annotations

import pytest

from firmware_bridge.mock_pixhawk.modes import Mode
from tests.worlds.mock_hitl_world import hitl_world
from tests.worlds.mock_pixhawk_world import World, results, sticks, texts

GROUND_M = 0.23
LOST = "Failsafe activated: manual control lost"
REJECTED = 1


def by_hand(world, mode):
    """Return a world armed in `mode` on the ground, throttle down."""
    world.run(8.0)
    world.command(176, 1, mode.value.main, mode.value.sub)
    sticks(world, 0.3, z=0)
    world.command(400, 1)
    frames = sticks(world, 0.3, z=0)
    assert (400, 0) in results(frames), texts(frames)
    return world


def by_eye(world, climb_mps):
    """Return the throttle of a pilot who sees the climb rate and wants `climb_mps`."""
    return min(max(round(500.0 + 250.0 * (climb_mps - world.truth.v_WB_W[2])), 0), 1000)


@pytest.mark.parametrize(
    ("make", "mode"),
    [
        *((World, mode) for mode in (Mode.ALTCTL, Mode.POSCTL, Mode.STABILIZED, Mode.MANUAL)),
        (hitl_world, Mode.POSCTL),
        *(
            pytest.param(hitl_world, mode, marks=pytest.mark.slow)
            for mode in (Mode.ALTCTL, Mode.STABILIZED, Mode.MANUAL)
        ),
    ],
)
def test_take_off_hover_and_landing_by_hand(make, mode):
    world = by_hand(make(), mode)
    helped = mode in (Mode.ALTCTL, Mode.POSCTL)  # the throttle is a climb rate
    frames = []
    for _ in range(40):
        frames += sticks(world, 0.1, z=800 if helped else by_eye(world, 1.5))
    assert "Takeoff detected" in texts(frames)
    assert world.truth.p_WB[2] > 2.0
    if helped:
        sticks(world, 2.0)
        height = world.truth.p_WB[2]
        sticks(world, 4.0)
        assert world.truth.p_WB[2] == pytest.approx(height, abs=0.3)
    frames = []
    for _ in range(300):
        down = world.truth.p_WB[2] < GROUND_M + 0.02
        frames += sticks(world, 0.1, z=200 if helped and not down else 0 if down else by_eye(world, -0.8))
        if not world.autopilot.vehicle.armed:
            break
    assert texts(frames) == ["Disarmed by landing"]
    assert world.truth.p_WB[2] == pytest.approx(GROUND_M, abs=0.03)


@pytest.mark.parametrize(("action", "mode"), [(1, Mode.LOITER), (2, Mode.RTL), (3, Mode.LAND), (5, None), (6, None)])
def test_lost_sticks_act_as_nav_rcl_act_says_after_com_rc_loss_t(action, mode):
    world = by_hand(World(params=[f"NAV_RCL_ACT={action}"]), Mode.ALTCTL)
    sticks(world, 4.0, z=800)
    assert LOST not in texts(world.run(0.3))
    frames = world.run(0.3)
    assert LOST in texts(frames)
    if mode is not None:
        assert world.autopilot.vehicle.mode is mode
    elif action == 5:
        assert world.autopilot.vehicle.terminated
    else:
        assert not world.autopilot.vehicle.armed


def test_returning_sticks_take_over_again_on_command():
    world = by_hand(World(), Mode.POSCTL)
    sticks(world, 4.0, z=800)
    assert LOST in texts(world.run(0.6))
    sticks(world, 0.5)
    assert world.autopilot.vehicle.mode is Mode.RTL
    world.command(176, 1, 3)
    assert (176, 0) in results(sticks(world, 0.2))
    assert world.autopilot.vehicle.mode is Mode.POSCTL
    assert LOST in texts(world.run(0.6))


def test_lost_sticks_do_not_matter_in_automatic_modes():
    world = by_hand(World(), Mode.ALTCTL)
    sticks(world, 4.0, z=800)
    world.command(176, 1, 4, 3)
    frames = world.run(2.0)
    assert LOST not in texts(frames)
    assert world.autopilot.vehicle.mode is Mode.LOITER


@pytest.mark.parametrize("limit_s", [0.2, 1.5])
def test_the_time_is_com_rc_loss_t(limit_s):
    world = by_hand(World(params=[f"COM_RC_LOSS_T={limit_s}"]), Mode.ALTCTL)
    sticks(world, 4.0, z=800)
    assert LOST not in texts(world.run(limit_s - 0.15))
    assert LOST in texts(world.run(0.2))


@pytest.mark.parametrize(("source", "heard"), [(0, False), (1, True), (2, True), (3, True), (4, False)])
def test_com_rc_in_mode_says_whether_a_joystick_counts(source, heard):
    world = World(params=[f"COM_RC_IN_MODE={source}"])
    world.run(8.0)
    world.command(176, 1, 2)
    sticks(world, 0.3, z=0)
    world.command(400, 1)
    assert (400, 0 if heard else REJECTED) in results(sticks(world, 0.3, z=0))
