"""A vehicle that speaks MAVLink in simulated time and flies one mission item each half second. No physics."""

from __future__ import annotations

import math
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack, unpack
from firmware_bridge.ground_station.modes import ARDUPILOT, PX4, mode_number
from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation

TICK_NS = 4_000_000
S = 1_000_000_000
PREARM = 0x10000000
ACCEPTED, REJECTED_FOR_NOW, DENIED, FAILED = 0, 1, 2, 4
SET_MODE, MISSION_START, ARM = 176, 300, 400
COMPLAINT = "Arming denied: gyro bias"


class ScriptedVehicle:
    """Answers as PX4 or ArduCopter (`autopilot`) does; entries of `script` change what it does.

    answers: by command, or for every one: a result, None for silence, or a list of them, of which the last one stays;
    sysid, mute (no heartbeats), no_prearm_bit, ready_ns (the pre-arm check passes), lose (messages not heard);
    resumes (item at which an earlier flight of the same mission ended);
    room (items), room_ns (none before), reject_seq, lost_acks, old_requests: how missions are taken;
    hold (does not take off), crash_ns, silent_landing: how it flies.
    """

    telemetry_ns: int | None = S // 2

    def __init__(self, autopilot: int = PX4, **script: Any) -> None:
        self.autopilot, self.script = autopilot, script
        self.encoder, self.parser = FrameEncoder(script.get("sysid", 1), 1), FrameParser()
        self.out: list[bytes] = []
        self.heard: list[tuple[int, Any]] = []
        self.answers = script.get("answers", {})
        self.lose, self.lost_acks = script.get("lose", 0), script.get("lost_acks", 0)
        self.intervals: dict[int, float] = {}
        self.items: dict[int, Any] = {}
        self.count = 0
        self.armed, self.armed_at_ns, self.mode, self.landed_state = False, 0, 0, 1
        # ArduPilot's item 0 is home.
        self.reached = 0 if autopilot == ARDUPILOT else script.get("resumes", 0) - 1

    # ---- messages

    def say(self, name: str, *values: Any, encoder: FrameEncoder | None = None) -> None:
        message = message_class(name)(*values)
        self.out.append((encoder or self.encoder).frame(message.MSGID, pack(message)))

    def speak(self, t_ns: int) -> list[Frame]:
        """Return its messages at `t_ns`."""
        if t_ns % S == 0 and not self.script.get("mute"):
            self.beat()
        if self.telemetry_ns and t_ns % self.telemetry_ns == 0:
            present = 0 if self.script.get("no_prearm_bit") else PREARM
            ready = t_ns >= self.script.get("ready_ns", 3 * S)
            self.say("SYS_STATUS", present, present, present if ready else 0, *[0] * 10)
            self.say("EXTENDED_SYS_STATE", 0, self.landed_state)
            self.tell(t_ns)
        out, self.out = self.out, []
        return FrameParser().feed(b"".join(out))

    def beat(self) -> None:
        self.say("HEARTBEAT", 2, self.autopilot, 0x80 * self.armed | 1, self.mode, 4 if self.armed else 3, 3)

    def hear(self, t_ns: int, data: bytes) -> None:
        for frame in self.parser.feed(data):
            message = unpack(frame)
            name = type(message).__name__
            self.heard.append((t_ns, message))
            handler = getattr(self, "on_" + name.lower(), None)
            if handler and self.lose:
                self.lose -= 1
            elif handler:
                handler(t_ns, message, frame.compid)

    def sent(self, name: str) -> list[Any]:
        """Return the messages of this name that it received."""
        return [message for _, message in self.heard if type(message).__name__ == name]

    def commands(self) -> list[tuple[int, float, float, float]]:
        """Return (command, params 1 to 3) of commands, without those that ask for telemetry."""
        asked = [(m.command, m.param1, m.param2, m.param3) for m in self.sent("COMMAND_LONG")]
        return [command for command in asked if command[0] not in (511, 512)]

    # ---- commands

    def on_command_long(self, t_ns: int, m: Any, sender: int) -> None:
        result = self.answers.get(m.command, ACCEPTED) if isinstance(self.answers, dict) else self.answers
        if isinstance(result, list):
            result = result.pop(0) if len(result) > 1 else result[0]
        if result is None:
            return
        self.say("COMMAND_ACK", m.command, DENIED, 0, 0, 255, sender - 1)  # an answer to another system comes first
        if result == ACCEPTED:
            result = self.obey(t_ns, m)
        if result in (REJECTED_FOR_NOW, FAILED):
            self.say("STATUSTEXT", 3, COMPLAINT)
        self.say("COMMAND_ACK", m.command, result, 0, 0, 255, sender)

    def obey(self, t_ns: int, m: Any) -> int:
        """Carry out a command that it accepts."""
        copter = self.autopilot == ARDUPILOT
        if m.command == 511:
            self.intervals[int(m.param1)] = m.param2
        elif m.command == SET_MODE:
            self.mode = int(m.param2) if copter else int(m.param2) << 16 | int(m.param3) << 24
        elif m.command == ARM:
            if copter and self.mode != mode_number(ARDUPILOT, "GUIDED").custom_mode:
                return FAILED  # "mode not armable": it does not arm in AUTO
            self.armed, self.armed_at_ns = True, t_ns
        elif m.command == MISSION_START:
            if not self.armed:
                return FAILED
            self.mode = mode_number(ARDUPILOT, "MISSION").custom_mode
        return ACCEPTED

    # ---- missions

    def on_mission_count(self, t_ns: int, m: Any, _: int) -> None:
        if m.count > self.script.get("room", 2000) or t_ns < self.script.get("room_ns", 0):
            self.say("MISSION_ACK", 255, 190, 4)
            return
        self.count, self.items = m.count, {}
        self.ask_for(0)

    def ask_for(self, seq: int) -> None:
        old = self.autopilot == ARDUPILOT or self.script.get("old_requests")
        self.say("MISSION_REQUEST" if old else "MISSION_REQUEST_INT", 255, 190, seq)

    def on_mission_item_int(self, t_ns: int, m: Any, _: int) -> None:
        numbers = (m.param1, m.param2, m.param3, m.param4, m.z)
        if m.seq == self.script.get("reject_seq"):
            self.say("MISSION_ACK", 255, 190, 12)
        elif self.autopilot == ARDUPILOT and any(math.isnan(number) for number in numbers):
            self.say("MISSION_ACK", 255, 190, 5)
        else:
            self.items[m.seq] = m
            if m.seq + 1 < self.count:
                self.ask_for(m.seq + 1)
            elif self.lost_acks:
                self.lost_acks -= 1
            else:
                self.say("MISSION_ACK", 255, 190, 0)

    def on_mission_set_current(self, t_ns: int, m: Any, _: int) -> None:
        self.reached = m.seq - 1

    def tell(self, t_ns: int) -> None:
        """Return the telemetry of its mission."""
        self.say("MISSION_CURRENT", max(min(self.reached + 1, len(self.items) - 1), 0), len(self.items))
        if not self.armed:
            return
        if self.mode == mode_number(self.autopilot, "LAND").custom_mode:
            self.landed_state, self.armed = 1, False
        if self.mode != mode_number(self.autopilot, "MISSION").custom_mode:
            return
        if t_ns > self.script.get("crash_ns", math.inf):
            self.landed_state, self.armed = 1, False
        elif t_ns - self.armed_at_ns > S and not self.script.get("hold"):
            self.landed_state = 2
            if self.reached + 1 < len(self.items):
                self.fly_on()

    def fly_on(self) -> None:
        lands = self.items[self.reached + 1].command == 21
        if lands:
            self.landed_state, self.armed = 1, False
        if not (lands and self.script.get("silent_landing")):
            self.reached += 1
            self.say("MISSION_ITEM_REACHED", self.reached)


def fly(station: GroundStation, vehicle: ScriptedVehicle, limit_s: float = 60.0) -> list[bytes]:
    """Fly until DONE or the limit of simulated time; return the bytes of every tick."""
    log: list[bytes] = []
    while (t_ns := len(log) * TICK_NS) < limit_s * S and station.phase is not Phase.DONE:
        log.append(station.step(t_ns, vehicle.speak(t_ns)))
        vehicle.hear(t_ns, log[-1])
    return log
