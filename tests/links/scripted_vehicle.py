"""A vehicle that talks MAVLink with a ground station in simulated time and flies one item a second. No physics."""

from __future__ import annotations

from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack, unpack
from firmware_bridge.ground_station.phased_flight import Phase
from firmware_bridge.ground_station.station import GroundStation

TICK_NS = 4_000_000
S = 1_000_000_000
PREARM = 0x10000000


class ScriptedVehicle:
    """What PX4's and ArduPilot's have in common; `script` entries change what each does.

    sysid, mute (no heartbeats), no_prearm_bit, ready_ns (the pre-arm check passes), lose (messages not heard).
    """

    autopilot = 12

    def __init__(self, **script: Any) -> None:
        self.script = script
        self.encoder, self.parser = FrameEncoder(script.get("sysid", 1), 1), FrameParser()
        self.out: list[bytes] = []
        self.items: dict[int, Any] = {}
        self.count = 0
        self.armed = False
        self.mode = 0
        self.landed_state = 1
        self.reached = -1
        self.heard: list[tuple[str, Any]] = []
        self.lose = script.get("lose", 0)

    def say(self, name: str, *values: Any, encoder: FrameEncoder | None = None) -> None:
        message = message_class(name)(*values)
        self.out.append((encoder or self.encoder).frame(message.MSGID, pack(message)))

    def step(self, t_ns: int, data: bytes) -> list[bytes]:
        for frame in self.parser.feed(data):
            message = unpack(frame)
            name = type(message).__name__
            self.heard.append((name, message))
            handler = getattr(self, "on_" + name.lower(), None)
            if handler and self.lose and name != "HEARTBEAT":
                self.lose -= 1
            elif handler:
                handler(t_ns, message)
        if t_ns % S == 0 and not self.script.get("mute"):
            self.say("HEARTBEAT", 2, self.autopilot, 0x80 if self.armed else 0, self.mode, 4 if self.armed else 3, 3)
        if t_ns % (S // 2) == 0:
            present = 0 if self.script.get("no_prearm_bit") else PREARM
            ready = t_ns >= self.script.get("ready_ns", 3 * S)
            self.say("SYS_STATUS", present, present, present if ready else 0, *[0] * 10)
            self.say("EXTENDED_SYS_STATE", 0, self.landed_state)
            self.say("MISSION_CURRENT", max(min(self.reached + 1, len(self.items) - 1), 0), len(self.items))
            self.fly(t_ns)
        out, self.out = self.out, []
        return out

    def fly(self, t_ns: int) -> None:
        """Twice a second."""

    def sent(self, name: str) -> list[Any]:
        """The station's messages of this name."""
        return [message for heard, message in self.heard if heard == name]

    def commands(self) -> list[tuple[int, float, float, float]]:
        """(command, params 1 to 3) without the wishes for telemetry."""
        asked = [(m.command, m.param1, m.param2, m.param3) for m in self.sent("COMMAND_LONG")]
        return [command for command in asked if command[0] != 511]


def fly(station: GroundStation, vehicle: ScriptedVehicle, limit_s: float = 60.0) -> list[bytes]:
    """Fly until DONE or the limit of simulated time; the bytes of every tick."""
    parser, log, frames = FrameParser(), [], []
    t_ns = 0
    while t_ns < limit_s * S and station.phase is not Phase.DONE:
        log.append(station.step(t_ns, frames))
        frames = parser.feed(b"".join(vehicle.step(t_ns, log[-1])))
        t_ns += TICK_NS
    return log
