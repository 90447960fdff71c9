"""Faults that the mock injects at a simulated time, to test how the bench handles them.

`KIND@SECONDS`: die (the process ends, exit status 70), stall (no output any more), wrong_time (replies answer another
step), garbage (random bytes in place of each reply), noise (random bytes between the frames; the frames survive).
The random bytes are the same in every run.
"""

from __future__ import annotations

import random
from typing import NamedTuple

from signals.errors import ConfigError

KINDS = ("die", "stall", "wrong_time", "garbage", "noise")
EXIT_STATUS_DIED = 70

_FRAME_STARTS = bytes((0xFD, 0xFE))
_LENGTH = 40


class Died(Exception):
    """The `die` fault: the process that runs the mock ends with `EXIT_STATUS_DIED`."""


class Fault(NamedTuple):
    """A kind of fault and the time from which on it acts."""

    kind: str
    t_us: int


def parse_fault(text: str) -> Fault:
    """Parse `KIND@SECONDS`. Raises ConfigError."""
    kind, at, when = text.partition("@")
    try:
        t_us = round(float(when) * 1e6) if at else -1
    except (ValueError, OverflowError):
        t_us = -1
    if kind not in KINDS or t_us < 0:
        raise ConfigError.at(f"--fault {text}", "not a fault", f"write KIND@SECONDS, KIND in {', '.join(KINDS)}")
    return Fault(kind, t_us)


def random_bytes(counter: int) -> bytes:
    """Return random bytes, a function of `counter`, without MAVLink start bytes, which would make a receiver wait."""
    return random.Random(counter).randbytes(_LENGTH).translate(None, _FRAME_STARTS)


class FaultInjector:
    """Injected faults of the replies. `earliest_us` lets the hot path skip them with one comparison."""

    def __init__(self, faults: tuple[Fault, ...]) -> None:
        self._faults = faults
        self.earliest_us = min((fault.t_us for fault in faults), default=1 << 62)

    def reply_time_us(self, now_us: int) -> int:
        """Return the time stamp of the reply."""
        wrong = any(f.kind == "wrong_time" and now_us >= f.t_us for f in self._faults)
        return now_us - 4000 if wrong and now_us >= 4000 else now_us

    def stalled(self, now_us: int) -> bool:
        """Return True if nothing is sent any more."""
        return any(f.kind == "stall" and now_us >= f.t_us for f in self._faults)

    def output(self, now_us: int, telemetry: bytes, reply: bytes) -> bytes:
        """Return the bytes to write instead of `telemetry + reply`. Raises `Died`."""
        for fault in self._faults:
            if now_us < fault.t_us:
                continue
            if fault.kind == "die":
                raise Died(f"died of an injected fault at {now_us / 1e6:g} s")
            if fault.kind == "stall":
                return b""
            if fault.kind == "garbage":
                reply = random_bytes(now_us)
            elif fault.kind == "noise":
                telemetry = random_bytes(now_us) + telemetry
        return telemetry + reply
