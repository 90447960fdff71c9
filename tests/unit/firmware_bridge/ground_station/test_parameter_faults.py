"""Faults made by parameters of the firmware: read, set in the tick of the fault, confirmed, put back; or named."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_bridge.autopilots.ardupilot.sensors import SITL
from firmware_bridge.autopilots.intake import Held, Simulated
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.ground_station.parameter_faults import ParameterFault, ParameterFaults
from signals.errors import HandshakeError
from signals.time import NS_PER_S

TICK_NS = 4_000_000
REAL32, INT8 = 9, 2


class Firmware:
    """ArduPilot's parameters, and everything that was set: (time [s], name, value)."""

    def __init__(self, faults: ParameterFaults, **known: tuple[float, int]) -> None:
        self.faults, self.known = faults, known
        self.encoder, self.parser = FrameEncoder(1, 1), FrameParser()
        self.frames: list[Frame] = []
        self.asked: list[str] = []
        self.taken: list[tuple[float, str, float]] = []
        self.deaf: set[str] = set()
        self.tick = 0

    def say(self, name: str, *values: Any) -> None:
        self.frames += FrameParser().feed(self.encoder.frame(MSGID[name], pack(message_class(name)(*values))))

    def fly(self, until_s: float, *, beats: bool = True) -> None:
        while self.tick * TICK_NS < until_s * NS_PER_S:
            t_ns = self.tick * TICK_NS
            frames, self.frames = self.frames, []
            sent = self.faults.step(t_ns, frames)
            for frame in self.parser.feed(sent):
                self.serve(unpack(frame), t_ns / NS_PER_S, is_set=frame.msgid == MSGID["PARAM_SET"])
            if beats and self.tick % 250 == 100:
                self.say("HEARTBEAT", 2, 3, 0, 0, 3, 3)
            self.tick += 1

    def serve(self, message: Any, t_s: float, *, is_set: bool) -> None:
        name = message.param_id
        if not is_set:
            self.asked.append(name)
        if name not in self.known:
            return
        value, kind = self.known[name]
        if is_set and name not in self.deaf:
            value = message.param_value
            self.known[name] = (value, kind)
            self.taken.append((t_s, name, value))
        self.say("PARAM_VALUE", name, value, kind, 1, 0)


def simulated(kind: str) -> Simulated:
    intake = SITL[kind]
    assert isinstance(intake, Simulated)
    return intake


def made(*faults: ParameterFault) -> tuple[ParameterFaults, list[tuple[int, str, str]]]:
    events: list[tuple[int, str, str]] = []
    source = ParameterFaults(altitude_m=488.0, on_event=lambda *event: events.append(event))
    for fault in faults:
        source.add(fault)
    return source, events


def dropout(begin_s: float, end_s: float | None) -> ParameterFault:
    end_ns = None if end_s is None else round(end_s * NS_PER_S)
    changes = simulated("gps").changes("dropout", None)
    return ParameterFault("gps: dropout", round(begin_s * NS_PER_S), end_ns, changes)


def test_set_in_the_tick_of_the_fault_and_put_back_at_its_end() -> None:
    source, events = made(dropout(5.0, 7.0))
    firmware = Firmware(source, SIM_GPS1_ENABLE=(1.0, INT8))
    firmware.fly(10.0)
    assert firmware.taken == [(5.0, "SIM_GPS1_ENABLE", 0.0), (7.0, "SIM_GPS1_ENABLE", 1.0)]
    assert firmware.asked == ["SIM_GPS1_ENABLE", "SIM_GPS_DISABLE"]
    assert [(t_ns, kind) for t_ns, kind, _ in events] == [(5 * NS_PER_S, "fault"), (7 * NS_PER_S, "fault")]
    assert "SIM_GPS1_ENABLE 0" in events[0][2]
    assert "back to: SIM_GPS1_ENABLE 1" in events[1][2]
    assert source.records == [
        {"fault": "gps: dropout", "began_s": 5.0, "ended_s": 7.0, "parameters": {"SIM_GPS1_ENABLE": 0.0}}
    ]
    source.check_confirmed()


def test_the_name_of_an_older_version_is_found_with_its_own_value() -> None:
    source, _ = made(dropout(5.0, None))
    firmware = Firmware(source, SIM_GPS_DISABLE=(0.0, INT8))
    firmware.fly(8.0)
    assert firmware.taken == [(5.0, "SIM_GPS_DISABLE", 1.0)]


def test_a_parameter_that_the_firmware_lacks_ends_the_run_long_before_the_fault() -> None:
    source, events = made(dropout(50.0, None))
    firmware = Firmware(source, OTHER=(1.0, INT8))
    with pytest.raises(HandshakeError, match=r"gps: dropout: .*no parameter SIM_GPS1_ENABLE or SIM_GPS_DISABLE"):
        firmware.fly(20.0)
    assert firmware.tick * TICK_NS < 8 * NS_PER_S
    assert events == []


def test_a_value_that_is_not_taken_ends_the_run() -> None:
    source, _ = made(dropout(3.0, None))
    firmware = Firmware(source, SIM_GPS1_ENABLE=(1.0, INT8))
    firmware.deaf = {"SIM_GPS1_ENABLE"}
    firmware.fly(4.5)
    with pytest.raises(HandshakeError, match="SIM_GPS1_ENABLE was set to 0 and did not become it"):
        source.check_confirmed()  # a flight that ends here
    with pytest.raises(HandshakeError, match="SIM_GPS1_ENABLE was set to 0 and did not become it"):
        firmware.fly(10.0)


def test_a_lost_request_is_repeated() -> None:
    source, _ = made(dropout(3.0, 6.0))
    firmware = Firmware(source, SIM_GPS1_ENABLE=(1.0, INT8))
    firmware.deaf = {"SIM_GPS1_ENABLE"}
    firmware.fly(3.1)
    firmware.deaf = set()
    firmware.fly(8.0)
    assert firmware.taken == [(3.5, "SIM_GPS1_ENABLE", 0.0), (6.0, "SIM_GPS1_ENABLE", 1.0)]


def test_a_fault_before_the_firmware_answers_begins_as_soon_as_it_does_or_ends_the_run() -> None:
    source, _ = made(dropout(0.0, 3.0))
    firmware = Firmware(source, SIM_GPS1_ENABLE=(1.0, INT8))
    firmware.fly(4.0)
    assert [(round(t_s, 1), value) for t_s, _, value in firmware.taken] == [(0.4, 0.0), (3.0, 1.0)]
    source, _ = made(dropout(0.0, 0.2))
    with pytest.raises(HandshakeError, match=r"gps: dropout: was to begin at 0 s.*let the fault begin later"):
        Firmware(source, SIM_GPS1_ENABLE=(1.0, INT8)).fly(2.0)
    source, _ = made(dropout(1.0, 2.0))
    with pytest.raises(HandshakeError, match="sent no heartbeat"):
        Firmware(source).fly(40.0, beats=False)


def test_offsets_are_added_to_the_values_that_were_there_in_the_frame_of_the_firmware() -> None:
    """SITL's compass measures the field minus its offset [mG, FRD]."""
    changes = simulated("magnetometer").changes("offset", "field_tesla")
    fault = ParameterFault("mag: offset", 2 * NS_PER_S, 3 * NS_PER_S, changes, offset=1e-5)
    source, _ = made(fault)
    before = dict(zip("XYZ", (5.0, 13.0, -18.0), strict=True))
    firmware = Firmware(
        source, **{f"SIM_MAG{n}_OFS_{axis}": (value, REAL32) for n in (1, 2, 3) for axis, value in before.items()}
    )
    firmware.fly(2.5)
    for n in (1, 2, 3):
        now = [firmware.known[f"SIM_MAG{n}_OFS_{axis}"][0] for axis in "XYZ"]
        assert now == [5.0 - 100.0, 13.0 + 100.0, -18.0 + 100.0]
    firmware.fly(4.0)
    assert firmware.known["SIM_MAG2_OFS_Z"][0] == -18.0
    assert len(simulated("magnetometer").changes("offset", "field_tesla", 1)) == 3


def test_a_drift_moves_ten_times_a_second_and_two_faults_add_up() -> None:
    changes = simulated("gps").changes("drift", "altitude_m")
    drift = ParameterFault("gps: drift", 2 * NS_PER_S, 3 * NS_PER_S, changes, rate_per_s=2.0)
    offset = ParameterFault("gps: offset", round(2.5 * NS_PER_S), None, changes, offset=10.0)
    source, _ = made(drift, offset)
    firmware = Firmware(source, SIM_GPS1_GLTCH_Z=(0.5, REAL32))
    firmware.fly(4.0)
    expected = [(2.0 + 0.1 * k, 0.5 + 0.2 * k + (10.0 if k >= 5 else 0.0)) for k in range(1, 10)] + [(3.0, 10.5)]
    assert [(t_s, value) for t_s, _, value in firmware.taken] == [
        (pytest.approx(t_s, abs=1e-9), pytest.approx(value, abs=1e-5)) for t_s, value in expected
    ]


def test_of_values_that_are_held_the_last_fault_counts() -> None:
    source, _ = made(
        ParameterFault("one", 2 * NS_PER_S, 6 * NS_PER_S, ((Held("MODE", 1.0),),)),
        ParameterFault("two", 3 * NS_PER_S, 4 * NS_PER_S, ((Held("MODE", 2.0),),)),
    )
    firmware = Firmware(source, MODE=(0.0, INT8))
    firmware.fly(8.0)
    assert [(t_s, value) for t_s, _, value in firmware.taken] == [(2.0, 1.0), (3.0, 2.0), (4.0, 1.0), (6.0, 0.0)]
