"""Helpers for tests of links: a vehicle at rest, tick by tick; its truth; a stand-in for the firmware's process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.links.autopilot_link import AutopilotLink, TickSamples
from signals.samples import BaroSample, GpsSample, ImuSample, MagSample, TruthState

IMU = ImuSample(0, 0, 0, (0.5, 0.25, 9.75), (0.125, 0.25, 0.5), 25.0)
MAG = MagSample(0, 0, 0, (2e-5, 0.0, -4e-5))
BARO = BaroSample(0, 0, 0, 95_600.0, 488.0, 15.0)
GPS = GpsSample(0, 0, 0, 47.4, 8.5, 488.0, (0.0, 0.0, 0.0), 0.5, 0.75, 3, 14)
ZERO = (0.0, 0.0, 0.0)


def truth_at(t_ns: int, tick: int, **changes: Any) -> TruthState:
    """Return the truth of a level vehicle at rest, with `changes`."""
    state = TruthState(tick, t_ns, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return state._replace(**changes)


class Process:
    """Stand-in for the firmware's process."""

    def __init__(self, on_start: Callable[[], object] = lambda: None, *, alive: bool = True) -> None:
        self.pid = None
        self.start = on_start
        self.alive = alive
        self.closed = False

    def running(self) -> bool:
        return self.alive

    def stderr_tail(self, lines: int = 5) -> str:
        return ""

    def describe_end(self) -> str:
        return "its process ended with exit status 7; it last said:\nPanic"

    def close(self) -> None:
        self.closed = True


class Drive:
    """Runs `link` for a vehicle at rest: `seen` holds the commands received, `frames` all frames received."""

    def __init__(self, link: AutopilotLink, tick_ns: int) -> None:
        self.link: Any = link
        self.tick_ns = tick_ns
        self.tick = 0
        self.seen: list[Any] = []
        self.frames: list[Any] = []
        self.encoder = FrameEncoder(255, 190)

    def now_ns(self) -> int:
        return self.tick * self.tick_ns

    def words(self, name: str, *values: object) -> bytes:
        message = message_class(name)(*values)
        return self.encoder.frame(message.MSGID, pack(message))

    def command(self, number: int, *params: float) -> bytes:
        return self.words("COMMAND_LONG", 1, 1, number, 0, *params, *(0.0,) * (7 - len(params)))

    def step(self, extra: bytes = b"") -> bytes:
        tick, t_ns, link = self.tick, self.now_ns(), self.link
        command = None if link.caps.lockstep else link.begin(tick)
        wobble = 1e-3 * (tick % 7)
        imu = ImuSample(tick, t_ns, t_ns, (wobble, 0.0, 9.80665), (0.0, wobble * 0.1, 0.0), 20.0)
        mag = MagSample(tick, t_ns, t_ns, (2.1e-5, 1e-6, -4.2e-5))
        baro = BaroSample(tick, t_ns, t_ns, 95600.0 + wobble, 488.0, 15.0)
        gps = GPS._replace(t_capture_ns=t_ns, t_available_ns=t_ns) if tick % 25 == 0 else None
        sent: bytes = link.send(tick, t_ns, TickSamples(imu, mag, baro, gps), extra)
        try:
            answer = link.wait(tick, t_ns)
        finally:
            self.frames += link.take_frames()
        self.seen += [found for found in (command, answer) if found is not None]
        self.tick += 1
        return sent

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.step()

    def run_until(self, done: Callable[[], bool], limit: int = 7500) -> None:
        for _ in range(limit):
            if done():
                return
            self.step()
        raise AssertionError("it did not happen")
