"""Composition root: config + rig -> stages -> scheduler, and tear-down in reverse order.

The only file that names concrete classes. Whatever a run opens is closed whatever fails, in the reverse order of
opening, and what was recorded up to there is readable.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.links.autopilot_link import AutopilotLink
from hil.autopilots import Surroundings, home_of, make_autopilot, unknown_parameters
from hil.commanders import Commanders
from hil.companion.answer_sinks import AnswerSinks
from hil.config import Bench, save_bench
from hil.frame_stages import draws_elsewhere, is_wanted, make_frames, needs_frames, stage_specs
from hil.judging import Judging
from hil.missions.path import Leg, planned_path
from hil.recorder.recorder import Recorder
from hil.report.run_json import write_run_json
from hil.restartable_physics import make_physics
from hil.scheduler import Scheduler
from hil.sensor_slots import Injector, SensorSlots
from hil.signals.classes import Classes
from hil.signals.errors import HilError, RecordingError
from hil.signals.samples import Vec3
from hil.stages import Skipped, StagePlan, plan_stages
from hil.summary import FREE_RUNNING, summarise, timing_of
from hil.tick_loop import fly_ticks
from sim.frame.source import FrameSource
from sim.physics.quadrotor import QuadrotorPhysics

if TYPE_CHECKING:
    from hil.companion.link import CompanionLink
    from hil.companion.stage import CompanionStage
    from hil.dashboard.live_run import LiveRun

RUN_JSON_NAME = "run.json"
_TRACEBACK_NAME = "traceback.txt"


@dataclass(frozen=True)
class RunResult:
    """Outcome of one run. `status` is PASS, FAIL or ERROR; `run` is what run.json holds."""

    status: str
    run: dict[str, Any]
    out: Path

    @property
    def exit_status(self) -> int:
        return {"PASS": 0, "FAIL": 1}.get(self.status, 3)


def run_bench(bench: Bench, out: Path, *, quiet: bool = False, live: LiveRun | None = None) -> RunResult:
    """Fly `bench` and leave run.json, the recordings and the report in `out`. `live`: the dashboard follows it.

    A failure of the bench is a result (status ERROR), not an exception, so that run.json always tells.
    Raises RecordingError only where `out` itself cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be used as the folder of a run ({error.strerror or error})") from error
    run = BenchRun(bench, out, quiet=quiet, live=live)
    # What an earlier run left here must not pass for this one's result, however this one ends.
    run.write_provisional()
    return run.result()


Reached = Callable[[], int]


def fly(
    bench: Bench,
    out: Path,
    recorder: Recorder,
    over: Callable[[Reached, bool], bool],
) -> None:
    """Fly `bench` with everything it tells going to `recorder`, without run.json, report and saved bench.

    After every tick `over` says whether that was enough; it gets who tells the waypoints reached, and whether the
    mission has ended. Raises HilError, whatever `recorder` and `over` raise, and KeyboardInterrupt.
    """
    run = BenchRun(bench, out, quiet=True, recorder=recorder, over=over)
    with ExitStack() as stack:
        run.build(stack)
        run.fly()


class FirstError:
    """What went wrong with the bench: the first error counts, whatever fails after it.

    `error` is (type, message) for run.json, None while all is well; `cause` one word, where the error has one.
    """

    def __init__(self, out: Path) -> None:
        self._traceback = out / _TRACEBACK_NAME
        self.error: tuple[str, str] | None = None
        self.cause = ""

    def forget_traceback(self) -> None:
        """Remove that of an earlier run."""
        with suppress(OSError):
            self._traceback.unlink(missing_ok=True)

    def guard(self, step: Callable[[], object]) -> None:
        """Run one step of the run; an error of it becomes the run's, if it is the first."""
        error: tuple[str, str] | None = None
        try:
            step()
        except HilError as problem:
            error = (type(problem).__name__, str(problem))
            self.cause = self.cause or getattr(problem, "cause", "")
        except KeyboardInterrupt as stop:
            error = ("Interrupted", str(stop) or "stopped from the keyboard")
        except Exception as problem:  # noqa: BLE001 (the one boundary: a defect of the bench must still leave run.json)
            with suppress(OSError):
                self._traceback.write_text(traceback.format_exc())
            text = f"{type(problem).__name__}: {problem} (a defect of the bench; details in {_TRACEBACK_NAME})"
            error = ("InternalError", text)
        self.error = self.error or error


class BenchRun:
    """One run on its way: what was built, and what came of it."""

    def __init__(
        self,
        bench: Bench,
        out: Path,
        *,
        quiet: bool,
        recorder: Recorder | None = None,
        over: Callable[[Reached, bool], bool] | None = None,
        live: LiveRun | None = None,
    ) -> None:
        """`recorder`: instead of one of its own; `over`: see `fly`."""
        self.bench = bench
        self.live = live
        self.config = bench.config
        self.over = over
        self.out = out
        self.quiet = quiet
        self.failure = FirstError(out)
        self.timing_s: dict[str, float] = {}
        self.skipped: list[Skipped] = []
        self.legs: tuple[Leg, ...] = ()
        self.recorder = recorder
        self.scheduler: Scheduler | None = None
        self.link: AutopilotLink | None = None
        self.commanders = Commanders(bench)
        self.judging = Judging(bench)
        self.companion: CompanionLink | None = None
        self.injector: Injector | None = None
        self.physics: QuadrotorPhysics | None = None  # or one that can be put back: the same to all who use it
        self.sensors: SensorSlots | None = None
        self.drawn_elsewhere = False  # pictures by a driver that draws other ones on another machine
        self.frames: FrameSource | None = None  # what cameras, LiDARs and radars look at; None: the bench has none
        self.attachments: dict[str, bytes] = {}

    def result(self) -> RunResult:
        began_s = time.monotonic()
        self.failure.guard(self._prepare_and_fly)
        if self.recorder is not None:
            self.failure.guard(self._finish_recording)
        verdict = self.judging.verdict(self.commanders.records)
        status = "ERROR" if self.failure.error else verdict.status
        if self.recorder is not None:
            recorder = self.recorder
            self.failure.guard(lambda: recorder.close(status))
            status = "ERROR" if self.failure.error else status
        self.timing_s["total"] = time.monotonic() - began_s
        run = summarise(self, verdict, status)
        if self.config.record.report and self.recorder is not None:
            self.failure.guard(lambda: self._write_report(run))
            if self.failure.error is not None and status != "ERROR":
                status = "ERROR"
                run = summarise(self, verdict, status)
        write_run_json(self.out / RUN_JSON_NAME, run)
        if self.live is not None:
            self.live.finish(run)
        return RunResult(status, run, self.out)

    def write_provisional(self) -> None:
        """run.json of a run that is killed before it can write its own."""
        self.failure.forget_traceback()
        self.failure.error = ("Killed", "the run is still going on, or it was killed before it could say how it ended")
        verdict = self.judging.verdict(self.commanders.records)
        write_run_json(self.out / RUN_JSON_NAME, summarise(self, verdict, "ERROR"))
        self.failure.error = None

    def _prepare_and_fly(self) -> None:
        began_s = time.monotonic()
        try:
            saved = save_bench(self.bench, self.out)
            self.attachments = {saved.name: saved.read_bytes()}
        except OSError as problem:
            raise RecordingError(f"{self.out}: the bench cannot be saved here ({problem})") from problem
        with ExitStack() as stack:
            self.build(stack)
            self.timing_s["setup"] = time.monotonic() - began_s
            self.fly()
            self.judging.conclude(lambda: self._geometry(stack), self.out)

    def _geometry(self, stack: ExitStack) -> FrameSource:
        """What cameras look at, made now where the bench has none."""
        if self.frames is not None:
            return self.frames
        frames = make_frames(self.bench)
        stack.callback(frames.close)
        return frames

    def build(self, stack: ExitStack) -> None:
        config = self.config
        physics = self.physics = make_physics(self.bench)
        if self.bench.mission is not None and self.over is None:
            x, y, z = self.physics.state[:3].tolist()
            self.legs = planned_path(self.bench.mission, self.bench.scene, home_W=(x, y, z))
        self.judging.begin(self.legs)
        self.recorder = self.recorder or Recorder(
            self.out,
            mcap=config.record.mcap,
            tlog=config.record.tlog,
            tick_ns=config.tick_ns,
            metadata={"rig": config.rig, "scene": self.bench.scene.name, "seed": str(config.seed)},
            attachments=self.attachments,
            watch=self.live,
        )
        if config.companion.on:
            # Before it is known what is to be drawn: that is what they want.
            self.companion = self._companion()
            stack.callback(self._close_companion)
            self.companion.open()
        plan = plan_stages(stage_specs(config, () if self.companion is None else self.companion.topics))
        self.skipped = list(plan.skipped)
        self.drawn_elsewhere = draws_elsewhere(config, plan)
        if needs_frames(config, plan):
            self.frames = self._geometry(stack)
        wanted = {name: sensor for name, sensor in config.sensors.items() if is_wanted(name, sensor, plan)}
        self.sensors = SensorSlots(self.bench, wanted, plan, self.frames, self.recorder, self.out)
        injector = self.injector = Injector(
            config,
            physics,
            self.sensors,
            self.companion,
            self.recorder,
            now_ns=self._now_ns,
            by_hand=self.live is not None,
        )
        self.commanders.open(
            stack,
            self.recorder,
            state=self.physics.state,
            companion=self.companion,
            live=self.live,
            inject=injector.inject,
        )
        home = home_of(self.bench.scene.site, self.physics.state)
        self.link = make_autopilot(self.bench, Surroundings(self.out, injector.wrap, self.event, home))
        stack.callback(self.link.close)
        self.link.open()
        # Who flies for samples alone has nothing judged.
        observers = self.judging.observers(of_flight=self.over is None) + self.commanders.observers(self.recorder)
        self.scheduler = Scheduler(
            tick_ns=config.tick_ns,
            physics=self.physics,
            sensors=self.sensors.slots,
            link=self.link,
            ports=config.autopilot_sensors(),
            commands=self.commanders.sources,
            recorder=self.recorder,
            observers=observers,
            companion=self._companion_stage(),
            pace=config.pace,
            wind_at=lambda: physics.wind_W_mps,
        )
        if self.live is not None:
            self._show(self.live, plan, injector)

    def _show(self, live: LiveRun, plan: StagePlan, injector: Injector) -> None:
        """The dashboard is told what there is, and given what it may touch."""
        from hil.dashboard.live_run import Flown
        from hil.dashboard.watched import about, slow_facts

        scheduler, link, physics, recorder = self.scheduler, self.link, self.physics, self.recorder
        assert scheduler is not None
        assert link is not None
        assert physics is not None
        assert recorder is not None
        told = about(self, plan, link, physics.state[:3].tolist())
        live.attach(
            Flown(
                about=told | {"wire": injector.wire is not None},
                scheduler=scheduler,
                status=self.commanders.status,
                texts=self.commanders.texts,
                wind_W_mps=lambda: physics.wind_W_mps,
                slow=lambda: slow_facts(self),
                inject=injector.inject_by_hand,
                event=recorder.event,
                can_wait=link.caps.lockstep,
                views=lambda: {} if self.companion is None else self.companion.views.newest,
            )
        )

    def _companion(self) -> CompanionLink:
        from hil.companion.link import CompanionLink  # most runs have none: ZeroMQ is not loaded for them

        return CompanionLink(
            self.config,
            self.out,
            waypoints_W=self._points_W(),
            on_event=self._companion_event,
            begun_ns=lambda: 0 if self.scheduler is None else self.scheduler.begun_ns,
        )

    def _points_W(self) -> list[Vec3]:
        """Where the flight is to lead."""
        goal = self.config.goal
        return [goal.p_W] if goal is not None else [leg.end_W for leg in self.legs]

    def _companion_event(self, t_ns: int, kind: str, text: str) -> None:
        assert self.recorder is not None
        self.recorder.event(self._now_ns() if t_ns < 0 else t_ns, kind, text)

    def _companion_stage(self) -> CompanionStage | None:
        if self.companion is None:
            return None
        assert self.recorder is not None
        station = self.commanders.station
        sinks = AnswerSinks(
            self.recorder,
            event=self._companion_event,
            pilot=station if isinstance(station, OffboardPilot) else None,
            goal=self.judging.goal,
            search=self.judging.search,
        )
        return self.companion.stage(sinks.desire if sinks.flies else None, sinks.report, sinks.detections)

    def _close_companion(self) -> None:
        assert self.companion is not None
        self.companion.close("ERROR" if sys.exc_info()[0] is not None else "over")

    def start_again(self) -> None:
        """The autopilot has rebooted: the vehicle goes back to where it began, and the bench's time goes on."""
        assert self.scheduler is not None
        physics: Any = self.physics
        physics.restart()
        self.scheduler.skip_tick()

    def _now_ns(self) -> int:
        return self.scheduler.t_ns if self.scheduler is not None else 0

    def event(self, kind: str, text: str) -> None:
        """Something that a link has to say about this run."""
        if self.recorder is not None:
            self.recorder.event(self._now_ns(), kind, text)

    def fly(self) -> None:
        assert self.scheduler is not None
        began_s = time.monotonic()
        try:
            fly_ticks(self)
        finally:
            held_s = 0.0 if self.live is None else self.live.held_s
            self.timing_s["flight"] = time.monotonic() - began_s - held_s

    def enough(self) -> bool:
        """Whether the flight is over."""
        commanders = self.commanders
        if self.over is not None and self.over(lambda: commanders.reached, commanders.done):
            return True
        return commanders.done

    def _finish_recording(self) -> None:
        assert self.recorder is not None
        if self.scheduler is not None:
            self.scheduler.flush()
        self.commanders.record_texts(self.recorder)
        for name in unknown_parameters(self.bench, self.out):
            self.event("warning", f"the firmware has no parameter {name}: autopilot.params has set nothing")
        if isinstance(self.link, FREE_RUNNING) and self.scheduler is not None:
            for finding in self.link.findings():
                self.recorder.event(self.scheduler.t_ns, finding.level, finding.text)
        if self.failure.error is not None and self.scheduler is not None:
            self.recorder.event(self.scheduler.t_ns, "error", f"{self.failure.error[0]}: {self.failure.error[1]}")

    def _write_report(self, run: dict[str, Any]) -> None:
        # Half a second of matplotlib: not before it is needed.
        from hil.companion.timing_file import TIMING_NAME, read_timing
        from hil.report.page import write_report

        assert self.recorder is not None
        write_report(
            self.out,
            run,
            self.recorder.track.arrays(),
            self._points_W(),
            events=self.recorder.events,
            timing=timing_of(self.scheduler, self.link),
            frames=self.recorder.album.shown(),
            classes=self.frames.classes if self.frames is not None else Classes(),
            chirps={name: radar.chirp for name, radar in (self.sensors.radars if self.sensors else {}).items()},
            companion_timing=read_timing(self.out / TIMING_NAME) if self.companion is not None else None,
        )
