"""Composition root: the bench of one vehicle and a list of parts become one run. Order and life cycle: `hil.run.part`.

No part is known by name here. Whatever a run opens is closed whatever fails, in the reverse order of opening, and
what was recorded up to there is readable.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from hil.config import Bench, save_bench
from hil.run.loop.scheduler import CommandSource, Scheduler, Wiring
from hil.run.loop.stages import plan_stages
from hil.run.part import Part, RunContext
from hil.run.recorder.mcap.mcap_file import VehicleTopics
from hil.run.recorder.recorder import Event, Recorder
from hil.run.report.page import Report
from hil.run.runs.failure import Failure
from hil.run.runs.run_file import RunFile
from hil.run.sensors.frame_stages import stage_specs
from hil.run.verdict.verdict import Verdict
from signals.errors import ConfigError, HilError, file_errors
from signals.time import NS_PER_S
from sim.frame.source import SharedFrames

_NO_DIGEST = "0" * 32


class Shared(NamedTuple):
    """Files and geometry that the vehicles of a run with several share."""

    mcap: VehicleTopics | bool  # this vehicle's part of the recording; False: there is none
    frames: Callable[[], SharedFrames]  # makes the geometry for this vehicle's cameras, LiDARs and radars
    scene: str | None  # path of the copied scene from the vehicle's folder; None: the bench has no scene file


@dataclass(frozen=True)
class RunResult:
    """Outcome of one run. `status` is PASS, FAIL or ERROR; `run` is the content of run.json."""

    status: str
    run: dict[str, Any]
    out: Path
    config_error: ConfigError | None = None  # of a run that did not begin: found only when its parts were opened

    @property
    def exit_status(self) -> int:
        if self.run["error"] is not None and self.run["error"]["type"] == ConfigError.__name__:
            return 2  # a setting that only the autopilot could tell to be wrong
        return {"PASS": 0, "FAIL": 1}.get(self.status, 3)

    def flown(self) -> dict[str, Any]:
        """Return the content of run.json of a run that flew to its end. Raises HilError if it ended as ERROR."""
        if self.run["error"] is not None:
            raise HilError(f"the flight ended as ERROR: {self.run['error']['message']}")
        return self.run


class VehicleRun:
    """The run of one vehicle, from its parts to run.json; `hil.run.runs.fleet` flies it, alone or with others."""

    def __init__(
        self, bench: Bench, out: Path, parts: Sequence[Part], *, quiet: bool, shared: Shared | None = None
    ) -> None:
        """`shared`: files and geometry that the vehicles of a run with several share; None: the run has one vehicle."""
        self.context = RunContext(bench, out, parts, quiet=quiet, frames=None if shared is None else shared.frames)
        self._parts = self.context.parts
        self._config = bench.config
        self._out = out
        self._quiet = quiet
        self._shared = shared
        self._file = RunFile(out)
        self.failure = Failure(out)
        self._timing_s: dict[str, float] = {}
        self._began_s = time.monotonic()
        self._recorder: Recorder | None = None

    def mark_unfinished(self) -> RunResult:
        """Write a run.json so that an earlier one here does not pass for this run's result, however this one ends."""
        return RunResult("ERROR", self._file.begin(self._summary(self._verdict())), self._out)

    def finish(self) -> RunResult:
        """Judge, and write run.json and the report. Everything that the run opened is closed."""
        recorder = self._recorder
        if recorder is not None:
            self.failure.guard(partial(self._finish_recording, recorder))
        verdict = self._verdict()
        if recorder is not None:
            status = verdict.status if self.failure.error is None else "ERROR"
            self.failure.guard(partial(recorder.close, status))
        self._timing_s["total"] = time.monotonic() - self._began_s
        run = self._summary(verdict)
        if self._config.record.report and recorder is not None and self.context.ticks:
            self.failure.guard(partial(self._write_report, run, recorder.events))
            run = self._summary(verdict)
        run = self._file.end(run)
        for part in self._parts:
            part.after_run(run)
        return RunResult(run["status"], run, self._out, None if run["sim_s"] > 0.0 else self.failure.config_error)

    def build(self, stack: ExitStack, recorder: Recorder) -> None:
        """Open and build all parts; `stack` closes them."""
        context, parts, config = self.context, self._parts, self._config
        context.recorder = recorder
        for part in parts:
            stack.callback(part.close)
            part.open(context)
        topics = frozenset[str]().union(*(part.ports() for part in parts))
        context.plan = plan_stages(stage_specs(config, topics))
        watched = frozenset[str]().union(*(part.watched_ports() for part in parts))
        if watched:
            unwatched = context.plan
            context.plan = plan_stages(stage_specs(config, topics | watched))
            recorder.leave_out(set(context.plan.order) - set(unwatched.order))
        commands: list[CommandSource] = []
        for part in parts:
            part.build(context)
            commands = [*part.wrap_commands(commands), *part.command_sources()]
        physics = context.physics
        wiring = Wiring(
            physics,
            context.sensors.slots,
            context.link,
            config.autopilot_sensors(),
            recorder,
            commands,
            [observe for part in parts for observe in part.observers()],
            [exchange for part in parts if (exchange := part.exchange()) is not None],
        )
        context.scheduler = Scheduler(
            wiring, tick_ns=config.tick_ns, pace=config.pace, wind_at=lambda: physics.wind_W_mps
        )
        for part in parts:
            part.begin(context)

    def causes(self) -> Sequence[str]:
        """Return what makes the flight a FAIL whatever else is judged, such as a crash, so far."""
        return self._verdict().causes

    def raise_causes(self) -> None:
        """Raise HilError for a crash or a failsafe in a flight without a result."""
        for cause in self.causes():
            raise HilError(f"{cause} (`crash: null` and `failsafe: {{required: false}}` record it all the same)")

    @property
    def paused_s(self) -> float:
        """Wall-clock time for which parts of this vehicle have paused the run."""
        return sum(part.paused_s for part in self._parts)

    def flown(self, wall_s: float) -> None:
        """Note the wall-clock time of the flight without pauses."""
        self._timing_s["flight"] = wall_s

    def conclude(self) -> None:
        """Conclude a flight that ended without an error, while everything is still open."""
        for part in self._parts:
            part.conclude(self.context)

    def prepare(self, stack: ExitStack) -> None:
        """Check, save the bench, open the recording and build all parts; `stack` closes them."""
        began_s = time.monotonic()
        context, config = self.context, self._config
        self._file.reserve()
        for part in self._parts:
            part.check()
        with file_errors(self._out, "the bench cannot be saved here"):
            saved = save_bench(context.bench, self._out, scene=None if self._shared is None else self._shared.scene)
            attachments = {saved.name: saved.read_bytes()}
        recorder = Recorder(
            self._out,
            mcap=config.record.mcap if self._shared is None else self._shared.mcap,
            tlog=config.record.tlog,
            tick_ns=config.tick_ns,
            metadata={"rig": config.rig, "scene": context.bench.scene.name, "seed": str(config.seed)},
            attachments=attachments,
            taps=[tap for part in self._parts if (tap := part.tap()) is not None],
        )
        self._recorder = recorder
        self.build(stack, recorder)
        self._timing_s["setup"] = time.monotonic() - began_s

    def _finish_recording(self, recorder: Recorder) -> None:
        self.context.record_last_tick()
        for part in self._parts:
            part.finish(self.context)
        if self.failure.error is not None:
            recorder.event(self.context.now_ns(), "error", self.failure.text)

    def _verdict(self) -> Verdict:
        """Return the verdicts of all parts together. One that a part fails to give makes the run an ERROR."""
        verdict = Verdict()

        def add(part: Part) -> None:
            nonlocal verdict
            verdict = Verdict.together([verdict, part.verdict()])

        for part in self._parts:
            self.failure.guard(partial(add, part))
        return verdict

    def _summary(self, verdict: Verdict) -> dict[str, Any]:
        """Return the content of run.json: the keys of every run first, then those of the parts."""
        context, config = self.context, self._config
        ticks, wall_s = context.ticks, self._timing_s.get("flight", 0.0)
        sim_s = ticks * config.tick_ns / NS_PER_S
        summary: dict[str, Any] = {
            "schema": 1,
            "status": "",
            "error": None,
            "digest": _NO_DIGEST if self._recorder is None else self._recorder.digest,
            "deterministic": not context.stopped_by_hand and all(part.repeatable() for part in self._parts),
            "seed": config.seed,
            "rig": config.rig,
            "scene": context.bench.scene.name,
            "randomize": context.bench.random_choices(),
            "sim_s": sim_s,
            "wall_s": wall_s,
            "realtime_factor": sim_s / wall_s if wall_s > 0 else 0.0,
            "skipped": [row for part in self._parts for row in part.skipped(ticks)],
            "warnings": self._warnings([*verdict.reasons, self.failure.text]),
            "verdict": {"reasons": list(verdict.reasons), "rows": [row.as_map() for row in verdict.rows]},
            "timing": {
                "setup_s": self._timing_s.get("setup", 0.0),
                "total_s": self._timing_s.get("total", 0.0),
                **context.timing_keys(),
            },
        }
        for part in self._parts:
            self.failure.guard(partial(_add_keys, summary, part))
        error = self.failure.error
        summary |= {"status": verdict.status if error is None else "ERROR", "error": error}
        summary.setdefault("actions", [])
        return summary

    def _warnings(self, said: Sequence[str]) -> list[dict[str, Any]]:
        """Return the warnings of bench and autopilot by time, without those that are among `said` or told by a part."""
        events = [] if self._recorder is None else self._recorder.warnings
        told = {*said, *(text for part in self._parts for text in part.told())}
        return [
            {"t_s": event.t_ns / NS_PER_S, "level": event.kind, "text": event.text.strip()}
            for event in sorted(events, key=lambda event: event.t_ns)
            if event.text.strip() not in told
        ]

    def _write_report(self, run: Mapping[str, Any], events: Sequence[Event]) -> None:
        from hil.run.report import figures, page  # loads matplotlib, which takes half a second

        with file_errors(self._out, "the report cannot be written"):
            with figures.style():
                reports = [part.report(self.context) for part in self._parts]
            pictures = [picture for report in reports for picture in report.pictures]
            sections = [section for report in reports for section in report.sections]
            page.write_page(self._out, run, events, Report(pictures, sections))


def _add_keys(summary: dict[str, Any], part: Part) -> None:
    """Add a part's keys to run.json. Raises HilError for a key that the run or another part has written."""
    keys = part.run_keys()
    for key in keys:
        if key in summary:
            raise HilError(f"the part {part.name!r} returns the key {key!r}, which run.json already has: rename it")
    summary |= keys
