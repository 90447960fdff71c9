"""A stand-in for PX4 SITL: the mock on PX4's own TCP and UDP ports, with a script of faults.

    TCP client to port 4560 + instance     HIL messages in, HIL_ACTUATOR_CONTROLS out; once a HEARTBEAT, at connecting
    UDP on port 18570 + instance           everything else, to the last sender

One thread, which looks at TCP first: so the order of the bench's messages on the two wires is the bench's own.
`script` is KIND@N, the fault at the N-th HIL_SENSOR: exit, kill, hang_up, stop (SIGSTOP), slow (answers
late), lost (ignores it), silent (answers nothing any more), heartbeat, text (silent, and sends the reason),
late_heartbeat (sends it a second of simulated time later).
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser, FrameSplitter, message_id
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk

HIL_SENSOR = MSGID["HIL_SENSOR"]
HIL_ACTUATOR_CONTROLS = MSGID["HIL_ACTUATOR_CONTROLS"]
COMMAND_LONG = MSGID["COMMAND_LONG"]
TERMINATE = 185
CONNECT_LIMIT_S = 300.0
SLOW_S = 2.0


class FakePx4:
    """`order` lists its inputs in order of arrival: ("sensor", time_usec) and ("command", MAV_CMD)."""

    def __init__(
        self,
        instance: int,
        *,
        airframe: str = "iris",
        boot_sensors: int = 17,
        script: str = "",
        params: Mapping[str, str] | None = None,
    ) -> None:
        self.mock = MockPixhawk(airframe=airframe, boot_sensors=boot_sensors)
        for name, value in (params or {}).items():  # as PX4's start script sets them
            refusal = self.mock.params.set(name, float(value))
            if refusal:
                print(f"ERROR [parameters] Parameter {name} not found: {refusal}", flush=True)
        self.encoder = FrameEncoder(1, 1)
        kind, _, at = script.partition("@")
        self.kind, self.at = kind, int(at or 0)
        self.sensors = 0
        self.silent = False
        self.say_at_us: int | None = None
        self.order: list[tuple[str, int]] = []
        self.handled = 0  # sensor messages, with whatever was sent because of them
        self.tcp_port = 4560 + instance
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 18570 + instance))
        self.ground: tuple[str, int] | None = None
        self.ended = threading.Event()

    def serve(self) -> None:
        """Serve until the bench closes the connection."""
        try:
            self._serve()
        except ConnectionAbortedError:
            return
        finally:
            self.udp.close()
            self.ended.set()

    def _serve(self) -> None:
        tcp = self._connect()
        if tcp is None:
            return
        with tcp:
            tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            tcp.sendall(self.mock.boot())
            splitter = FrameSplitter()
            while True:
                ready = select.select([tcp, self.udp], [], [])[0]
                if tcp in ready:
                    try:
                        data = tcp.recv(65536)
                    except OSError:
                        return
                    if not data:
                        return
                    answers = b"".join(self.on_tcp(unit) for unit in splitter.feed(data))
                    if answers:
                        tcp.sendall(answers)
                    self.handled = self.sensors
                elif self.udp in ready:
                    data, self.ground = self.udp.recvfrom(65536)
                    self.on_udp(data)

    def _connect(self) -> socket.socket | None:
        """Try until the bench listens, as PX4 does."""
        until_s = time.monotonic() + CONNECT_LIMIT_S
        while time.monotonic() < until_s:
            try:
                return socket.create_connection(("127.0.0.1", self.tcp_port))
            except OSError:
                time.sleep(0.02)
        return None

    def on_tcp(self, unit: bytes) -> bytes:
        """Take one HIL message and return the answer on TCP."""
        if message_id(unit) != HIL_SENSOR:
            return self.route(self.mock.feed(unit)) if not self.silent else b""
        (frame,) = FrameParser().feed(unit)
        now_us = int.from_bytes(frame.payload[:8], "little")
        self.order.append(("sensor", now_us))
        self.sensors += 1
        if self.at and self.sensors == self.at and not self.misbehave(now_us):
            return b""
        if self.say_at_us is not None and now_us >= self.say_at_us:
            self.say_at_us = None
            self.say("HEARTBEAT", 2, 12, 0x81, 4 << 16, 8, 3)
        return b"" if self.silent else self.route(self.mock.feed(unit))

    def misbehave(self, now_us: int) -> bool:
        """Do the scripted fault; return True if the message is then handled as usual."""
        match self.kind:
            case "exit":
                print("ERROR [fake] estimator diverged", flush=True)
                os._exit(7)
            case "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            case "stop":
                os.kill(os.getpid(), signal.SIGSTOP)
            case "slow":
                time.sleep(SLOW_S)
            case "hang_up":
                raise ConnectionAbortedError
            case "lost":
                return False
            case "silent":
                self.silent = True
            case "heartbeat":
                self.silent = True
                self.say("HEARTBEAT", 2, 12, 0x81, 4 << 16, 8, 3)
            case "late_heartbeat":
                self.silent = True
                self.say_at_us = now_us + 1_000_000
            case "text":
                self.silent = True
                self.say("STATUSTEXT", 0, "Flight termination active")
            case _:
                raise AssertionError(self.kind)
        return True

    def on_udp(self, data: bytes) -> None:
        for frame in FrameParser().feed(data):
            if frame.msgid == COMMAND_LONG:
                command = unpack(frame).command
                self.order.append(("command", command))
                if command == TERMINATE:
                    self.silent = True  # without a message
        if not self.silent:
            self.route(self.mock.feed(data))

    def route(self, out: bytes) -> bytes:
        """Send the frames that belong on UDP and return those that belong on TCP."""
        answers = b""
        for unit in FrameSplitter().feed(out):
            if message_id(unit) == HIL_ACTUATOR_CONTROLS:
                answers += unit
            elif self.ground is not None:
                self.udp.sendto(unit, self.ground)
        return answers

    def say(self, name: str, *values: object) -> None:
        message = message_class(name)(*values)
        if self.ground is not None:
            self.udp.sendto(self.encoder.frame(message.MSGID, pack(message)), self.ground)


def main() -> None:
    """Run as PX4's program: `px4 -i INSTANCE -d DATA`. FAKE_PX4 holds the script; FAKE_PX4_CHILD adds a child."""
    parser = argparse.ArgumentParser()
    parser.add_argument("-i", type=int, default=0)
    parser.add_argument("-d", action="store_true")
    parser.add_argument("data", nargs="*")
    arguments = parser.parse_args()
    child = 0
    if os.environ.get("FAKE_PX4_CHILD"):
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]).pid
    kept = {name: value for name, value in os.environ.items() if name.startswith(("PX4_", "FAKE_PX4"))}
    found = sorted(path.name for path in Path.cwd().iterdir())
    told = {"env": kept, "data": arguments.data, "found": found, "child": child, "pid": os.getpid()}
    Path("started.json").write_text(json.dumps(told))
    airframe = os.environ.get("PX4_SIM_MODEL", "none_iris").removeprefix("none_")
    params = {name[10:]: value for name, value in os.environ.items() if name.startswith("PX4_PARAM_")}
    fake = FakePx4(arguments.i, airframe=airframe, script=os.environ.get("FAKE_PX4", ""), params=params)
    print(
        f"INFO  [fake] airframe {os.environ.get('PX4_SYS_AUTOSTART')}", flush=True
    )  # PX4 too has set parameters before
    fake.serve()


if __name__ == "__main__":
    main()
