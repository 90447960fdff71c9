"""Actions of mission scripts against a minimal vehicle: order, retries, refusals, parameters, modes."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from firmware_bridge.ground_station.actions import (
    SCRIPT_COMPID,
    Action,
    ActionSource,
    Effect,
    RunCommand,
    SetMode,
    SetParam,
    VehicleEvent,
)
from firmware_bridge.ground_station.modes import ARDUPILOT, PX4, firmware_of, mode_params, mode_word
from firmware_bridge.mock_pixhawk.modes import mode_from_px4
from signals.errors import HandshakeError
from tests.worlds.scripted_vehicle import ACCEPTED, DENIED, REJECTED_FOR_NOW, TICK_NS, S, ScriptedVehicle


class Vehicle(ScriptedVehicle):
    """A vehicle with two parameters, the first at most 20."""

    telemetry_ns = None

    def __init__(self, autopilot: int = PX4, **script: Any) -> None:
        super().__init__(autopilot, **script)
        self.params: dict[str, tuple[float, int]] = {"SPEED": (5.0, 9), "COUNT": (3.0, 6)}

    def on_param_request_read(self, _t_ns: int, m: Any, sender: int) -> None:
        assert sender == SCRIPT_COMPID
        if m.param_id in self.params:
            value, kind = self.params[m.param_id]
            if kind == 6 and self.autopilot == PX4:
                value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
            self.say("PARAM_VALUE", m.param_id, value, kind, 2, 0)

    def on_param_set(self, t_ns: int, m: Any, sender: int) -> None:
        value, kind = m.param_value, self.params[m.param_id][1]
        if kind == 6 and self.autopilot == PX4:
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        self.params[m.param_id] = (min(value, 20.0), kind)
        self.on_param_request_read(t_ns, m, sender)


def fly(source: ActionSource, vehicle: Vehicle, seconds: float, happenings: dict[float, Any] | None = None) -> None:
    """Fly the script; `happenings`: messages of the vehicle, or actions on it, by time [s]."""
    to_come = sorted((happenings or {}).items())
    for t_ns in range(0, round(seconds * S), TICK_NS):
        while to_come and t_ns >= to_come[0][0] * S:
            what = to_come.pop(0)[1]
            vehicle.say(*what) if not callable(what) else what(vehicle)
        vehicle.hear(t_ns, source.step(t_ns, vehicle.speak(t_ns)))


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
    plane = {"MISSION": 10, "RTL": 11, "HOLD": 12, "TAKEOFF": 13, "GUIDED": 15, "LAND": 26, "STABILIZED": 5}
    for kind in (1, 19, 20, 22):  # MAV_TYPE of a plane, of tailsitters and of another VTOL
        assert {word: mode_params(ARDUPILOT, word, kind) for word in plane} == {
            w: (1.0, n, 0.0) for w, n in plane.items()
        }
        assert [mode_word(ARDUPILOT, number, kind) for number in (1, 10, 17, 20)] == [
            "CIRCLE", "MISSION", "QSTABILIZE", "QLAND"
        ]  # fmt: skip
    assert mode_params(PX4, "MISSION", 1) == mode_params(PX4, "MISSION")
    for word, number in firmware_of(PX4).modes.items():
        mode = mode_from_px4(number.main, number.sub)
        assert mode is not None
        assert mode.custom_mode == number.custom_mode
        assert mode_word(PX4, mode.custom_mode) == word
    assert mode_word(ARDUPILOT, 99) == "custom mode 0x63"
    with pytest.raises(HandshakeError, match="ARDUPILOTMEGA has no mode TAKEOFF; choose from: MISSION"):
        mode_params(ARDUPILOT, "TAKEOFF")
    with pytest.raises(HandshakeError, match="modes of MAV_AUTOPILOT_INVALID are not known"):
        mode_params(8, "HOLD")


def test_actions_come_at_their_times_and_one_after_the_other() -> None:
    vehicle = Vehicle(answers=[ACCEPTED])
    actions = [
        Action("late", RunCommand(178, (1.0, 3.0)), at_ns=2 * S),
        Action("early", SetMode("HOLD"), at_ns=1 * S),
        Action("also late", SetMode("RTL"), at_ns=2 * S),
    ]
    source = ActionSource(actions)
    fly(source, vehicle, 3.0)
    said = [(t, m.command, m.param1, m.param2, m.param3) for t, m in vehicle.heard]
    assert said == [
        (1 * S, 176, 1.0, 4.0, 3.0),
        (2 * S, 178, 1.0, 3.0, 0.0),
        (2 * S + TICK_NS, 176, 1.0, 4.0, 5.0),
    ]
    assert outcomes(source) == ["done"] * 3


def test_a_script_is_the_same_bytes_every_time() -> None:
    def log() -> list[tuple[int, Any]]:
        vehicle = Vehicle(answers=[REJECTED_FOR_NOW, ACCEPTED])
        fly(
            ActionSource([Action("a", SetMode("HOLD"), at_ns=S), Action("p", SetParam("SPEED", 3.3), at_ns=S)]),
            vehicle,
            4,
        )
        return vehicle.heard

    assert log() == log()


def test_nothing_is_sent_to_an_autopilot_before_its_heartbeat() -> None:
    vehicle = Vehicle(mute=True)
    source = ActionSource([Action("x.yaml:3: set_mode HOLD", SetMode("HOLD"), at_ns=S)])
    with pytest.raises(HandshakeError, match=r"mission script: x\.yaml:3: set_mode HOLD: the vehicle has sent no"):
        fly(source, vehicle, 40.0)
    assert vehicle.heard == []


def test_a_temporary_rejection_is_retried_and_a_refusal_is_named() -> None:
    vehicle = Vehicle(answers=[REJECTED_FOR_NOW, REJECTED_FOR_NOW, ACCEPTED])
    source = ActionSource([Action("a", SetMode("HOLD"), at_ns=0)])
    fly(source, vehicle, 5.0)
    assert outcomes(source) == ["done"]
    assert len(vehicle.heard) == 3

    events: list[tuple[int, str, str]] = []
    vehicle = Vehicle(answers=[DENIED, ACCEPTED])
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
        fly(ActionSource([two[0]._replace(required=True)]), Vehicle(answers=[DENIED]), 2.0)


def test_an_unanswered_command_is_given_up_and_the_next_one_is_done() -> None:
    vehicle = Vehicle(answers=[None, None, None, None, None, ACCEPTED])
    two = [Action("lost", SetMode("HOLD"), at_ns=0, required=False), Action("next", RunCommand(178, ()), at_ns=S)]
    source = ActionSource(two)
    fly(source, vehicle, 8.0)
    assert outcomes(source) == ["refused", "done"]
    assert [m.confirmation for _, m in vehicle.heard] == [0, 1, 2, 3, 4, 0]


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
        (SetParam("NOPE", 1.0), "no answer to 5 requests for the parameter NOPE"),
        (SetParam("COUNT", 1.5), "takes a whole number"),
    ],
)
def test_impossible_parameters_are_refused(wanted: SetParam, why: str) -> None:
    with pytest.raises(HandshakeError, match=why):
        fly(ActionSource([Action("p", wanted, at_ns=0)]), Vehicle(), 10.0)


def test_happenings_count_once_and_delays_from_then_on() -> None:
    times: list[tuple[str, int]] = []

    def effect(name: str) -> Effect:
        return Effect(lambda t_ns: times.append((name, t_ns)))

    def mode(number: int) -> Any:
        def change(vehicle: Vehicle) -> None:
            vehicle.mode = number
            vehicle.armed = True
            vehicle.beat()

        return change

    actions = [
        Action("item", effect("item"), after=VehicleEvent("item", 3), delay_ns=S // 2),
        Action("takeoff", effect("takeoff"), after=VehicleEvent("takeoff")),
        Action("landed", effect("landed"), after=VehicleEvent("landed")),
        Action("mode", effect("mode"), after=VehicleEvent("mode", word="HOLD")),
        Action("armed", effect("armed"), after=VehicleEvent("armed")),
        Action("never", effect("never"), after=VehicleEvent("item", 9)),
        Action("from the start", effect("no change"), after=VehicleEvent("mode", word="RTL")),
        Action("fixed", effect("fixed"), at_ns=S),
    ]
    source = ActionSource(actions, first_item=1)
    ground, air = ("EXTENDED_SYS_STATE", 0, 1), ("EXTENDED_SYS_STATE", 0, 2)
    reached = "MISSION_ITEM_REACHED"
    happenings = {1.5: ground, 2.0: air, 2.5: air, 3.0: (reached, 4), 3.2: (reached, 4), 3.3: (reached, 3)}
    vehicle = Vehicle()
    vehicle.mode = 4 << 16 | 5 << 24
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
