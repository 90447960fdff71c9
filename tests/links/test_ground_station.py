"""The ground station against a scripted PX4 or ArduCopter, in simulated time only."""

from __future__ import annotations

import math
from typing import Any

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.modes import ARDUPILOT, PX4
from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.progress import Progress, is_waypoint
from firmware_bridge.ground_station.station import GroundStation
from signals.errors import HandshakeError
from signals.mission import MissionItem
from tests.worlds.scripted_vehicle import (
    ACCEPTED,
    ARM,
    COMPLAINT,
    DENIED,
    FAILED,
    MISSION_START,
    REJECTED_FOR_NOW,
    SET_MODE,
    TICK_NS,
    S,
    fly,
)
from tests.worlds.scripted_vehicle import ScriptedVehicle as Vehicle

AUTO, GUIDED, LAND = 3, 4, 9  # of ArduCopter
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])


def item(seq: int, command: int, *params: float) -> MissionItem:
    numbers = (*params, *(0.0, 0.0, 0.0, math.nan)[len(params) :])
    return MissionItem(seq, 6, command, int(seq == 0), 1, *numbers, 473977000 + seq, 85455000, 10.0)


RECTANGLE = [item(0, 22), item(1, 16), item(2, 16), item(3, 16), item(4, 16), item(5, 21)]


def flown(autopilot: int = PX4, mission: list[MissionItem] = RECTANGLE, **script: Any) -> tuple[GroundStation, Vehicle]:
    """After the flight."""
    station, vehicle = GroundStation(mission), Vehicle(autopilot, **script)
    fly(station, vehicle)
    return station, vehicle


@pytest.mark.parametrize(
    ("autopilot", "commands"),
    [
        (PX4, [(SET_MODE, 1.0, 4.0, 4.0), (ARM, 1.0, 0.0, 0.0)]),
        (ARDUPILOT, [(SET_MODE, 1.0, GUIDED, 0.0), (ARM, 1.0, 0.0, 0.0), (MISSION_START, 0.0, 0.0, 0.0)]),
    ],
)
def test_a_whole_flight(autopilot: int, commands: list[Any]) -> None:
    station, vehicle = flown(autopilot)
    assert station.phase is Phase.DONE
    assert station._progress.completed
    assert (station.reached, station.waypoints) == (6, 6)
    assert vehicle.commands() == commands
    assert set(vehicle.intervals) == {MSGID["SYS_STATUS"], MSGID["EXTENDED_SYS_STATE"], MSGID["MISSION_CURRENT"]}
    got = [vehicle.items[i] for i in sorted(vehicle.items)]
    if autopilot == ARDUPILOT:
        home = got.pop(0)
        assert (home.command, home.frame, home.current, home.x, home.y) == (16, 0, 0, 0, 0)
    else:
        assert got[0].current == 1
    assert [(m.command, m.x, m.y, m.z, m.frame) for m in got] == [
        (i.command, i.lat_degE7, i.lon_degE7, i.alt_m, i.frame) for i in RECTANGLE
    ]
    # ArduPilot accepts no NaN; given values are unchanged.
    assert [math.isnan(m.param4) for m in got] == [autopilot == PX4] * 6
    assert all(math.isnan(i.param4) for i in RECTANGLE)


def test_a_mission_that_an_earlier_flight_left_in_the_middle_begins_at_its_first_item() -> None:
    """PX4 keeps the current item of a mission that it already holds, also over a restart."""
    station, vehicle = flown(resumes=4)
    assert [m.seq for m in vehicle.sent("MISSION_SET_CURRENT")] == [0]
    assert (station.reached, station.waypoints) == (6, 6)
    _, fresh = flown()
    assert fresh.sent("MISSION_SET_CURRENT") == []


def test_a_vehicle_that_stays_at_a_later_item_is_named() -> None:
    station, vehicle = GroundStation(RECTANGLE), Vehicle(resumes=4)
    vehicle.on_mission_set_current = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(HandshakeError, match="does not go back to the first item of the mission"):
        fly(station, vehicle, limit_s=90.0)


def test_jumps_lead_to_the_intended_item() -> None:
    mission = [item(0, 22), item(1, 16, 2.5), item(2, 177, 1.0, 3.0), item(3, 21)]
    copter = Vehicle(ARDUPILOT)
    fly(GroundStation(mission), copter, limit_s=20.0)
    assert copter.items[2].param1 == 2.5  # a waypoint's hold time is not an item number
    jump = copter.items[3]
    assert (jump.command, jump.param1, jump.param2) == (177, 2.0, 3.0)
    assert copter.items[int(jump.param1)].command == 16


@BOTH
def test_it_is_a_pure_function_of_time_and_frames(autopilot: int) -> None:
    log = fly(GroundStation(RECTANGLE), Vehicle(autopilot))
    assert log == fly(GroundStation(RECTANGLE), Vehicle(autopilot))
    assert sum(bool(data) for data in log) < len(log) / 50  # without a task nothing is sent


def test_heartbeat_once_a_simulated_second_without_drift() -> None:
    log = fly(GroundStation(RECTANGLE, heartbeat_limit_s=1e9), Vehicle(mute=True), limit_s=20.0)
    assert [tick for tick, data in enumerate(log) if data] == list(range(0, 5000, 250))


@pytest.mark.parametrize("lose", [1, 2, 4])
def test_lost_messages_are_requested_again(lose: int) -> None:
    station, vehicle = flown(lose=lose)
    assert station._progress.completed
    assert max(m.confirmation for m in vehicle.sent("COMMAND_LONG")) == lose


@pytest.mark.parametrize(
    "script", [{"old_requests": True}, {"no_prearm_bit": True}, {"silent_landing": True}, {"ready_ns": 7 * S}]
)
def test_protocol_variants_are_accepted(script: dict[str, Any]) -> None:
    station, vehicle = flown(**script)
    assert station._progress.completed
    assert vehicle.armed_at_ns >= script.get("ready_ns", 0)


@pytest.mark.parametrize(
    ("autopilot", "command", "declines"),
    [(PX4, ARM, REJECTED_FOR_NOW), (ARDUPILOT, SET_MODE, FAILED), (ARDUPILOT, ARM, FAILED),
     (ARDUPILOT, MISSION_START, FAILED)],
)  # fmt: skip
def test_declined_requests_are_repeated_a_second_later(autopilot: int, command: int, declines: int) -> None:
    station, vehicle = flown(autopilot, answers={command: [declines] * 3 + [ACCEPTED]})
    assert station._progress.completed
    asked = [number for number, *_ in vehicle.commands()]
    assert asked.count(command) == 4
    assert list(dict.fromkeys(asked)) == [SET_MODE, ARM, MISSION_START][: len(set(asked))]
    assert [text for _, _, text in station.statustexts] == [COMPLAINT] * 3


def test_mission_no_space_of_ardupilot_is_retried_for_a_while() -> None:
    station, copter = flown(ARDUPILOT, room_ns=12 * S)
    assert station._progress.completed
    assert 12 <= len(copter.sent("MISSION_COUNT")) <= 15


def test_an_upload_whose_acknowledgement_was_lost_is_offered_again() -> None:
    station, vehicle = flown(lost_acks=2)
    assert station._progress.completed
    assert len(vehicle.sent("MISSION_COUNT")) == 3


@pytest.mark.parametrize(
    ("autopilot", "script", "settings", "says"),
    [
        (PX4, {"mute": True}, {"heartbeat_limit_s": 3.0}, "no heartbeat of vehicle 1 within 3 s of simulated time"),
        (PX4, {"sysid": 9}, {"heartbeat_limit_s": 3.0}, "no heartbeat of vehicle 1"),
        (PX4, {"room": 5}, {}, "6 items was refused after 0 of them: MAV_MISSION_NO_SPACE; .*shorten"),
        (ARDUPILOT, {"room_ns": 1000 * S}, {}, "7 items was refused after 0 of them: MAV_MISSION_NO_SPACE"),
        (PX4, {"reject_seq": 2}, {}, "refused after 3 of them: MAV_MISSION_INVALID_PARAM7; an altitude"),
        (ARDUPILOT, {"reject_seq": 2}, {}, "refused after 3 of them"),
        (PX4, {"lost_acks": 1000}, {}, "6 of 6 items were requested, then none"),
        (PX4, {"ready_ns": 1 << 60}, {"preflight_limit_s": 5.0}, "not ready to arm after 5 s .*pre-arm check does not"),
        (ARDUPILOT, {"ready_ns": 1 << 60}, {"preflight_limit_s": 10.0}, "not ready to arm after 10 s"),
        (PX4, {"answers": {ARM: REJECTED_FOR_NOW}}, {"preflight_limit_s": 8.0}, "to arm .*Y_REJECTED .*gyro bias"),
        (ARDUPILOT, {"answers": {ARM: FAILED}}, {"preflight_limit_s": 8.0}, "to arm and .*FAILED .*gyro bias"),
        (PX4, {"answers": {ARM: DENIED}}, {}, "asked to arm and answered MAV_RESULT_DENIED"),
        (PX4, {"answers": {SET_MODE: 3}}, {}, "asked to enter mode AUTO.MISSION and answered MAV_RESULT_UNSUPPORTED"),
        (ARDUPILOT, {"answers": {SET_MODE: DENIED}}, {}, "asked to enter mode GUIDED and answered MAV_RESULT_DENIED"),
        (ARDUPILOT, {"answers": {MISSION_START: DENIED}}, {}, "to start the mission and answered MAV_RESULT_DENIED"),
        (PX4, {"answers": {ARM: None}}, {}, "MAV_CMD_COMPONENT_ARM_DISARM was sent 5 times without an answer"),
        (PX4, {"crash_ns": 1}, {}, "accepted arming 5 times, but its heartbeats never show"),
        (PX4, {"crash_ns": 4_200_000_000}, {}, "disarmed before it took off"),
        (PX4, {"hold": True}, {"takeoff_limit_s": 5.0}, "armed, but not in the air after 5 s"),
        (ARDUPILOT, {"hold": True}, {"takeoff_limit_s": 5.0}, "armed, but not in the air after 5 s"),
    ],
)
def test_each_refusal_is_one_clear_error(
    autopilot: int, script: dict[str, Any], settings: dict[str, Any], says: str
) -> None:
    station = GroundStation(RECTANGLE, **settings)
    with pytest.raises(HandshakeError, match=says):
        fly(station, Vehicle(autopilot, **script), limit_s=120.0)


def test_a_missing_mission_service_is_named() -> None:
    class NoMissions(Vehicle):
        on_mission_count = None  # type: ignore[assignment]

    with pytest.raises(HandshakeError, match="mission service"):
        fly(GroundStation(RECTANGLE), NoMissions())


@pytest.mark.parametrize(("items", "says"), [(10_000, "10000 items was refused .*NO_SPACE"), (70_000, "65535")])
def test_missions_that_are_too_long_are_refused(items: int, says: str) -> None:
    with pytest.raises(HandshakeError, match=says):
        fly(GroundStation([item(0, 16)] * items), Vehicle(), limit_s=30.0)


def test_an_empty_mission_is_refused() -> None:
    with pytest.raises(HandshakeError, match="no items"):
        GroundStation([])


def test_crash_in_flight_is_an_end_without_completion() -> None:
    station, _ = flown(crash_ns=6 * S)
    assert station.phase is Phase.DONE
    assert not station._progress.completed
    assert 0 < station.reached < 6


@pytest.mark.parametrize(
    ("autopilot", "modes"), [(PX4, [(4.0, 4.0), (4.0, 6.0)]), (ARDUPILOT, [(GUIDED, 0.0), (LAND, 0.0)])]
)
def test_a_mission_without_landing_is_landed_where_it_ends(autopilot: int, modes: list[tuple[float, float]]) -> None:
    station, vehicle = flown(autopilot, RECTANGLE[:-1])
    assert station.phase is Phase.DONE
    assert station._progress.completed
    assert [(main, sub) for command, _, main, sub in vehicle.commands() if command == SET_MODE] == modes


def test_watching_only() -> None:
    station, vehicle = GroundStation([], fly=False), Vehicle()
    vehicle.items = {0: item(0, 22), 1: item(1, 21)}
    for tick in range(5000):
        if tick == 1000:
            vehicle.mode, vehicle.armed, vehicle.armed_at_ns = 4 << 16 | 4 << 24, True, tick * TICK_NS
        vehicle.hear(tick * TICK_NS, station.step(tick * TICK_NS, vehicle.speak(tick * TICK_NS)))
    assert station.phase is Phase.DONE
    assert station.reached == 2
    assert {m.command for m in vehicle.sent("COMMAND_LONG")} == {511}
    assert not vehicle.sent("MISSION_COUNT")


@pytest.mark.parametrize(
    ("command", "lat", "lon", "counts"),
    [(16, 1, 1, True), (17, 1, 1, True), (19, 1, 1, True), (22, 0, 0, True), (21, 0, 0, False), (21, 5, 0, True),
     (20, 0, 0, False), (178, 0, 0, False), (93, 0, 0, False)],
)  # fmt: skip
def test_what_counts_as_a_waypoint(command: int, lat: int, lon: int, counts: bool) -> None:
    assert is_waypoint(MissionItem(0, 6, command, 0, 1, 0.0, 0.0, 0.0, 0.0, lat, lon, 1.0)) == counts


def test_long_texts_are_joined_and_others_are_not_listened_to() -> None:
    station, vehicle = GroundStation(RECTANGLE), Vehicle(mute=True)
    vehicle.say("STATUSTEXT", 4, "a" * 50, 7, 0)
    vehicle.say("STATUSTEXT", 4, "b", 7, 1)
    vehicle.say("STATUSTEXT", 4, "c", 0, 0)
    vehicle.say("HEARTBEAT", 2, 12, 0x80, 0, 4, 3, encoder=FrameEncoder(2, 1))
    vehicle.say("HEARTBEAT", 30, 8, 0x80, 0, 4, 3, encoder=FrameEncoder(1, 100))
    station.step(S, vehicle.speak(S))
    assert station.statustexts == [(S, 4, "a" * 50 + "b"), (S, 4, "c")]
    assert station.phase is Phase.CONNECTING
    assert not station.armed


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


def test_failed_checks_of_ardupilot_come_first_and_with_their_remedy() -> None:
    """The cause came last in a line that began with sensors of number 0x0."""
    vehicle = Vehicle(ARDUPILOT, ready_ns=1 << 60)
    for text in (
        b"PreArm: Gyros inconsistent",
        b"EKF3 IMU0 is using GPS",
        b"PreArm: Gyro 0 rate 406Hz < loop ratex1.8",
    ):
        vehicle.say("STATUSTEXT", 2, text)
    with pytest.raises(HandshakeError) as caught:
        fly(GroundStation(RECTANGLE, preflight_limit_s=5.0), vehicle, limit_s=60.0)
    text = str(caught.value)
    assert "simulated time: PreArm: Gyro 0 rate 406Hz < loop ratex1.8 (its main loop is too fast" in text
    assert "SCHED_LOOP_RATE" in text
    assert text.index("PreArm: Gyros inconsistent") < text.index("pre-arm check does not pass")
    assert "0x0" not in text
    assert "EKF3" not in text
