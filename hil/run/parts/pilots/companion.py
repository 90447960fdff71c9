"""The section `companion`: clients under test, and the pilot that flies their desired states."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_bridge.faults.companion_fault import CompanionFault
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.config import Bench
from hil.run.companion.files import read_timing
from hil.run.companion.link import CompanionLink
from hil.run.companion.stage import AnswerCallbacks, CompanionStage
from hil.run.loop.scheduler import CommandSource
from hil.run.offboard import PilotedPart, is_out_of_time, offboard_pilot, why_unflown, why_unlanded
from hil.run.part import Part, RunContext
from hil.run.parts.pilots.mission import is_falling
from hil.run.report.page import Report
from hil.run.verdict.verdict import Verdict
from hil.run_files import TIMING_NAME
from signals.desired import DesiredState
from signals.detections import Detections

# Simulated time without a new desired state after which the vehicle holds its position; the longer of the two counts.
_STALE_S, _STALE_FRAMES = 1.0, 2.5
_MAX_PICTURE_BYTES = 8 << 20  # of a picture that a client made for the report


class CompanionPart(PilotedPart):
    name = "companion"
    _run: RunContext  # from `open` on

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._outcomes: dict[str, str] = {}  # by client, as last reported
        self._out_of_time = False
        self.link: CompanionLink | None = None

    def open(self, run: RunContext) -> None:
        self._run = run
        self.link = CompanionLink(
            self._bench.config,
            run.out,
            waypoints_W=[point.p_W for point in run.route],
            on_event=self._event,
            begun_ns=run.tick_began_ns,
            standing_height_m=self._bench.vehicle.standing_height_m,
        )
        self.link.open()

    def ports(self) -> frozenset[str]:
        return frozenset() if self.link is None else self.link.topics

    def build(self, run: RunContext) -> None:
        if self._bench.config.companion.control:
            self._pilot = self._make_pilot(run)

    def _make_pilot(self, run: RunContext) -> OffboardPilot:
        companion = self._bench.config.companion
        stale_s = max(_STALE_S, _STALE_FRAMES / companion.rate_hz)
        return offboard_pilot(self._bench, run, setpoint_hz=companion.setpoint_hz, stale_s=stale_s)

    def command_sources(self) -> list[CommandSource]:
        return [] if self._pilot is None or self.link is None else [self.link.timed(self._pilot)]

    def exchange(self) -> CompanionStage | None:
        if self.link is None:
            return None
        desire = None if self._pilot is None else self._desire
        return self.link.stage(AnswerCallbacks(desire, self._reported, self._detected))

    def ended(self) -> bool:
        return super().ended() and not is_falling(self._run)

    def conclude(self, run: RunContext) -> None:
        self._out_of_time = is_out_of_time(run)
        if self.link is not None:
            self.link.conclude()
        if run.stopped_by_hand:
            for reason in self._why_not_flown():
                run.say("warning", reason)

    def close(self) -> None:
        if self.link is not None:
            self.link.close("ERROR" if sys.exc_info()[0] is not None else "over")

    def verdict(self) -> Verdict:
        """Return FAIL for a flight without its companions: one was lost for good, or the one in control never flew.

        So does one that never landed, where no mission, goal or search says how the flight ends.
        """
        config = self._bench.config
        if self.link is None:
            return Verdict()
        reasons = [*self.link.missing()] if config.companion.on_loss == "error" else []
        if not self._run.stopped_by_hand:
            reasons += self._why_not_flown()
        return Verdict(reasons=reasons)

    def _why_not_flown(self) -> list[str]:
        pilot = self._pilot
        if pilot is None or self.link is None:
            return []
        reasons = [why_unflown(pilot, self._bench, "companion")]
        # Without the lost client that `on_loss: go_on` allows, the vehicle hovers to the end.
        if self._out_of_time and not self.link.missing():
            how = "let it command `land` or say `finished`"
            reasons.append(why_unlanded(pilot, self._bench, "companion", how))
        return [reason for reason in reasons if reason]

    def run_keys(self) -> dict[str, Any]:
        return {} if self.link is None else {"companion": self.link.report()}

    def repeatable(self) -> bool:
        return not self._bench.config.companion.times_count

    def report(self, run: RunContext) -> Report:
        from hil.run.report.companion_section import section
        from hil.run.report.pictures import companion_pictures

        pictures = [
            (f"Picture by {path.parent.name.removeprefix('companion_')}", path) for path in _client_pictures(run.out)
        ]
        pictures += companion_pictures(run.out, read_timing(run.out / TIMING_NAME))
        return Report(pictures, [] if self.link is None else [section(self.link.report())])

    def inject(self, fault: Any, *, declared: bool) -> bool:  # noqa: ARG002 (a client needs no preparation for a fault)
        if not isinstance(fault, CompanionFault) or self.link is None:
            return False
        self.link.inject(fault, self._run.now_ns())
        return True

    # -- callbacks of the link ------------------------------------------------------------------------------------

    def _event(self, t_ns: int, kind: str, text: str) -> None:
        """Record an event of the link; a negative time means now."""
        self._run.recorder.event(self._run.now_ns() if t_ns < 0 else t_ns, kind, text)

    def _desire(self, desired: DesiredState, t_apply_ns: int, t_frame_ns: int) -> None:
        """Fly a desired state from `t_apply_ns` on; the client computed it from the frame of `t_frame_ns`."""
        assert self._pilot is not None
        for part in self._run.parts:
            part.on_desired(desired, t_apply_ns)
        self._pilot.set_desired(desired, t_apply_ns, t_frame_ns)

    def _reported(self, client: str, report: Mapping[str, Any], t_ns: int) -> None:
        for part in self._run.parts:
            part.on_report(client, report, t_ns, control=self._pilot is not None)
        outcome = report.get("outcome")
        if isinstance(outcome, str) and outcome != self._outcomes.get(client, "flying"):
            self._outcomes[client] = outcome
            why = f": {report['why']}" if report.get("why") else ""
            self._event(t_ns, "companion_outcome", f"{client}: {outcome}{why}")

    def _detected(self, client: str, detections: Detections, t_ns: int) -> None:
        self._run.recorder.detected(t_ns, client, detections)
        for part in self._run.parts:
            part.on_detections(client, detections, t_ns)


def _client_pictures(out: Path) -> list[Path]:
    """Return the pictures of started clients for the report: companion_NAME/report*.png, if not too large."""
    pictures = sorted(out.glob("companion_*/report*.png"))
    return [path for path in pictures if path.stat().st_size <= _MAX_PICTURE_BYTES]


def make(bench: Bench) -> Part:
    return CompanionPart(bench)
