"""The ground station against a scripted ArduCopter, in simulated time only."""

from __future__ import annotations

import math
from typing import Any

import pytest

from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation
from hil.signals.errors import HandshakeError
from hil.signals.mission import MissionItem
from tests.links.scripted_vehicle import S, ScriptedVehicle, fly

AUTO, GUIDED, LAND = 3, 4, 9
ARM, SET_MODE, MISSION_START = 400, 176, 300
NO_SPACE, INVALID = 4, 5
FAILED, DENIED, TEMPORARILY_REJECTED = 4, 2, 1


def item(seq: int, command: int, *params: float) -> MissionItem:
    numbers = (*params, *(0.0, 0.0, 0.0, math.nan)[len(params) :])
    return MissionItem(seq, 6, command, int(seq == 0), 1, *numbers, 473977000 + seq, 85455000, 10.0)


FLIGHT = [item(0, 22), item(1, 16), item(2, 16), item(3, 21)]


class Copter(ScriptedVehicle):
    """Answers as ArduCopter does, in AUTO.

    room_ns: no room for missions before; lost_acks: acknowledgements of uploads that do not arrive;
    fails: {command: how often MAV_RESULT_FAILED}; results: {command: for ever}.
    """

    autopilot = 3

    def __init__(self, **script: Any) -> None:
        super().__init__(**script)
        self.fails = dict(script.get("fails", {}))
        self.lost_acks = script.get("lost_acks", 0)
        self.reached = 0  # item 0 is home

    def fly(self, t_ns: int) -> None:
        if self.mode == LAND and self.landed_state == 2:
            self.armed, self.landed_state = False, 1
        if t_ns % S or not (self.armed and self.mode == AUTO) or self.reached + 1 >= len(self.items):
            return
        self.reached += 1
        self.landed_state = 2
        if self.items[self.reached].command == 21:
            self.armed, self.landed_state = False, 1
        self.say("MISSION_ITEM_REACHED", self.reached)

    def on_mission_count(self, t_ns: int, m: Any) -> None:
        if t_ns < self.script.get("room_ns", 0):
            self.say("MISSION_ACK", 255, 190, NO_SPACE)
            return
        self.count, self.items = m.count, {}
        self.say("MISSION_REQUEST", 255, 190, 0)

    def on_mission_item_int(self, t_ns: int, m: Any) -> None:
        # ArduCopter refuses what is no number.
        if any(math.isnan(value) for value in (m.param1, m.param2, m.param3, m.param4, m.z)):
            self.say("MISSION_ACK", 255, 190, INVALID)
            return
        if m.seq == self.script.get("refuse_seq"):
            self.say("MISSION_ACK", 255, 190, NO_SPACE)
            return
        self.items[m.seq] = m
        if m.seq + 1 < self.count:
            self.say("MISSION_REQUEST", 255, 190, m.seq + 1)
        elif self.lost_acks:
            self.lost_acks -= 1
        else:
            self.say("MISSION_ACK", 255, 190, 0)

    def on_command_long(self, t_ns: int, m: Any) -> None:
        result = self.script.get("results", {}).get(m.command, 0)
        if self.fails.get(m.command):
            self.fails[m.command] -= 1
            result = FAILED
        if m.command == ARM and not result:
            # "Mode not armable": AUTO is none of those in which it arms.
            result = 0 if self.mode == GUIDED else FAILED
            self.armed = self.armed or not result
        elif m.command == SET_MODE and not result:
            self.mode = int(m.param2)
        elif m.command == MISSION_START and not result:
            if self.armed:
                self.mode = AUTO
            else:
                result = FAILED
        if result == FAILED:
            self.say("STATUSTEXT", 2, "Arm: need position estimate")
        self.say("COMMAND_ACK", m.command, result, 0, 0, 255, 190)


def test_a_whole_flight_goes_by_guided_arm_and_mission_start() -> None:
    station, copter = GroundStation(FLIGHT), Copter()
    fly(station, copter)
    assert station.phase is Phase.DONE
    assert station.mission_completed
    assert (station.reached, station.waypoints) == (4, 4)
    assert copter.commands() == [(SET_MODE, 1.0, GUIDED, 0.0), (ARM, 1.0, 0.0, 0.0), (MISSION_START, 0.0, 0.0, 0.0)]


def test_home_takes_the_first_place_and_open_numbers_are_closed() -> None:
    station, copter = GroundStation(FLIGHT), Copter()
    fly(station, copter)
    home = copter.items[0]
    assert (home.command, home.frame, home.current, home.x, home.y) == (16, 0, 0, 0, 0)
    got = [copter.items[seq] for seq in range(1, 5)]
    assert [(m.command, m.x, m.y, m.z, m.frame) for m in got] == [
        (i.command, i.lat_degE7, i.lon_degE7, i.alt_m, i.frame) for i in FLIGHT
    ]
    assert [m.param4 for m in got] == [0.0] * 4
    assert all(math.isnan(i.param4) for i in FLIGHT)  # what was given is left alone


def test_jumps_lead_to_the_item_that_was_meant() -> None:
    mission = [item(0, 22), item(1, 16, 2.5), item(2, 177, 1.0, 3.0), item(3, 21)]
    copter = Copter()
    fly(GroundStation(mission), copter, limit_s=20.0)
    assert copter.items[2].param1 == 2.5  # a waypoint's hold time is no number of an item
    jump = copter.items[3]
    assert (jump.command, jump.param1, jump.param2) == (177, 2.0, 3.0)
    assert copter.items[int(jump.param1)].command == 16


def test_it_is_a_pure_function_of_time_and_frames() -> None:
    assert fly(GroundStation(FLIGHT), Copter(room_ns=3 * S)) == fly(GroundStation(FLIGHT), Copter(room_ns=3 * S))


def test_no_room_is_taken_for_not_yet_for_a_while() -> None:
    station, copter = GroundStation(FLIGHT), Copter(room_ns=12 * S)
    fly(station, copter)
    assert station.mission_completed
    assert 12 <= len(copter.sent("MISSION_COUNT")) <= 15
    # Not as patient for ever, and not with PX4, which means it.
    with pytest.raises(HandshakeError, match=r"5 items was refused after 0 of them: MAV_MISSION_NO_SPACE"):
        fly(GroundStation(FLIGHT), Copter(room_ns=1000 * S))


def test_an_upload_whose_acknowledgement_was_lost_is_offered_again() -> None:
    station, copter = GroundStation(FLIGHT), Copter(lost_acks=2)
    fly(station, copter)
    assert station.mission_completed
    assert len(copter.sent("MISSION_COUNT")) == 3
    with pytest.raises(HandshakeError, match="5 of 5 items were asked for, then nothing"):
        fly(GroundStation(FLIGHT), Copter(lost_acks=1000))


def test_a_refusal_in_the_middle_is_final() -> None:
    copter = Copter(refuse_seq=2)
    with pytest.raises(HandshakeError, match="refused after 3 of them"):
        fly(GroundStation(FLIGHT), copter)
    assert len(copter.sent("MISSION_COUNT")) == 1


@pytest.mark.parametrize("command", [SET_MODE, ARM, MISSION_START])
def test_failed_may_be_another_answer_a_second_later(command: int) -> None:
    station, copter = GroundStation(FLIGHT), Copter(fails={command: 3})
    fly(station, copter)
    assert station.mission_completed
    asked = [number for number, *_ in copter.commands()]
    assert asked.count(command) == 4
    order = list(dict.fromkeys(asked))
    assert order == [SET_MODE, ARM, MISSION_START]
    assert [text for _, _, text in station.statustexts] == ["Arm: need position estimate"] * 3


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ({"fails": {ARM: 9999}}, "asked to arm and answered MAV_RESULT_FAILED .*need position estimate"),
        ({"results": {ARM: DENIED}}, "asked to arm and answered MAV_RESULT_DENIED"),
        ({"results": {SET_MODE: DENIED}}, "asked to enter mode GUIDED and answered MAV_RESULT_DENIED"),
        ({"fails": {MISSION_START: 9999}}, "asked to start the mission and answered MAV_RESULT_FAILED"),
        ({"ready_ns": 1 << 60}, "not ready to arm after 10 s"),
    ],
)
def test_what_stays_refused_is_one_clear_error(script: dict[str, Any], says: str) -> None:
    with pytest.raises(HandshakeError, match=says):
        fly(GroundStation(FLIGHT, preflight_limit_s=10.0), Copter(**script))


def test_a_mission_without_landing_is_landed_where_it_ends() -> None:
    station, copter = GroundStation(FLIGHT[:-1]), Copter()
    fly(station, copter)
    assert station.phase is Phase.DONE
    assert station.mission_completed
    assert [params for command, *params in copter.commands() if command == SET_MODE] == [
        [1.0, GUIDED, 0.0],
        [1.0, LAND, 0.0],
    ]


def test_one_that_arms_and_does_not_take_off() -> None:
    class Stays(Copter):
        def fly(self, t_ns: int) -> None:
            pass

    with pytest.raises(HandshakeError, match="armed, but not in the air after 5 s"):
        fly(GroundStation(FLIGHT, takeoff_limit_s=5.0), Stays())
