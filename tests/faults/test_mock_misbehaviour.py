"""Declared faults of the mock, and random input to it, which raises nothing. Its faults in a run: test_run_faults."""

import random

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import parse_fault, random_bytes
from signals.errors import ConfigError
from tests.worlds.mock_pixhawk_world import World

ACTUATORS = MSGID["HIL_ACTUATOR_CONTROLS"]


def test_garbage_is_the_same_in_every_run_and_has_no_start_bytes():
    blocks = [random_bytes(k) for k in range(2000)]
    assert blocks == [random_bytes(k) for k in range(2000)]
    assert len(set(blocks)) == len(blocks)
    assert not any(byte in (0xFD, 0xFE) for block in blocks for byte in block)


@pytest.mark.parametrize("text", ["die", "die@", "die@-1", "die@nan", "die@1e400", "explode@3", "@3", ""])
def test_faults_that_do_not_exist_are_refused(text):
    with pytest.raises(ConfigError, match="die, stall"):
        parse_fault(text)


# Field values that have broken autopilots before.
_EDGES = (b"\x00", b"\xff", b"\x7f\x80\x00\x00"[::-1], b"\xff\x80\x00\x00"[::-1], b"\x7f\xc0\x00\x00"[::-1], b"\x80")


def _random_payload(rng, length):
    return rng.randbytes(length) if rng.random() < 0.4 else (rng.choice(_EDGES) * length)[:length]


def test_random_sensor_data_raises_nothing():
    rng = random.Random(3)
    autopilot = MockPixhawk(boot_sensors=0)
    autopilot.boot()
    encoder, parser = FrameEncoder(255, 200), FrameParser()
    answers = 0
    for tick in range(4000):
        payload = bytearray(_random_payload(rng, 65))
        payload[0:8] = (tick * 4000).to_bytes(8, "little")
        payload[64] = 0
        data = encoder.frame(MSGID["HIL_GPS"], _random_payload(rng, 39)) if tick % 5 == 0 else b""
        out = autopilot.feed(data + encoder.frame(MSGID["HIL_SENSOR"], bytes(payload)))
        for frame in parser.feed(out):
            if frame.msgid == ACTUATORS:
                answers += 1
                assert unpack(frame).controls == (0.0,) * 16
    assert answers == 4000


def test_commands_in_flight_at_random_raise_nothing():
    rng = random.Random(8)
    world = World(offboard_silence=False, params=["CBRK_FLIGHTTERM=121212"])
    world.run(5.0)
    values = (0.0, 1.0, -1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0, 490.0, 47.3978, 8.5456, float("nan"), 1e9)
    commands = [20, 21, 22, 176, 178, 179, 192, 224, 300, 400, 410, 511, 512, 520]
    for _ in range(1500):
        command = rng.choice(commands)
        world.command(command, *(rng.choice(values) for _ in range(7)))
        if rng.random() < 0.3:
            axes = {axis: rng.randint(-1000, 1000) for axis in "xyzr"}
            world.send("MANUAL_CONTROL", target=1, buttons=0, **axes)
        world.run(0.02)
        assert world.answered
