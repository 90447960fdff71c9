"""The causes of silence of the mock in lockstep, their signs, and messages that wait meanwhile."""

from __future__ import annotations

import struct

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.ids import Cmd
from firmware_bridge.mock_pixhawk.services.outbox import LIMIT
from tests.worlds.mock_pixhawk_world import World, messages, results, texts

ARMED_BIT = 128
OFFBOARD = 6 << 16


def airborne(**settings):
    world = World(**settings)
    world.run(6.0)
    world.command(176, 1, 4, 2)
    world.command(400, 1)
    world.run(6.0)
    assert not world.autopilot.vehicle.landed
    return world


def test_termination_by_command_sends_a_last_text_and_a_last_answer_that_hovers():
    world = airborne()
    hover = world.controls
    world.command(185, 1)
    frames = world.step()
    assert not world.answered
    assert world.controls == hover
    assert all(u > 0.5 for u in hover[:4])
    assert texts(frames) == ["Flight termination active"]
    assert results(frames) == [(185, 0)]
    (heartbeat,) = messages(frames, "HEARTBEAT")
    assert heartbeat.system_status == 8
    assert heartbeat.base_mode & ARMED_BIT
    assert world.run(2.0) == []


def test_termination_by_failsafe_sends_the_same_last_text():
    world = airborne(params=["NAV_DLL_ACT=5", "COM_DL_LOSS_T=5"])
    world.send("HEARTBEAT", type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3)
    frames = world.run_until(lambda w: not w.answered, 8.0)
    said = texts(frames)
    assert said[-2:] == ["Connection to ground station lost", "Flight termination active"]
    assert messages(frames, "HEARTBEAT")[-1].system_status == 8
    assert world.run(1.0) == []


def test_offboard_while_disarmed_is_shown_by_the_last_heartbeat():
    world = World()
    world.run(6.0)
    world.command(176, 1, 6)
    frames = world.step()
    assert not world.answered
    assert results(frames) == [(176, 0)]
    (heartbeat,) = messages(frames, "HEARTBEAT")
    assert (heartbeat.custom_mode, heartbeat.system_status) == (OFFBOARD, 3)
    assert not heartbeat.base_mode & ARMED_BIT
    assert texts(frames) == []
    assert world.run(1.0) == []


def sensor(time_usec):
    values = (0, 0, -9.81, 0, 0, 0, 0.2, 0, 0.4, 1013.0, 0.0, 0.0, 20.0)
    return FrameEncoder(255, 200).frame(MSGID["HIL_SENSOR"], struct.pack("<Q13fIB", time_usec, *values, 0x1FFF, 0))


def test_a_clock_that_goes_backwards_sends_no_text():
    mock = MockPixhawk(boot_sensors=0)
    assert mock.feed(sensor(8000)) != b""
    assert mock.feed(sensor(4000)) == b""
    assert mock.feed(sensor(12000)) == b""


def test_reboot_in_lockstep_acknowledges_boots_and_needs_its_boot_sensors():
    world = World(boot_sensors=20)
    world.run(2.0)
    world.command(Cmd.PREFLIGHT_REBOOT_SHUTDOWN, 1)
    frames = world.step()
    assert not world.answered
    assert results(frames) == [(246, 0)]
    request = messages(frames, "COMMAND_LONG")
    assert [m.command for m in request] == [511]
    for _ in range(20):
        world.step()
        assert not world.answered
    world.step()
    assert world.answered


def test_messages_waiting_for_the_first_answer_are_bounded_and_the_oldest_is_dropped():
    mock, encoder = MockPixhawk(boot_sensors=0), FrameEncoder(255, 190)
    mock.boot()
    ask = message_class("TIMESYNC")
    for k in range(1, LIMIT + 51):
        message = ask(0, k)
        assert mock.feed(encoder.frame(message.MSGID, pack(message))) == b""
    frames = FrameParser().feed(mock.feed(sensor(4000)))
    assert [m.ts1 for m in messages(frames, "TIMESYNC")] == list(range(51, LIMIT + 51))
    assert frames[-1].msgid == MSGID["HIL_ACTUATOR_CONTROLS"]
    # From the first answer on nothing is dropped, however much is asked for at once.
    flood = b"".join(encoder.frame(111, pack(ask(0, k))) for k in range(2 * LIMIT))
    assert len(messages(FrameParser().feed(mock.feed(flood)), "TIMESYNC")) == 2 * LIMIT


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, 1),
        ({"params": ["MAV_SYS_ID=7"]}, 7),
        ({"sysid": 9}, 9),
        ({"params": ["MAV_SYS_ID=7"], "sysid": 9}, 9),
    ],
)
def test_the_parameter_is_the_system_id_unless_one_is_given(settings, expected):
    mock = MockPixhawk(**settings)
    assert {frame.sysid for frame in FrameParser().feed(mock.boot())} == {expected}
    assert mock.params["MAV_SYS_ID"] == expected
