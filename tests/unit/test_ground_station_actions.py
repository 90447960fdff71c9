"""Mission scripts' actions against a vehicle of a few lines: order, retries, refusals, parameters, modes."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack, unpack
from firmware_bridge.ground_station.actions import (
    SCRIPT_COMPID,
    Action,
    ActionSource,
    Effect,
    Happening,
    RunCommand,
    SetMode,
    SetParam,
)
from firmware_bridge.ground_station.modes import ARDUPILOT, MODE_TABLE, PX4, mode_params, mode_word
from firmware_bridge.mock_pixhawk.modes import mode_from_px4
from hil.signals.errors import HandshakeError

TICK_NS = 4_000_000
S = 1_000_000_000
Heartbeat = message_class("HEARTBEAT")
Ack = message_class("COMMAND_ACK")
ParamValue = message_class("PARAM_VALUE")
Reached = message_class("MISSION_ITEM_REACHED")
ExtendedState = message_class("EXTENDED_SYS_STATE")

ACCEPTED, REJECTED_FOR_NOW, DENIED = 0, 1, 2


class Vehicle:
    """Answers in the tick after; `answers` are the results of the commands to come, the last one for ever."""

    def __init__(self, *, autopilot: int = PX4, answers: tuple[int | None, ...] = (ACCEPTED,)) -> None:
        self.encoder = FrameEncoder(1, 1)
        self.autopilot = autopilot
        self.answers = list(answers)
        self.params: dict[str, tuple[float, int]] = {"SPEED": (5.0, 9), "COUNT": (3.0, 6)}
        self.armed, self.custom_mode = False, 0
        self.silent = False
        self.asked: list[tuple[int, Any]] = []
        self.to_say: list[Any] = []

    def frames(self) -> list[Frame]:
        said, self.to_say = self.to_say, []
        data = b"".join(self.encoder.frame(m.MSGID, pack(m)) for m in said)
        return list(FrameParser().feed(data))

    def heartbeat(self) -> None:
        self.to_say.append(Heartbeat(2, self.autopilot, 128 * self.armed | 1, self.custom_mode, 4, 3))

    def hear(self, t_ns: int, data: bytes) -> None:
        for frame in FrameParser().feed(data):
            assert (frame.sysid, frame.compid) == (255, SCRIPT_COMPID)
            message = unpack(frame)
            self.asked.append((t_ns, message))
            if type(message).__name__ == "COMMAND_LONG":
                answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
                if answer is not None:
                    # The station's own answers must not be taken for ours.
                    self.to_say.append(Ack(message.command, DENIED, 0, 0, 255, 190))
                    self.to_say.append(Ack(message.command, answer, 0, 0, 255, SCRIPT_COMPID))
            elif message.param_id in self.params:
                value, kind = self.params[message.param_id]
                if type(message).__name__ == "PARAM_SET":
                    value = message.param_value
                    if kind == 6 and self.autopilot == PX4:
                        value = struct.unpack("<i", struct.pack("<f", value))[0]
                    self.params[message.param_id] = (min(value, 20.0), kind)
                    value = min(value, 20.0)
                if kind == 6 and self.autopilot == PX4:
                    value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
                self.to_say.append(ParamValue(message.param_id, value, kind, 2, 0))


def fly(source: ActionSource, vehicle: Vehicle, seconds: float, happenings: dict[float, Any] | None = None) -> None:
    to_come = sorted((happenings or {}).items())
    for tick in range(round(seconds * 250)):
        t_ns = tick * TICK_NS
        if tick % 250 == 0 and not vehicle.silent:
            vehicle.heartbeat()
        while to_come and t_ns >= to_come[0][0] * S:
            what = to_come.pop(0)[1]
            vehicle.to_say.append(what) if not callable(what) else what(vehicle)
        vehicle.hear(t_ns, source.step(t_ns, vehicle.frames()))


def outcomes(source: ActionSource) -> list[str]:
    return [record.outcome for record in source.records]


def test_every_mode_has_the_numbers_of_its_autopilot() -> None:
    assert mode_params(PX4, "MISSION") == (1.0, 4.0, 4.0)
    assert mode_params(PX4, "LAND") == (1.0, 4.0, 6.0)
    assert mode_params(PX4, "GUIDED") == mode_params(PX4, "OFFBOARD") == (1.0, 6.0, 0.0)
    wanted = {
        "MISSION": 3,
        "GUIDED": 4,
        "HOLD": 17,
        "RTL": 6,
        "LAND": 9,
        "ALTITUDE": 2,
        "STABILIZED": 0,
        "POSITION": 16,
    }
    assert {word: mode_params(ARDUPILOT, word) for word in wanted} == {w: (1.0, n, 0.0) for w, n in wanted.items()}
    for word, number in MODE_TABLE[PX4].items():
        mode = mode_from_px4(number.main, number.sub)
        assert mode is not None
        assert mode.custom_mode == number.custom_mode
        assert mode_word(PX4, mode.custom_mode) == word
    assert mode_word(ARDUPILOT, 99) == "custom mode 0x63"
    with pytest.raises(HandshakeError, match="ARDUPILOTMEGA has no mode TAKEOFF; it has: MISSION"):
        mode_params(ARDUPILOT, "TAKEOFF")
    with pytest.raises(HandshakeError, match="modes are not known"):
        mode_params(8, "HOLD")


def test_actions_come_at_their_times_and_one_after_the_other() -> None:
    vehicle = Vehicle(answers=(ACCEPTED,))
    actions = [
        Action("late", RunCommand(178, (1.0, 3.0)), at_ns=2 * S),
        Action("early", SetMode("HOLD"), at_ns=1 * S),
        Action("also late", SetMode("RTL"), at_ns=2 * S),
    ]
    source = ActionSource(actions)
    fly(source, vehicle, 3.0)
    said = [(t, m.command, m.param1, m.param2, m.param3) for t, m in vehicle.asked]
    assert said == [
        (1 * S, 176, 1.0, 4.0, 3.0),
        (2 * S, 178, 1.0, 3.0, 0.0),
        (2 * S + TICK_NS, 176, 1.0, 4.0, 5.0),
    ]
    assert outcomes(source) == ["done"] * 3


def test_a_script_is_the_same_bytes_every_time() -> None:
    def log() -> list[tuple[int, Any]]:
        vehicle = Vehicle(answers=(REJECTED_FOR_NOW, ACCEPTED))
        fly(
            ActionSource([Action("a", SetMode("HOLD"), at_ns=S), Action("p", SetParam("SPEED", 3.3), at_ns=S)]),
            vehicle,
            4,
        )
        return vehicle.asked

    assert log() == log()


def test_nothing_is_said_to_an_autopilot_that_nobody_has_heard() -> None:
    vehicle = Vehicle()
    vehicle.silent = True
    source = ActionSource([Action("x.yaml:3: set_mode HOLD", SetMode("HOLD"), at_ns=S)])
    with pytest.raises(HandshakeError, match=r"mission script: x\.yaml:3: set_mode HOLD: the vehicle has sent no"):
        fly(source, vehicle, 40.0)
    assert vehicle.asked == []


def test_a_rejection_for_now_is_asked_again_and_a_refusal_is_named() -> None:
    vehicle = Vehicle(answers=(REJECTED_FOR_NOW, REJECTED_FOR_NOW, ACCEPTED))
    source = ActionSource([Action("a", SetMode("HOLD"), at_ns=0)])
    fly(source, vehicle, 5.0)
    assert outcomes(source) == ["done"]
    assert len(vehicle.asked) == 3

    events: list[tuple[int, str, str]] = []
    vehicle = Vehicle(answers=(DENIED, ACCEPTED))
    two = [Action("first", SetMode("HOLD"), at_ns=0, required=False), Action("second", SetMode("RTL"), at_ns=0)]
    source = ActionSource(two, on_event=lambda *event: events.append(event))
    fly(source, vehicle, 2.0)
    assert outcomes(source) == ["refused", "done"]
    assert [(kind, text) for _, kind, text in events] == [
        ("action", "first"),
        ("warning", "first: the autopilot answered MAV_RESULT_DENIED"),
        ("action", "second"),
    ]

    with pytest.raises(HandshakeError, match="first: the autopilot answered MAV_RESULT_DENIED"):
        fly(ActionSource([two[0]._replace(required=True)]), Vehicle(answers=(DENIED,)), 2.0)


def test_a_command_that_nobody_answers_is_given_up_and_the_next_one_still_done() -> None:
    vehicle = Vehicle(answers=(None, None, None, None, None, ACCEPTED))
    two = [Action("lost", SetMode("HOLD"), at_ns=0, required=False), Action("next", RunCommand(178, ()), at_ns=S)]
    source = ActionSource(two)
    fly(source, vehicle, 8.0)
    assert outcomes(source) == ["refused", "done"]
    assert [m.confirmation for _, m in vehicle.asked] == [0, 1, 2, 3, 4, 0]


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_parameters_are_set_in_the_autopilots_own_encoding(autopilot: int) -> None:
    vehicle = Vehicle(autopilot=autopilot)
    actions = [Action("s", SetParam("SPEED", 3.3), at_ns=0), Action("c", SetParam("COUNT", 7.0), at_ns=0)]
    source = ActionSource(actions)
    fly(source, vehicle, 2.0)
    assert outcomes(source) == ["done", "done"]
    assert vehicle.params["SPEED"][0] == pytest.approx(3.3)
    assert vehicle.params["COUNT"] == (7.0, 6)


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        (SetParam("SPEED", 99.0), "was set 5 times and never became 99"),
        (SetParam("NOPE", 1.0), "for the parameter NOPE, never answered"),
        (SetParam("COUNT", 1.5), "takes a whole number"),
    ],
)
def test_parameters_that_cannot_be_are_refused(wanted: SetParam, why: str) -> None:
    with pytest.raises(HandshakeError, match=why):
        fly(ActionSource([Action("p", wanted, at_ns=0)]), Vehicle(), 10.0)


def test_happenings_count_once_and_delays_from_then_on() -> None:
    times: list[tuple[str, int]] = []

    def effect(name: str) -> Effect:
        return Effect(lambda t_ns: times.append((name, t_ns)))

    def mode(number: int) -> Any:
        def change(vehicle: Vehicle) -> None:
            vehicle.custom_mode = number
            vehicle.armed = True
            vehicle.heartbeat()

        return change

    actions = [
        Action("item", effect("item"), after=Happening("item", 3), delay_ns=S // 2),
        Action("takeoff", effect("takeoff"), after=Happening("takeoff")),
        Action("landed", effect("landed"), after=Happening("landed")),
        Action("mode", effect("mode"), after=Happening("mode", word="HOLD")),
        Action("armed", effect("armed"), after=Happening("armed")),
        Action("never", effect("never"), after=Happening("item", 9)),
        Action("from the start", effect("no change"), after=Happening("mode", word="RTL")),
        Action("fixed", effect("fixed"), at_ns=S),
    ]
    source = ActionSource(actions, first_item=1)
    ground, air = ExtendedState(0, 1), ExtendedState(0, 2)
    happenings = {1.5: ground, 2.0: air, 2.5: air, 3.0: Reached(4), 3.2: Reached(4), 3.3: Reached(3)}
    vehicle = Vehicle()
    vehicle.custom_mode = 4 << 16 | 5 << 24
    fly(source, vehicle, 6.0, happenings | {4.0: mode(4 << 16 | 3 << 24), 5.0: ground, 5.5: ground})
    assert times == [
        ("fixed", 1 * S),
        ("takeoff", 2 * S),
        ("item", 3_500_000_000),
        ("mode", 4 * S),  # of one tick, in the order of the script
        ("armed", 4 * S),
        ("landed", 5 * S),
    ]
    assert outcomes(source) == ["done", "done", "done", "done", "done", "waiting", "waiting", "done"]
