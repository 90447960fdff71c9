"""Outputs of a board in HITL: their rates, contents and conditions. Simulated time."""

from __future__ import annotations

import struct

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from tests.worlds.mock_hitl_world import OUTPUT, hitl_world, lone_board, take_off
from tests.worlds.mock_pixhawk_world import messages, results, texts

HIL_BIT, ARMED_BIT = 32, 128
DENIED = 2


def set_int(world, name, value):
    """Send PARAM_SET with the bits of an INT32."""
    bits = struct.unpack("<f", struct.pack("<i", value))[0]
    world.send("PARAM_SET", target_system=1, target_component=1, param_id=name, param_value=bits, param_type=6)


def seconds_alone(board, time, seconds):
    """Run a board without input and return its frames."""
    parser, frames = FrameParser(), []
    end_ns = time.now_ns + int(seconds * 1e9)
    while (due_ns := board.clock.source_ns(board.next_due_us)) < end_ns:
        time.now_ns = due_ns
        frames += parser.feed(board.feed(b""))
    time.now_ns = end_ns
    return frames


def test_outputs_run_free_at_200_hz_without_any_sensor():
    board, time = lone_board()
    greeting = FrameParser().feed(board.boot())
    assert [frame.msgid for frame in greeting] == [MSGID["HEARTBEAT"]]
    outputs = messages(seconds_alone(board, time, 2.0), "HIL_ACTUATOR_CONTROLS")
    assert [m.time_usec for m in outputs] == list(range(5_000, 2_000_000, 5_000))
    assert {(m.flags, m.mode) for m in outputs} == {(0, 53)}
    assert {m.controls for m in outputs} == {(0.0,) * 16}


def test_modes_flags_and_heartbeat_armed_and_disarmed():
    world = hitl_world()
    take_off(world)
    frames = world.run(1.5)
    before = world.received
    assert all(m.base_mode & HIL_BIT and m.base_mode & ARMED_BIT for m in messages(frames, "HEARTBEAT"))
    outputs = messages(before + world.step() + world.step(), "HIL_ACTUATOR_CONTROLS")
    assert {(m.flags, m.mode) for m in outputs} == {(0, 181)}
    assert all(0.0 < u < 1.0 for u in outputs[-1].controls[:4])
    assert outputs[-1].controls[4:] == (0.0,) * 12


@pytest.mark.parametrize(
    "settings", [{"baud": 57600}, {"params": ["SYS_HITL=0"]}, {"params": ["SYS_HITL=2"]}], ids=["slow", "off", "sih"]
)
def test_without_sys_hitl_or_on_a_slow_link_hil_messages_are_ignored_without_a_word(settings):
    world = hitl_world(**settings)
    frames = []
    for _ in range(1500):
        frames += world.step()
    assert world.autopilot.steps == 0
    assert world.autopilot.ignored > 1500
    assert messages(frames, "HIL_ACTUATOR_CONTROLS") == []
    assert texts(frames) == []
    slow = settings.get("baud") is not None
    assert {m.base_mode & HIL_BIT for m in messages(frames, "HEARTBEAT")} == {HIL_BIT if slow else 0}


@pytest.mark.parametrize(("baud", "taken"), [(57_600, False), (100_000, False), (115_200, True), (921_600, True)])
def test_the_links_data_rate_must_exceed_5000_bytes_a_second(baud, taken):
    world = hitl_world(baud=baud)
    world.run(0.5)
    assert (world.autopilot.steps > 0) is taken


def test_functions_map_motors_to_slots_and_keep_the_mixers_order():
    world = hitl_world(params=["HIL_ACT_FUNC1=0", "HIL_ACT_FUNC5=101", "HIL_ACT_FUNC6=2"])
    world.run(8.0)
    wired = world.physics.advance
    # The bench has motor 1 on slot 5.
    world.physics.advance = lambda tick, u: wired(tick, (u[4], *u[1:4], *((0.0,) * 12)))
    world.command(176, 1, 4, 2)
    world.command(400, 1)
    seen = []
    for _ in range(2000):
        seen += messages(world.step(), "HIL_ACTUATOR_CONTROLS")
    armed = [m.controls for m in seen if m.mode == 181]
    assert {u[0] for u in armed} == {0.0}
    assert {u[5] for u in armed} == {1.0}
    assert all(u[4] > 0.0 for u in armed[-100:])
    assert world.truth.p_WB[2] == pytest.approx(0.23 + 2.5, abs=0.2)


def test_functions_change_while_disarmed_only():
    world = hitl_world()
    take_off(world)
    world.run(2.0)
    set_int(world, "HIL_ACT_FUNC2", 0)
    world.run(1.0)
    assert world.controls[1] > 0.0
    assert world.autopilot.params["HIL_ACT_FUNC2"] == 0
    world.command(400, 0, 21196)
    world.run(0.5)
    world.autopilot.vehicle.terminated = False
    world.command(400, 1, 21196)
    world.run(0.1)
    assert world.controls[1] == 0.0
    assert world.controls[0] > 0.0


def test_reboot_restarts_the_clock_keeps_parameters_and_applies_sys_hitl():
    world = hitl_world()
    world.run(3.0)
    set_int(world, "HIL_ACT_FUNC1", 104)
    set_int(world, "SYS_HITL", 0)
    frames = world.run(1.0)
    assert messages(frames, "SYSTEM_TIME")[-1].time_boot_ms >= 3000
    outputs = [f for _ in range(5) for f in world.step() if f.msgid == OUTPUT]
    assert outputs  # SYS_HITL takes effect at boot only
    world.command(246, 1)
    frames = [frame for _ in range(500) for frame in world.step()]
    assert results(frames) == [(246, 0)]
    boot_at = next(k for k, f in enumerate(frames) if f.msgid == MSGID["COMMAND_ACK"])
    assert [f for f in frames[boot_at:] if f.msgid == OUTPUT] == []
    assert messages(frames[boot_at:], "SYSTEM_TIME")[0].time_boot_ms == 1000
    assert {m.base_mode & HIL_BIT for m in messages(frames[boot_at:], "HEARTBEAT")} == {0}
    assert world.autopilot.params["HIL_ACT_FUNC1"] == 104
    assert world.autopilot.boots == 2
    set_int(world, "SYS_HITL", 1)
    world.run(0.1)
    world.command(246, 1)
    frames = [frame for _ in range(2000) for frame in world.step()]
    assert [f for f in frames if f.msgid == OUTPUT]
    assert world.autopilot.vehicle.ready


def test_no_reboot_while_armed():
    world = hitl_world()
    take_off(world)
    world.command(246, 1)
    assert results(world.run(0.1)) == [(246, DENIED)]
    assert world.autopilot.boots == 1


def test_the_mission_outlasts_a_reboot():
    board, _ = lone_board()
    board.firmware.missions.items = ["an item"]
    encoder = FrameEncoder(255, 190)
    command = struct.pack("<7fHBBB", 1.0, 0, 0, 0, 0, 0, 0, 246, 1, 1, 0)
    board.feed(encoder.frame(MSGID["COMMAND_LONG"], command))
    assert board.boots == 2
    assert board.navigator.items == ["an item"]


def test_a_changed_system_id_applies_from_the_next_boot_on():
    board, _ = lone_board()
    encoder = FrameEncoder(255, 190)
    value = struct.pack("<iBB16sB", 7, 1, 1, b"MAV_SYS_ID", 6)
    (answer,) = FrameParser().feed(board.feed(encoder.frame(MSGID["PARAM_SET"], value)))
    assert answer.sysid == 1
    reboot = encoder.frame(MSGID["COMMAND_LONG"], struct.pack("<7fHBBB", 1.0, 0, 0, 0, 0, 0, 0, 246, 1, 1, 0))
    ack, heartbeat = FrameParser().feed(board.feed(reboot))
    assert (ack.sysid, heartbeat.sysid) == (1, 7)
    assert unpack(ack).command == 246


def test_faults_follow_the_boards_clock():
    from firmware_bridge.mock_pixhawk.faults import parse_fault

    board, time = lone_board(faults=[parse_fault("stall@1")])
    frames = seconds_alone(board, time, 2.0)
    outputs = messages(frames, "HIL_ACTUATOR_CONTROLS")
    assert max(m.time_usec for m in outputs) == 995_000
