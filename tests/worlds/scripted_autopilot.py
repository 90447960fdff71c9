"""A scripted autopilot for the lockstep link: answers as PX4 does, or fails in one declared way at one tick.

In memory it is a loopback peer (`feed`). As a program (`python scripted_autopilot.py --port PTY ...`) it serves a
serial port opened with pyserial.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.transports.serial import SerialTransport
from signals.errors import LinkClosed

HIL_SENSOR = MSGID["HIL_SENSOR"]
Controls = message_class("HIL_ACTUATOR_CONTROLS")
Heartbeat = message_class("HEARTBEAT")
CommandLong = message_class("COMMAND_LONG")
Attitude = message_class("ATTITUDE")

GARBAGE = bytes(range(256)) * 3 + b"\xfd\xff\xfe\xfd"


class FakeAutopilot:
    """Answers each HIL_SENSOR after the first `boot_sensors`. At answer number `at` it does `fault`."""

    def __init__(self, *, boot_sensors: int = 3, fault: str = "", at: int = 5, greet: bool = True) -> None:
        self.encoder = FrameEncoder(1, 1)
        self.parser = FrameParser()
        self.boot_sensors = boot_sensors
        self.fault, self.at = fault, at
        self.greet = greet
        self.seen = 0
        self.answers = 0
        self.received: list[int] = []

    def frame(self, message: object) -> bytes:
        return self.encoder.frame(message.MSGID, pack(message))  # type: ignore[attr-defined]

    def greeting(self) -> bytes:
        ask = CommandLong(0, 0, 511, 0, 115.0, 5000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return self.frame(ask) + self.frame(Heartbeat(2, 12, 0, 0, 0, 3))

    def boot(self) -> bytes:
        return self.greeting() if self.greet else b""

    def feed(self, data: bytes) -> bytes:
        out = b""
        for frame in self.parser.feed(data):
            self.received.append(frame.msgid)
            if frame.msgid == HIL_SENSOR:
                out += self.sensor(int.from_bytes(frame.payload[:8], "little"))
        return out

    def sensor(self, time_us: int) -> bytes:
        self.seen += 1
        if self.seen <= self.boot_sensors:
            return b""
        self.answers += 1
        value = (self.answers % 1000) / 1000.0
        controls = [value] * 4 + [0.0] * 12
        telemetry = (
            self.frame(Attitude(time_us // 1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)) if self.answers % 5 == 0 else b""
        )
        if self.answers != self.at:
            return telemetry + self.answer(time_us, controls)
        return self.misbehave(time_us, controls, telemetry)

    def answer(self, time_us: int, controls: list[float]) -> bytes:
        return self.frame(Controls(time_us, tuple(controls), 129, 1))

    def misbehave(self, time_us: int, controls: list[float], telemetry: bytes) -> bytes:
        good = telemetry + self.answer(time_us, controls)
        match self.fault:
            case "wrong_time":
                return telemetry + self.answer(time_us + 4000, controls)
            case "old_time":
                return telemetry + self.answer(time_us - 4000, controls)
            case "twice":
                return good + self.answer(time_us, controls)
            case "silent":
                return b""
            case "telemetry_only":
                return self.frame(Attitude(time_us // 1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
            case "garbage_between":
                return GARBAGE + good + GARBAGE
            case "garbage_only":
                return GARBAGE
            case "damaged_length":
                # A telemetry frame with a raised length byte: it seems to reach beyond the answer after it.
                broken = bytearray(telemetry)
                broken[1] = 250
                return bytes(broken) + self.answer(time_us, controls)
            case "damaged":
                broken = bytearray(good)
                broken[-10] ^= 0x40
                return bytes(broken)
            case "nan":
                return telemetry + self.answer(time_us, [float("nan"), *controls[1:]])
            case "range":
                return telemetry + self.answer(time_us, [1.5, *controls[1:]])
            case "trailing":
                return good + self.frame(Heartbeat(2, 12, 0, 0, 0, 3))
            case "exit":
                sys.stderr.write("fake autopilot: estimator diverged\n")
                sys.stderr.flush()
                os._exit(7)
            case "kill":
                os.kill(os.getpid(), 9)
            case "hang":
                time.sleep(3600)
            case "":
                return good
        raise AssertionError(self.fault)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", required=True)
    parser.add_argument("--boot-sensors", type=int, default=3)
    parser.add_argument("--fault", default="")
    parser.add_argument("--at", type=int, default=5)
    parser.add_argument("--mute", action="store_true", help="say nothing at all")
    arguments = parser.parse_args()
    port = SerialTransport(arguments.port)
    port.open()
    peer = FakeAutopilot(boot_sensors=arguments.boot_sensors, fault=arguments.fault, at=arguments.at)
    if arguments.mute:
        time.sleep(3600)
    port.write(peer.boot())
    try:
        while True:
            out = peer.feed(port.read(3600.0))
            if out:
                port.write(out)
    except LinkClosed:
        return


if __name__ == "__main__":
    main()
