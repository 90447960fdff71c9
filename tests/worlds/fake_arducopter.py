"""A stand-in for ArduPilot SITL behind the JSON link: it stands on the ground and has parameters.

As ArduPlane (`kind` "1", a MAV_TYPE) it sends the place-holders of its boot, takes a mission and, once armed, gives
full throttle on output 1 with level surfaces: it does not steer.

It takes ArduCopter's command line (--sim-port-out, --serial0 udpclient:HOST:PORT). MAVLink is served once in each
step, before the next servo packet, as SITL does. In its folder, `parameters.json` has what was asked for and set:
[["read" or "set", name, value, steps so far], ...]; `commands.json` the commands: [[number, param 1, param 2], ...].
"""

from __future__ import annotations

import argparse
import atexit
import json
import os
import re
import socket
import sys
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from tests.worlds.ardupilot_json_sitl import encode_servos

KNOWN = {
    "SIM_GPS1_ENABLE": (1.0, 2),
    **{f"SIM_GPS1_GLTCH_{axis}": (0.0, 9) for axis in "XYZ"},
    **{f"SIM_{baro}_{name}": (0.0, 2) for baro in ("BARO", "BAR2", "BAR3") for name in ("DISABLE", "FREEZE")},
    **{f"SIM_{baro}_GLITCH": (0.0, 9) for baro in ("BARO", "BAR2", "BAR3")},
    **{f"SIM_MAG{n}_FAIL": (0.0, 2) for n in (1, 2, 3)},
    **{
        f"SIM_MAG{n}_OFS_{axis}": (value, 9) for n in (1, 2, 3) for axis, value in zip("XYZ", (5, 13, -18), strict=True)
    },
}
"""Parameters of ArduCopter 4.7: value and MAV_PARAM_TYPE."""


PLANE = 1  # MAV_TYPE_FIXED_WING
_SET_MODE, _ARM = 176, 400
_BOOT_STEPS = 20


def install(folder: Path, **settings: str) -> Path:
    """Write the program into a folder and return its path. `settings`: see `serve`."""
    program = folder / "arducopter"
    root = Path(__file__).resolve().parents[2]
    program.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(root)!r})\n"
        f"from tests.worlds.fake_arducopter import serve\nserve(**{settings!r})\n"
    )
    program.chmod(0o755)
    return program


def serve(*, lacks: str = "", arms: str = "", kind: str = "2") -> None:
    """Serve until the bench ends it.

    `lacks`: parameters that it does not have, a regular expression; `arms`: the heartbeat that first says armed, by its
    number, one each second; `kind`: MAV_TYPE.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--sim-port-out", type=int)
    parser.add_argument("--serial0")
    given, _ = parser.parse_known_args()
    known = {name: value for name, value in KNOWN.items() if not (lacks and re.match(lacks, name))}
    FakeArduCopter(given.sim_port_out, int(given.serial0.rpartition(":")[2]), known, int(arms or 0), int(kind)).run()


class FakeArduCopter:
    """`known`: parameters by name, value and MAV_PARAM_TYPE."""

    def __init__(
        self, servo_port: int, mavlink_port: int, known: dict[str, tuple[float, int]], arms: int, kind: int
    ) -> None:
        self.known, self.arms, self.kind = dict(known), arms, kind
        self.commands: list[tuple[int, float, float]] = []
        self.mode, self.items, self.armed_at = 0, 0, 0
        self.beats = 0
        self.servo = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.servo.connect(("127.0.0.1", servo_port))
        self.mavlink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mavlink.bind(("127.0.0.1", 0))
        self.mavlink.setblocking(False)
        self.to = ("127.0.0.1", mavlink_port)
        self.encoder, self.parser = FrameEncoder(1, 1), FrameParser()
        self.asked: list[tuple[str, str, float, int]] = []
        self.steps = 0
        atexit.register(self.save)

    def run(self) -> None:
        from firmware_bridge.codecs.ardupilot_json import ServoPacket

        while True:
            if self.steps % 400 == 100:
                self.beats += 1
                armed = bool(self.armed_at) or 0 < self.arms <= self.beats
                self.say("HEARTBEAT", self.kind, 3, 0x80 if armed else 0, self.mode, 3, 3)
            self.serve_mavlink()
            self.servo.send(encode_servos(ServoPacket(400, self.steps, self.outputs())))
            try:
                self.servo.recv(65536)
            except OSError:
                return
            self.steps += 1

    def outputs(self) -> tuple[int, ...]:
        if self.kind != PLANE:
            return (1000,) * 16
        if self.steps < _BOOT_STEPS:
            return (1500, 1500, 1000, 1500, *(1000,) * 12)
        return (2000 if self.armed_at else 1000, 1500, 1500, *(0,) * 13)

    def say(self, name: str, *values: object) -> None:
        message = message_class(name)(*values)
        self.mavlink.sendto(self.encoder.frame(MSGID[name], pack(message)), self.to)

    def serve_mavlink(self) -> None:
        while True:
            try:
                data = self.mavlink.recv(65536)
            except BlockingIOError:
                return
            for frame in self.parser.feed(data):
                if frame.msgid == MSGID["COMMAND_LONG"]:
                    self.take_command(unpack(frame))
                elif frame.msgid == MSGID["MISSION_COUNT"]:
                    self.items = unpack(frame).count
                    self.say("MISSION_REQUEST_INT", 255, 190, 0, 0)
                elif frame.msgid == MSGID["MISSION_ITEM_INT"]:
                    after = unpack(frame).seq + 1
                    if after < self.items:
                        self.say("MISSION_REQUEST_INT", 255, 190, after, 0)
                    else:
                        self.say("MISSION_ACK", 255, 190, 0, 0)
                elif frame.msgid in (MSGID["PARAM_REQUEST_READ"], MSGID["PARAM_SET"]):
                    self.serve_parameter(unpack(frame), is_set=frame.msgid == MSGID["PARAM_SET"])

    def take_command(self, message: Any) -> None:
        self.commands.append((message.command, message.param1, message.param2))
        if message.command == _SET_MODE:
            self.mode = int(message.param2)
        elif message.command == _ARM and message.param1 == 1.0:
            self.armed_at = self.steps
        self.save()
        self.say("COMMAND_ACK", message.command, 0)

    def serve_parameter(self, message: object, *, is_set: bool) -> None:
        name = message.param_id  # type: ignore[attr-defined]
        self.asked.append(
            ("set" if is_set else "read", name, message.param_value if is_set else 0.0, self.steps)  # type: ignore[attr-defined]
        )
        self.save()
        if name not in self.known:
            return
        value, kind = self.known[name]
        if is_set:
            value = message.param_value  # type: ignore[attr-defined]
            self.known[name] = (value, kind)
        self.say("PARAM_VALUE", name, value, kind, 1, 0)

    def save(self) -> None:
        Path("parameters.json.new").write_text(json.dumps(self.asked))
        os.replace("parameters.json.new", "parameters.json")
        Path("commands.json").write_text(json.dumps(self.commands))
