"""The ground station against a scripted vehicle, in simulated time only."""

import math

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.progress import Progress, is_waypoint
from firmware_bridge.ground_station.station import GroundStation
from hil.signals.errors import HandshakeError
from hil.signals.mission import MissionItem
from tests.links.scripted_vehicle import TICK_NS, S, ScriptedVehicle, fly


def item(seq, command, lat=473977000, lon=85455000, alt=10.0):
    return MissionItem(seq, 6, command, int(seq == 0), 1, 0.0, 0.0, 0.0, math.nan, lat + seq, lon, alt)


RECTANGLE = [item(0, 22), item(1, 16), item(2, 16), item(3, 16), item(4, 16), item(5, 21)]


class Vehicle(ScriptedVehicle):
    """Answers as PX4 does."""

    def __init__(self, **script):
        super().__init__(**script)
        self.armed_at_ns = None
        self.interval = {}
        self.arm_refusals = script.get("arm_refusals", 0)

    def fly(self, t_ns):
        if not self.armed or self.mode != 4 << 16 | 4 << 24:
            if self.armed and self.mode == 4 << 16 | 6 << 24:
                self.landed_state, self.armed = 1, False
            return
        if self.script.get("crash_ns") and t_ns > self.script["crash_ns"]:
            self.landed_state, self.armed = 1, False
            return
        if t_ns - self.armed_at_ns > S and not self.script.get("hold"):
            self.landed_state = 2
            if self.reached + 1 < len(self.items):
                self.reached += 1
                last = self.items[self.reached]
                if last.command == 21:
                    self.landed_state, self.armed = 1, False
                    self.reached -= self.script.get("silent_landing", 0)
                    if self.script.get("silent_landing"):
                        return
                self.say("MISSION_ITEM_REACHED", self.reached)

    def on_mission_count(self, t_ns, m):
        self.count = m.count
        if m.count > self.script.get("room", 2000):
            self.say("MISSION_ACK", 255, 190, 4)
        else:
            self.items = {}
            self.say("MISSION_REQUEST_INT", 255, 190, 0)

    def on_mission_item_int(self, t_ns, m):
        if m.seq == self.script.get("reject_seq"):
            self.say("MISSION_ACK", 255, 190, 12)
            return
        self.items[m.seq] = m
        if m.seq + 1 < self.count:
            name = "MISSION_REQUEST" if self.script.get("old_requests") else "MISSION_REQUEST_INT"
            self.say(name, 255, 190, m.seq + 1)
        else:
            self.say("MISSION_ACK", 255, 190, 0)

    def on_command_long(self, t_ns, m):
        if m.command in self.script.get("ignore", ()):
            return
        # An answer to somebody else comes first: not for us.
        self.say("COMMAND_ACK", m.command, 4, 0, 0, 245, 190)
        result = self.script.get("results", {}).get(m.command, 0)
        if m.command == 511:
            self.interval[int(m.param1)] = m.param2
        if m.command == 400 and self.arm_refusals:
            self.arm_refusals -= 1
            self.say("STATUSTEXT", 3, "Arming denied: gyro bias")
            result = 1
        if result == 0 and m.command == 176:
            self.mode = int(m.param2) << 16 | int(m.param3) << 24
        if result == 0 and m.command == 400:
            self.armed, self.armed_at_ns = True, t_ns
        self.say("COMMAND_ACK", m.command, result, 0, 0, 255, 190)


def test_a_whole_flight():
    station, vehicle = GroundStation(RECTANGLE), Vehicle()
    fly(station, vehicle)
    assert station.phase is Phase.DONE
    assert station.mission_completed
    assert (station.reached, station.waypoints) == (6, 6)
    got = [vehicle.items[i] for i in range(6)]
    assert [(m.command, m.x, m.y, m.z) for m in got] == [
        (i.command, i.lat_degE7, i.lon_degE7, i.alt_m) for i in RECTANGLE
    ]
    assert got[0].current == 1
    assert all(math.isnan(m.param4) for m in got)
    assert vehicle.commands() == [(176, 1.0, 4.0, 4.0), (400, 1.0, 0.0, 0.0)]
    assert set(vehicle.interval) == {MSGID["SYS_STATUS"], MSGID["EXTENDED_SYS_STATE"], MSGID["MISSION_CURRENT"]}


def test_it_is_a_pure_function_of_time_and_frames():
    assert fly(GroundStation(RECTANGLE), Vehicle()) == fly(GroundStation(RECTANGLE), Vehicle())


def test_heartbeat_once_a_simulated_second_without_drift():
    station, vehicle = GroundStation(RECTANGLE, heartbeat_limit_s=1e9), Vehicle(mute=True)
    log = fly(station, vehicle, limit_s=20.0)
    ticks = [tick for tick, data in enumerate(log) if data]
    assert ticks == list(range(0, 5000, 250))


def test_nothing_to_do_says_nothing():
    station, vehicle = GroundStation(RECTANGLE), Vehicle()
    log = fly(station, vehicle)
    assert sum(bool(data) for data in log) < len(log) / 50


@pytest.mark.parametrize("lose", [1, 2, 4])
def test_lost_messages_are_asked_again(lose):
    station, vehicle = GroundStation(RECTANGLE), Vehicle(lose=lose)
    fly(station, vehicle)
    assert station.mission_completed
    repeats = [m.confirmation for m in vehicle.sent("COMMAND_LONG")]
    assert max(repeats) == lose


def test_the_older_request_message_is_answered_too():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(old_requests=True)
    fly(station, vehicle)
    assert station.mission_completed


def test_arming_is_asked_again_while_the_vehicle_declines():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(arm_refusals=3)
    fly(station, vehicle)
    assert station.mission_completed
    assert len([m for m in vehicle.sent("COMMAND_LONG") if m.command == 400]) == 4
    assert [text for _, _, text in station.statustexts] == ["Arming denied: gyro bias"] * 3


def test_arming_waits_for_health():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(ready_ns=7 * S)
    fly(station, vehicle)
    assert station.mission_completed
    assert vehicle.armed_at_ns >= 7 * S


def test_a_vehicle_that_does_not_report_health_is_asked_all_the_same():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(no_prearm_bit=True)
    fly(station, vehicle)
    assert station.mission_completed


@pytest.mark.parametrize(
    ("script", "settings", "says"),
    [
        ({"mute": True}, {"heartbeat_limit_s": 3.0}, "no heartbeat of vehicle 1 within 3 s of simulated time"),
        ({"sysid": 9}, {"heartbeat_limit_s": 3.0}, "no heartbeat of vehicle 1"),
        ({"room": 5}, {}, "6 items was refused after 0 of them: MAV_MISSION_NO_SPACE; .*shorten"),
        ({"reject_seq": 2}, {}, "refused after 3 of them: MAV_MISSION_INVALID_PARAM7; an altitude"),
        ({"ready_ns": 1 << 60}, {"preflight_limit_s": 5.0}, "not ready to arm after 5 s .*pre-arm check does not pass"),
        ({"arm_refusals": 999}, {"preflight_limit_s": 8.0}, "asked to arm .*TEMPORARILY_REJECTED .*gyro bias"),
        ({"results": {400: 2}}, {}, "asked to arm and answered MAV_RESULT_DENIED"),
        ({"results": {176: 3}}, {}, "asked to enter mode AUTO.MISSION and answered MAV_RESULT_UNSUPPORTED"),
        ({"ignore": (400,)}, {}, "MAV_CMD_COMPONENT_ARM_DISARM was asked 5 times and never answered"),
        ({"crash_ns": 1}, {}, "accepted arming 5 times, but its heartbeats never say"),
        ({"crash_ns": 4_200_000_000}, {}, "disarmed before it took off"),
        ({"hold": True}, {"takeoff_limit_s": 5.0}, "armed, but not in the air after 5 s"),
    ],
)
def test_each_refusal_is_one_clear_error(script, settings, says):
    station = GroundStation(RECTANGLE, **settings)
    with pytest.raises(HandshakeError, match=says):
        fly(station, Vehicle(**script), limit_s=120.0)


def test_a_mission_service_that_is_not_there():
    class NoMissions(Vehicle):
        on_mission_count = None

    with pytest.raises(HandshakeError, match="mission service"):
        fly(GroundStation(RECTANGLE), NoMissions(), limit_s=60.0)


def test_ten_thousand_items():
    station = GroundStation([item(i, 16) for i in range(10_000)])
    with pytest.raises(HandshakeError, match=r"10000 items was refused .*NO_SPACE"):
        fly(station, Vehicle(), limit_s=30.0)
    with pytest.raises(HandshakeError, match="65535"):
        fly(GroundStation([item(0, 16)] * 70_000), Vehicle(), limit_s=30.0)


def test_a_mission_of_nothing_is_refused():
    with pytest.raises(HandshakeError, match="no items"):
        GroundStation([])


def test_crash_in_flight_is_an_end_without_completion():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(crash_ns=6 * S)
    fly(station, vehicle)
    assert station.phase is Phase.DONE
    assert not station.mission_completed
    assert 0 < station.reached < 6


def test_a_landing_the_vehicle_did_not_report_counts_when_it_stands_there():
    station, vehicle = GroundStation(RECTANGLE), Vehicle(silent_landing=1)
    fly(station, vehicle)
    assert station.mission_completed


def test_a_mission_without_landing_is_landed_at_its_end():
    station, vehicle = GroundStation(RECTANGLE[:-1]), Vehicle()
    fly(station, vehicle)
    assert station.phase is Phase.DONE
    assert [m.param3 for m in vehicle.sent("COMMAND_LONG") if m.command == 176] == [4.0, 6.0]


def test_watching_only():
    station, vehicle = GroundStation([], fly=False), Vehicle()
    station.step(0, [])
    vehicle.items = {0: item(0, 22), 1: item(1, 21)}
    parser, frames = FrameParser(), []
    for tick in range(1, 5000):
        if tick == 1000:
            vehicle.mode, vehicle.armed, vehicle.armed_at_ns = 4 << 16 | 4 << 24, True, tick * TICK_NS
        data = station.step(tick * TICK_NS, frames)
        frames = parser.feed(b"".join(vehicle.step(tick * TICK_NS, data)))
    assert station.phase is Phase.DONE
    assert station.reached == 2
    assert {m.command for m in vehicle.sent("COMMAND_LONG")} == {511}
    assert not vehicle.sent("MISSION_COUNT")


@pytest.mark.parametrize(
    ("command", "lat", "lon", "counts"),
    [(16, 1, 1, True), (17, 1, 1, True), (19, 1, 1, True), (22, 0, 0, True), (21, 0, 0, False), (21, 5, 0, True),
     (20, 0, 0, False), (178, 0, 0, False), (93, 0, 0, False)],
)  # fmt: skip
def test_what_counts_as_a_waypoint(command, lat, lon, counts):
    assert is_waypoint(MissionItem(0, 6, command, 0, 1, 0.0, 0.0, 0.0, 0.0, lat, lon, 1.0)) == counts


def test_long_texts_are_joined():
    station = GroundStation(RECTANGLE)
    vehicle = Vehicle()
    vehicle.say("STATUSTEXT", 4, "a" * 50, 7, 0)
    vehicle.say("STATUSTEXT", 4, "b", 7, 1)
    vehicle.say("STATUSTEXT", 4, "c", 0, 0)
    station.step(S, FrameParser().feed(b"".join(vehicle.out)))
    assert station.statustexts == [(S, 4, "a" * 50 + "b"), (S, 4, "c")]


def test_other_vehicles_and_components_are_not_listened_to():
    station = GroundStation(RECTANGLE)
    vehicle = Vehicle()
    vehicle.say("HEARTBEAT", 2, 12, 0x80, 0, 4, 3, encoder=FrameEncoder(2, 1))
    vehicle.say("HEARTBEAT", 30, 8, 0x80, 0, 4, 3, encoder=FrameEncoder(1, 100))
    station.step(0, FrameParser().feed(b"".join(vehicle.out)))
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
