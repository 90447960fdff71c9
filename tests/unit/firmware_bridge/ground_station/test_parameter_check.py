"""Parameters are compared with what the firmware reports, in its own encoding, before it may arm."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import pytest

from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.autopilots.px4.firmware import PX4
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.ground_station.parameter_check import ParameterCheck, Reported, same_value
from signals.errors import ConfigError, HandshakeError

Heartbeat = message_class("HEARTBEAT")
Value = message_class("PARAM_VALUE")
TICK_NS = 4_000_000
INT8, INT32, REAL32 = 2, 6, 9
TABLE = {"WPNAV_SPEED": (500.0, REAL32), "WPNAV_ACCEL": (250.0, REAL32), "FRAME_CLASS": (1.0, INT8)}


class Vehicle:
    """Answers requests for its parameters in the next tick; `lost`: it ignores so many requests by name."""

    def __init__(self, firmware: Firmware, table: Mapping[str, tuple[float, int]], lost: int = 0) -> None:
        self.firmware, self.table, self.lost = firmware, dict(table), lost
        self.encoder, self.requests = FrameEncoder(1, 1), 0

    def frame(self, message: Any) -> Frame:
        return FrameParser().feed(self.encoder.frame(message.MSGID, pack(message)))[0]

    def value(self, name: str) -> Frame:
        value, kind = self.table[name]
        if self.firmware.bytewise_params and kind != REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return self.frame(Value(name, value, kind, len(self.table), list(self.table).index(name)))

    def answer(self, data: bytes) -> list[Frame]:
        answers = []
        for frame in FrameParser().feed(data):
            if frame.msgid == MSGID["PARAM_REQUEST_LIST"]:
                answers += [self.value(name) for name in self.table]
                continue
            self.requests += 1
            if self.requests > self.lost and unpack(frame).param_id in self.table:
                answers.append(self.value(unpack(frame).param_id))
        return answers


def compare(wanted: Mapping[str, float], vehicle: Vehicle, seconds: float = 30.0) -> float:
    """Compare, and return the simulated time that it took [s]."""
    check = ParameterCheck(wanted, vehicle.firmware)
    frames = [vehicle.frame(Heartbeat(2, 12, 0x81, 0, 3, 3))]
    for tick in range(round(seconds * 250)):
        frames = vehicle.answer(check.step(tick * TICK_NS, frames))
        if check.done:
            return tick * TICK_NS * 1e-9
    raise AssertionError("it does not end")


@pytest.mark.parametrize("firmware", [PX4, ARDUPILOT])
def test_right_values_take_one_exchange(firmware: Firmware) -> None:
    assert compare({"WPNAV_SPEED": 500.0, "FRAME_CLASS": 1.0}, Vehicle(firmware, TABLE)) < 0.1


def test_parameters_of_a_file_are_compared_with_the_whole_list_and_end_nothing() -> None:
    of_file = {"WPNAV_SPEED": 500.0, "WPNAV_ACCEL": 100.0, "MY_DRIVER": 1.0}
    vehicle = Vehicle(PX4, TABLE)
    check = ParameterCheck({"FRAME_CLASS": 1.0}, PX4, of_file=of_file)
    frames = [vehicle.frame(Heartbeat(2, 12, 0x81, 0, 3, 3))]
    seconds = 0.0
    while not check.done:
        frames = vehicle.answer(check.step(round(seconds * 1e9), frames))
        seconds += 0.004
    assert 5.0 <= seconds < 12.0  # its modules have had time to start
    assert check.finding == (
        "1 of 3 parameters of the file hold; not in use in this firmware (1): MY_DRIVER; "
        "other values (1): WPNAV_ACCEL 250 instead of 100"
    )


def test_many_parameters_are_read_in_turn() -> None:
    table = {f"P{number}": (number / 3.0, REAL32) for number in range(95)}
    stored = {name: (Reported(value, kind).value, kind) for name, (value, kind) in table.items()}
    assert compare({name: value for name, (value, _) in table.items()}, Vehicle(ARDUPILOT, stored)) < 1.0


def test_a_misspelt_name_is_told_with_the_nearest() -> None:
    vehicle = Vehicle(ARDUPILOT, TABLE)
    with pytest.raises(ConfigError) as caught:
        compare({"WPNAV_SPEEDX": 300.0, "WPNAV_ACCEL": 250.0}, vehicle)
    assert str(caught.value) == ("autopilot.params.WPNAV_SPEEDX: is unknown to ArduPilot (did you mean 'WPNAV_SPEED'?)")


@pytest.mark.parametrize(
    ("name", "wanted", "says"),
    [
        ("WPNAV_SPEED", 300.0, "WPNAV_SPEED: is 500 on PX4, not 300 (it is out of the parameter's range"),
        ("FRAME_CLASS", 1.4, "FRAME_CLASS: is 1 on PX4, not 1.4 (it is a whole number)"),
        ("FRAME_CLASS", 257.0, "FRAME_CLASS: is 1 on PX4, not 257"),  # as 8 bits it would be 1
    ],
)
def test_another_value_is_told(name: str, wanted: float, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        compare({name: wanted}, Vehicle(PX4, TABLE))
    assert says in str(caught.value)


def test_lost_answers_are_asked_for_again() -> None:
    assert 2.9 < compare({"WPNAV_SPEED": 500.0}, Vehicle(PX4, TABLE, lost=3)) < 3.1
    compare({"WPNAV_SPEED": 500.0}, Vehicle(PX4, TABLE, lost=1000))  # found in the list


def test_an_autopilot_that_reports_no_parameters_is_an_error_of_the_link() -> None:
    with pytest.raises(HandshakeError, match="answered none of the requests for the parameters WPNAV_SPEED"):
        compare({"WPNAV_SPEED": 500.0}, Vehicle(PX4, {}))


def test_the_rounding_of_the_type_is_no_difference() -> None:
    assert same_value(0.1, Reported(struct.unpack("<f", struct.pack("<f", 0.1))[0], REAL32))
    assert not same_value(0.1, Reported(0.1001, REAL32))
    assert same_value(16_777_217.0, Reported(16_777_217.0, INT32))
    assert not same_value(float(2**40), Reported(0.0, INT32))
