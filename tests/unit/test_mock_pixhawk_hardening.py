"""No single frame ends the mock, whatever it holds."""

from __future__ import annotations

import struct

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.ground_station.progress import Progress
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from hil.signals.errors import ConfigError
from hil.signals.mission import MissionItem

BOOT_SENSORS = 2


def sensor(time_usec: int) -> bytes:
    accel, gyro, mag = (0.0, 0.0, -9.81), (0.0, 0.0, 0.0), (0.2, 0.0, 0.4)
    return struct.pack("<Q13fIB", time_usec, *accel, *gyro, *mag, 1013.0, 0.0, 0.0, 20.0, 0x1FFF, 0)


def running() -> tuple[MockPixhawk, FrameEncoder]:
    mock, encoder = MockPixhawk(boot_sensors=BOOT_SENSORS), FrameEncoder(255, 190)
    for k in range(1, 6):
        mock.feed(encoder.frame(MSGID["HIL_SENSOR"], sensor(4000 * k)))
    return mock, encoder


@pytest.mark.parametrize("name", [b"\xff" * 16, "ÄÖÜÄÖÜÄÖ".encode(), b"\0" * 16, b"MPC\xff"])
def test_a_parameter_name_that_is_no_name(name: bytes) -> None:
    mock, encoder = running()
    raw = name.ljust(16, b"\0")[:16]
    mock.feed(encoder.frame(MSGID["PARAM_SET"], struct.pack("<fBB", 1.0, 1, 1) + raw + b"\x09"))
    mock.feed(encoder.frame(MSGID["PARAM_REQUEST_READ"], struct.pack("<hBB", -1, 1, 1) + raw))
    replies = FrameParser().feed(mock.feed(encoder.frame(MSGID["HIL_SENSOR"], sensor(4000 * 6))))
    assert MSGID["HIL_ACTUATOR_CONTROLS"] in [frame.msgid for frame in replies]
    assert all(unpack(f).text.isascii() for f in replies if f.msgid == MSGID["STATUSTEXT"])


@pytest.mark.parametrize("time_usec", [2**62, 2**63 - 1, 2**63, 2**64 - 1])
def test_times_that_are_no_times_are_ignored(time_usec: int) -> None:
    mock, encoder = running()
    ignored = mock.ignored
    assert mock.feed(encoder.frame(MSGID["HIL_SENSOR"], sensor(time_usec))) == b""
    assert mock.ignored == ignored + 1
    assert mock.feed(encoder.frame(MSGID["HIL_SENSOR"], sensor(4000 * 6))) != b""


def test_parameters_that_make_no_vehicle() -> None:
    with pytest.raises(ConfigError, match="CA_ROTOR"):
        MockPixhawk(params=["CA_ROTOR_COUNT=3"])


def test_with_jumps_only_the_vehicle_knows_when_all_is_flown() -> None:
    def item(seq: int, command: int) -> MissionItem:
        return MissionItem(seq, 3, command, 0, 1, 0.0, 0.0, 0.0, 0.0, 473977420, 85455940, 10.0)

    class Reached:
        def __init__(self, seq: int) -> None:
            self.seq = seq

    plain, jumping = Progress([item(0, 22), item(1, 16)]), Progress([item(0, 22), item(1, 16), item(2, 177)])
    for progress in (plain, jumping):
        for seq in (0, 1):
            progress.on_item_reached(Reached(seq))
    assert plain.completed
    assert not jumping.completed
