"""Failsafes of the autopilot: told on the console, and judged by what the section `failsafe` declares.

Without a declaration any failsafe in flight makes the flight a FAIL: the vehicle did not fly what it was asked to, even
where every limit is met.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.ground_station.failsafe_watch import Failsafe, FailsafeWatch
from hil.config import Bench
from hil.config.schema import FailsafeExpected
from hil.run.part import Part, RunContext
from hil.run.recorder.recorder import Event
from hil.run.verdict.verdict import Row, Verdict
from signals.time import NS_PER_S

_AFTER_NS = 10 * NS_PER_S  # a fault that is over may still be the cause of a failsafe this much later
_ENDINGS = (" ended", " is over")


class FailsafePart(Part):
    name = "failsafe"
    _run: RunContext  # from `build` on

    def __init__(self, firmware: Firmware, expected: FailsafeExpected | None, *, judged: bool = True) -> None:
        """`judged`: False for a flight that is to crash, which failsafes precede."""
        self._firmware, self._expected, self._judged = firmware, expected, judged
        self._watch = FailsafeWatch(firmware)
        self._told: list[tuple[Failsafe, str]] = []  # with its line for the user

    def build(self, run: RunContext) -> None:
        self._run = run

    def command_sources(self) -> list[FailsafePart]:
        return [self]

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Look for failsafes in last tick's `frames`. Nothing is sent."""
        if frames and (found := self._watch.step(t_ns, frames)):
            self._tell(found, self._run.say)
        return b""

    def _tell(self, found: Sequence[Failsafe], tell: Callable[[str, str, int], None]) -> None:
        for failsafe in found:
            cause = cause_of(failsafe.t_ns, self._run.recorder.events)
            line = (
                f"{self._firmware.name}: {failsafe.text} at {failsafe.t_ns / NS_PER_S:.1f} s, mode {failsafe.mode}"
                f"{f' ({cause})' if cause else ''}"
            )
            self._told.append((failsafe, line))
            tell("failsafe", line, failsafe.t_ns)

    def finish(self, run: RunContext) -> None:
        self._tell(self._watch.conclude(), run.say)

    def _is_expected(self, failsafe: Failsafe) -> bool:
        return self._expected is not None and self._expected.covers(failsafe.t_ns / NS_PER_S, failsafe.mode)

    def verdict(self) -> Verdict:
        unexpected = [line for failsafe, line in self._told if self._judged and not self._is_expected(failsafe)]
        needed = self._expected is not None and self._expected.required
        missed = needed and not any(self._is_expected(failsafe) for failsafe, _ in self._told)
        if not (self._told or missed):
            return Verdict()
        ok = not (unexpected or missed)
        row = Row("failsafes", float(len(self._told)), 0.0 if self._judged and self._expected is None else None, "", ok)
        why = [f"no failsafe came{self._expected.text}, and the flight needs one"] if missed and self._expected else []
        return Verdict([row], why, causes=unexpected)  # limits that are missed follow from a failsafe

    def told(self) -> Sequence[str]:
        return [failsafe.text for failsafe, _ in self._told]

    def run_keys(self) -> dict[str, Any]:
        return {
            "failsafes": [
                {
                    "t_s": failsafe.t_ns / NS_PER_S,
                    "text": failsafe.text,
                    "mode": failsafe.mode,
                    "expected": self._is_expected(failsafe),
                    "line": line,
                }
                for failsafe, line in self._told
            ]
        }


def cause_of(t_ns: int, events: Sequence[Event]) -> str:
    """Return the last fault that began before `t_ns` and had not long ended, as in "fault: gps dropout at 45 s".

    Empty if there was none.
    """
    ended_ns: dict[str, int] = {}
    for event in sorted(events, key=lambda event: -event.t_ns):
        if event.t_ns > t_ns or event.kind != "fault":
            continue
        ending = next((ending for ending in _ENDINGS if ending in event.text), None)
        what = event.text.partition(ending or " began")[0]
        if ending is not None:
            ended_ns[what] = event.t_ns
        elif t_ns - ended_ns.get(what, t_ns) <= _AFTER_NS:
            return f"fault: {what.replace(': ', ' ', 1)} at {event.t_ns / NS_PER_S:.4g} s"
    return ""


def make(bench: Bench) -> Part:
    config = bench.config
    return FailsafePart(config.autopilot.profile.firmware, config.failsafe, judged=bench.outcome != "crashed")
