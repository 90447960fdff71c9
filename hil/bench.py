"""Composition root: config + rig -> stages -> scheduler, and tear-down in reverse order.

The only file that names concrete classes. Whatever a run opens is closed whatever fails, in the reverse order of
opening, and what was recorded up to there is readable.
"""

from __future__ import annotations

import gc
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_bridge.codecs.signing import SigningKey
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.ground_station.actions import ActionSource
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.links.ardupilot_json import ArduPilotJsonLink, RestartRequested
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.lockstep import LockstepLink
from firmware_bridge.links.realtime_producer import RealtimeProducer
from firmware_bridge.links.shared_processor import SharedProcessor
from firmware_bridge.manual.manual_control import ManualControlSource
from firmware_bridge.router import Router, RouterSource
from firmware_bridge.router_signing import AutopilotSide, ClientSide, SignedCommands, read_key
from firmware_bridge.transports.transport import Transport
from hil.autopilots import Surroundings, make_autopilot, unknown_parameters
from hil.companion.answer_sinks import AnswerSinks
from hil.companion.link_faults import CompanionFault
from hil.config import Bench, BenchConfig, save_bench
from hil.flight_over import FlightOver
from hil.frame_stages import draws_elsewhere, is_wanted, needs_frames
from hil.home import home_of
from hil.manual_flight import make_manual, make_page_manual
from hil.measurements import DeclaredMeasurements, judge_scripted
from hil.missions.path import Leg, planned_path
from hil.missions.script import Injected, flight_actions
from hil.offboard_flight import make_pilot
from hil.progress import Progress
from hil.recorder.recorder import Recorder
from hil.report.run_json import write_run_json
from hil.restartable_physics import RestartablePhysics
from hil.scheduler import PHASES, AutopilotPorts, CommandSource, Scheduler
from hil.sensor_slots import SensorSlots
from hil.signals.classes import Classes
from hil.signals.errors import HilError, RecordingError
from hil.signals.samples import TruthState, Vec3
from hil.signals.time import NS_PER_S
from hil.stages import Skipped, StagePlan, plan_stages
from hil.summary import FREE_RUNNING, summarise
from hil.verdict import FlightMeasurement, Verdict, judge
from hil.wiring import stage_specs
from sim.frame.source import FrameSource, SharedFrames
from sim.physics.faults import RotorFault
from sim.physics.quadrotor import QuadrotorPhysics
from sim.scene.wind import GustEvent

if TYPE_CHECKING:
    from hil.companion.link import CompanionLink
    from hil.companion.stage import CompanionStage
    from hil.dashboard.live_run import LiveRun
    from hil.goal.judgement import GoalMeasurement
    from hil.search.judgement import SearchMeasurement

RUN_JSON_NAME = "run.json"
# Simulated autopilots whose telemetry is sent by threads that run on wall-clock time: what the ground station asks of
# them, it asks on whole seconds of simulated time, so that a few milliseconds more or less make no other flight.
_ON_A_GRID = frozenset({"px4_sitl", "ardupilot_sitl"})
_GRID_NS = NS_PER_S


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
    run = _Run(bench, out, quiet=quiet, live=live)
    # What an earlier run left here must not pass for this one's result, however this one ends.
    run.write_provisional()
    return run.result()


Reached = Callable[[], int]


def fly(
    bench: Bench,
    out: Path,
    recorder: Recorder,
    over: Callable[[Reached, bool], bool],
    live: LiveRun | None = None,
) -> None:
    """Fly `bench` with everything it tells going to `recorder`, without run.json, report and saved bench.

    After every tick `over` says whether that was enough; it gets who tells the waypoints reached, and whether the
    mission has ended. `live`: the dashboard follows it. Raises HilError, whatever `recorder` and `over` raise, and
    KeyboardInterrupt.
    """
    run = _Run(bench, out, quiet=True, recorder=recorder, over=over, live=live)
    with ExitStack() as stack:
        run.build(stack)
        run.fly()


def make_frames(bench: Bench) -> FrameSource:
    """The geometry that cameras and LiDARs look at. Raises ConfigError where the scene's map is wrong."""
    from sim.scene.world import load_world  # benches without such sensors need no map

    return SharedFrames(load_world(bench.scene))


class _Run:
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
        self.error: tuple[str, str] | None = None
        self.cause = ""  # of the error: one word, where it has one
        self.timing_s: dict[str, float] = {}
        self.skipped: list[Skipped] = []
        self.legs: tuple[Leg, ...] = ()
        self.recorder = recorder
        self.scheduler: Scheduler | None = None
        self.link: AutopilotLink | None = None
        self.station: GroundStation | OffboardPilot | None = None
        self.companion: CompanionLink | None = None
        self.router: Router | None = None
        self.faulty_wire: FaultyTransport | None = None
        self.manual: ManualControlSource | None = None
        self.page_manual: ManualControlSource | None = None  # sticks of the dashboard
        self.physics: QuadrotorPhysics | None = None  # or one that can be put back: the same to all who use it
        self.sensors: SensorSlots | None = None
        self.drawn_elsewhere = False  # pictures by a driver that draws other ones on another machine
        self.frames: FrameSource | None = None  # what cameras, LiDARs and radars look at; None: the bench has none
        self.measurement = FlightMeasurement(())
        self.declared = DeclaredMeasurements(())
        self.goal: GoalMeasurement | None = None
        self.search: SearchMeasurement | None = None
        self.actions: ActionSource | None = None
        self.attachments: dict[str, bytes] = {}

    def result(self) -> RunResult:
        began_s = time.monotonic()
        self._guard(self._prepare_and_fly)
        if self.recorder is not None:
            self._guard(self._finish_recording)
        verdict = self._verdict()
        status = "ERROR" if self.error else verdict.status
        if self.recorder is not None:
            recorder = self.recorder
            self._guard(lambda: recorder.close(status))
            status = "ERROR" if self.error else status
        self.timing_s["total"] = time.monotonic() - began_s
        run = self._summary(verdict, status)
        if self.config.record.report and self.recorder is not None:
            self._guard(lambda: self._write_report(run))
            if self.error is not None and status != "ERROR":
                status = "ERROR"
                run = self._summary(verdict, status)
        write_run_json(self.out / RUN_JSON_NAME, run)
        if self.live is not None:
            self.live.finish(run)
        return RunResult(status, run, self.out)

    def write_provisional(self) -> None:
        """run.json of a run that is killed before it can write its own."""
        with suppress(OSError):
            (self.out / "traceback.txt").unlink(missing_ok=True)
        self.error = ("Killed", "the run is still going on, or it was killed before it could say how it ended")
        verdict = self._verdict()
        write_run_json(self.out / RUN_JSON_NAME, self._summary(verdict, "ERROR"))
        self.error = None

    def _verdict(self) -> Verdict:
        script = self.bench.script
        if script is None:
            verdict = judge(self.measurement.result(), self.config.limits)
        else:
            records = self.actions.records if self.actions is not None else ()
            declared = self.declared.results()
            verdict = judge_scripted(self.measurement.result(), self.config.limits, script.script, declared, records)
        for further in (self.goal, self.search):
            if further is not None:
                verdict = verdict.with_rows(*further.judged())
        return verdict

    def _summary(self, verdict: Verdict, status: str) -> dict[str, Any]:
        routed: dict[str, Any] = {} if self.router is None else {"router": self.router.report()}
        if self.companion is not None:
            routed["companion"] = self.companion.report()
        if self.goal is not None:
            routed["goal"] = self.goal.result.as_map()
        if self.search is not None:
            routed["search"] = self.search.result.as_map()
        if self.live is not None and self.live.commands:
            routed["by_hand"] = self.live.commands
        return routed | summarise(
            self.bench,
            verdict,
            status=status,
            error=self.error,
            cause=self.cause,
            scheduler=self.scheduler,
            link=self.link,
            physics=self.physics,
            slots=self.sensors.slots if self.sensors is not None else [],
            digest=self.recorder.digest if self.recorder else "0" * 32,
            # Signatures carry wall-clock time.
            outside_input=self.config.autopilot.signing_key_file is not None
            or (self.router is not None and self.router.received_any)
            or (self.manual is not None and self.manual.sent > 0)
            or (self.page_manual is not None and self.page_manual.sent > 0)
            or (self.live is not None and self.live.altered)
            or self.drawn_elsewhere
            or self._times_of_companions(),
            left_out=self.skipped,
            posings=(self.frames.posed, self.frames.unposed) if self.frames is not None else (0, 0),
            radars=self.sensors.radars if self.sensors is not None else {},
            timing_s=self.timing_s,
            link_faults=self.faulty_wire.faults if self.faulty_wire is not None else self.config.faults.links,
            fault_hits=self.faulty_wire.hits() if self.faulty_wire is not None else {},
            actions=self.actions.records if self.actions is not None else (),
        )

    def _guard(self, step: Any) -> None:
        """Run one step; an error of it becomes the run's (the first one counts)."""
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
                (self.out / "traceback.txt").write_text(traceback.format_exc())
            text = f"{type(problem).__name__}: {problem} (a defect of the bench; details in traceback.txt)"
            error = ("InternalError", text)
        self.error = self.error or error

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
            if self.goal is not None or self.search is not None:
                self._conclude(stack)

    def _conclude(self, stack: ExitStack) -> None:
        """What is judged from the scene itself, after the flight."""
        frames = self.frames
        if frames is None:
            frames = make_frames(self.bench)
            stack.callback(frames.close)
        if self.goal is not None:
            self.goal.conclude(frames.geometry)
        if self.search is not None:
            self.search.conclude(frames, frames.geometry.world)
            self.search.write(self.out)

    def build(self, stack: ExitStack) -> None:
        config = self.config

        def vehicle() -> QuadrotorPhysics:
            return QuadrotorPhysics(
                self.bench.vehicle,
                self.bench.scene,
                config.tick_ns,
                contact_skipping=config.physics.contact_skipping,
                effects=config.physics.effects,
                faults=config.faults.rotors,
                wind=config.wind,
                seed=config.seed,
                step_ns=None if config.physics.step_us is None else config.physics.step_us * 1000,
            )

        physics: Any = vehicle()
        if config.autopilot.on_restart == "reset":
            physics = RestartablePhysics(vehicle, tick_ns=config.tick_ns)
        self.physics = physics
        if self.bench.mission is not None and self.over is None:
            x, y, z = self.physics.state[:3].tolist()
            self.legs = planned_path(self.bench.mission, self.bench.scene, home_W=(x, y, z))
        self.measurement = FlightMeasurement(self.legs, config.limits)
        if config.goal is not None:
            from hil.goal.judgement import GoalMeasurement  # OpenCV, which most runs do without

            self.goal = GoalMeasurement(config.goal, self.bench.vehicle)
        if config.search is not None:
            from hil.search.judgement import SearchMeasurement

            self.search = SearchMeasurement(config.search, config.sensors[config.search.camera])
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
            self.frames = make_frames(self.bench)
            stack.callback(self.frames.close)
        wanted = {name: sensor for name, sensor in config.sensors.items() if is_wanted(name, sensor, plan)}
        self.sensors = SensorSlots(self.bench, wanted, plan, self.frames, self.recorder, self.out)
        commands: list[CommandSource] = []
        if config.companion.on and config.companion.control:
            pilot = self.station = make_pilot(
                self.bench, self.physics.state, self.recorder.event, grid_ns=_grid_ns(config)
            )
            commands.append(pilot if self.companion is None else self.companion.timed(pilot))
        elif self.bench.mission is not None:
            self.station = GroundStation(
                self.bench.mission.items,
                target_sysid=None,
                grid_ns=_grid_ns(config),
            )
            commands.append(self.station)
        elif self.bench.script is not None:
            # Nothing to upload and nobody to arm it but the script; the station sees it fly, land and disarm.
            self.station = GroundStation((), target_sysid=None, fly=False)
            commands.append(self.station)
        elif (
            config.autopilot.kind != "mock"
            and config.autopilot.on_restart == "error"
            and config.autopilot.mavlink_port != "none"
        ):
            # Real firmware wants to hear a ground station once a second.
            commands.append(GroundStation((), target_sysid=None, fly=False))
        if self.bench.script is not None:
            script = self.bench.script
            self.declared = DeclaredMeasurements(script.script.expect)
            self.actions = ActionSource(
                flight_actions(script, self.bench.mission, self._inject, tick_ns=config.tick_ns),
                target_sysid=None,
                first_item=1 if config.autopilot.kind.startswith("ardupilot") else 0,
                on_event=self.recorder.event,
            )
            commands.append(self.actions)
        if config.manual.device is not None:
            self.manual = make_manual(config)
            stack.callback(self.manual.close)
            commands.append(self.manual)
        if self.live is not None:
            self.page_manual = make_page_manual(config, self.live.sticks)
            commands.append(self.page_manual)
        autopilot_signs = None
        if config.autopilot.signing_key_file is not None:
            autopilot_signs = AutopilotSide(self._key(config.autopilot.signing_key_file))
            commands = [SignedCommands(source, autopilot_signs) for source in commands]
        self.router = self._router(autopilot_signs)
        if self.router is not None:
            stack.callback(self.router.close)
            self.router.open()
            commands.append(RouterSource(self.router, self.recorder.event, self.recorder.overheard))
        self.link = make_autopilot(
            self.bench,
            Surroundings(self.out, self._wrap, self._event, home_of(self.bench.scene.site, self.physics.state)),
        )
        stack.callback(self.link.close)
        self.link.open()
        chosen = config.autopilot_sensors()
        # Who flies for samples alone has nothing judged.
        observers: list[Callable[[TruthState], None]] = [] if self.over is not None else [self.measurement.add]
        if self.bench.script is not None:
            observers.append(self.declared.add)
        if self.goal is not None:
            observers.append(self.goal.add)
        if self.search is not None:
            observers.append(self.search.add)
        for source in (self.manual, self.page_manual):
            if source is not None:
                observers.append(partial(self._record_events, source))
        self.scheduler = Scheduler(
            tick_ns=config.tick_ns,
            physics=self.physics,
            sensors=self.sensors.slots,
            link=self.link,
            ports=AutopilotPorts(
                imu=chosen["imu"],
                gps=chosen.get("gps"),
                baro=chosen.get("barometer"),
                mag=chosen.get("magnetometer"),
                ranging=[chosen[kind] for kind in ("range_finder", "optical_flow") if kind in chosen],
            ),
            commands=commands,
            recorder=self.recorder,
            observers=observers,
            companion=self._companion_stage(),
            pace=config.pace,
            wind_at=lambda: physics.wind_W_mps,
        )
        if self.live is not None:
            self._show(self.live, plan)

    def _show(self, live: LiveRun, plan: StagePlan) -> None:
        """The dashboard is told what there is, and given what it may touch."""
        from hil.dashboard.live_run import Flown
        from hil.dashboard.watched import about, slow_facts

        scheduler, link, physics, recorder = self.scheduler, self.link, self.physics, self.recorder
        assert scheduler is not None
        assert link is not None
        assert physics is not None
        assert recorder is not None
        home_W = physics.state[:3].tolist()

        def slow() -> dict[str, Any]:
            return slow_facts(
                scheduler=scheduler,
                link=link,
                physics=physics,
                skipped=self.skipped,
                posings=(self.frames.posed, self.frames.unposed) if self.frames is not None else (0, 0),
                companion=self.companion,
                router=self.router,
                manual=(self.manual, self.page_manual),
            )

        live.attach(
            Flown(
                about=about(self.bench, self.out, self.legs, plan, link, home_W)
                | {"wire": self.faulty_wire is not None},
                scheduler=scheduler,
                status=self._status,
                texts=lambda: [] if self.station is None else self.station.statustexts,
                wind_W_mps=lambda: physics.wind_W_mps,
                slow=slow,
                inject=self._inject_by_hand,
                event=recorder.event,
                can_wait=link.caps.lockstep,
                views=lambda: {} if self.companion is None else self.companion.views.newest,
            )
        )

    def _inject_by_hand(self, what: Injected | LinkFault | CompanionFault) -> None:
        """As `_inject`, of a sensor or a link that nobody expected to fail. ValueError where it does not fit."""
        if isinstance(what, LinkFault):
            if self.faulty_wire is None:
                raise ValueError("the wire to this autopilot is not MAVLink: it has no faults")
            self.faulty_wire.inject(what)
            return
        if isinstance(what, CompanionFault):
            if self.companion is None:
                raise ValueError("this run has no companion")
            self.companion.inject(what, self._now_ns())
            return
        if not isinstance(what, GustEvent | RotorFault):
            assert self.sensors is not None
            self.sensors.put_at_risk(what.sensor)
        self._inject(what)

    def _companion(self) -> CompanionLink:
        from hil.companion.link import CompanionLink  # most runs have none: ZeroMQ is not loaded for them

        points = self._points_W()
        return CompanionLink(
            self.config,
            self.out,
            waypoints_W=points,
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
        sinks = AnswerSinks(
            self.recorder,
            event=self._companion_event,
            pilot=self.station if isinstance(self.station, OffboardPilot) else None,
            goal=self.goal,
            search=self.search,
        )
        return self.companion.stage(sinks.desire if sinks.flies else None, sinks.report, sinks.detections)

    def _times_of_companions(self) -> bool:
        """Whether how long clients took has a say in the flight. A trace of it repeats the run all the same."""
        companion = self.config.companion
        return companion.on and companion.control and companion.time != "lockstep" and companion.trace is None

    def _close_companion(self) -> None:
        assert self.companion is not None
        self.companion.close("ERROR" if sys.exc_info()[0] is not None else "over")

    def _router(self, autopilot_signs: AutopilotSide | None) -> Router | None:
        config = self.config
        endpoints = config.router.endpoints()
        if not endpoints:
            return None
        key = config.router.signing_key_file
        faster = config.autopilot.lockstep and (config.pace is None or config.pace > 1.0)
        return Router(
            endpoints,
            hold=config.router.hold_heartbeats and faster,
            clients_sign=None if key is None else ClientSide(self._key(key)),
            autopilot_signs=autopilot_signs,
        )

    def _key(self, path: str) -> SigningKey:
        key, warning = read_key(Path(path))
        if warning and self.recorder is not None:
            self.recorder.event(0, "warning", warning)
        return key

    def _record_events(self, source: ManualControlSource, truth: TruthState) -> None:  # noqa: ARG002
        """What a source of events has had to say since the tick before."""
        assert self.recorder is not None
        for event in source.take_events():
            self.recorder.event(*event)

    def _start_again(self) -> None:
        """The autopilot has rebooted: the vehicle goes back to where it began, and the bench's time goes on."""
        assert self.scheduler is not None
        physics: Any = self.physics
        physics.restart()
        self.scheduler.skip_tick()

    def _wrap(self, wire: Transport) -> Transport:
        """The wire to the autopilot with the faults declared for it."""
        faults = self.config.faults.links
        if not faults and self.live is None:  # from the page some may come later
            return wire  # any fault costs a look at every frame
        assert self.recorder is not None
        self.faulty_wire = FaultyTransport(wire, faults, self.config.seed, self._now_ns, self.recorder.event)
        return self.faulty_wire

    def _now_ns(self) -> int:
        return self.scheduler.t_ns if self.scheduler is not None else 0

    def _event(self, kind: str, text: str) -> None:
        """Something that a link has to say about this run."""
        if self.recorder is not None:
            self.recorder.event(self._now_ns(), kind, text)

    def _inject(self, what: Injected) -> None:
        """A gust or fault that a script lets begin now."""
        assert self.physics is not None
        assert self.sensors is not None
        if isinstance(what, GustEvent | RotorFault):
            self.physics.inject(what)
        else:
            self.sensors.inject(what)

    def fly(self) -> None:
        scheduler, station = self.scheduler, self.station
        assert scheduler is not None
        end_tick = round(self.config.duration_s * self.config.tick_hz)
        flight_over = FlightOver(self.config.tick_ns)
        serving = self.config.autopilot.on_restart == "reset"  # whoever reboots it decides when it is over
        progress = Progress(
            tick_ns=self.config.tick_ns,
            sim_limit_ns=end_tick * self.config.tick_ns,
            status=self._status,
            title=f"{self.config.rig}: {self.config.mission or 'no mission'}",
            quiet=self.quiet,
        )
        # Garbage is collected before and after, not during: a pause of the collector is jitter on the link, and
        # a tick makes no reference cycles.
        gc.collect()
        gc.freeze()
        gc.disable()
        before_tick = None if self.live is None else self.live.before_tick
        began_s = time.monotonic()
        try:
            with progress, self._processor() as processor:
                shared_ticks = self.config.tick_hz if isinstance(processor, SharedProcessor) else 0
                while scheduler.tick < end_tick:
                    if before_tick is not None:
                        before_tick()
                    try:
                        scheduler.step()
                    except RestartRequested:
                        self._start_again()
                        continue
                    progress.tick(scheduler.tick)
                    if shared_ticks and scheduler.tick % shared_ticks == 0:
                        given_up = processor.watch(shared_ticks * scheduler.tick_ns)
                        if given_up is not None:
                            shared_ticks = 0
                            self._event("warning", given_up)
                    if self.over is not None and self.over(
                        self._reached, station is not None and station.phase.value == "done"
                    ):
                        break
                    if station is not None:
                        if station.phase.value == "done":
                            break
                    elif not serving and flight_over.after(scheduler.tick, scheduler.actuators.armed):
                        break
        finally:
            held_s = 0.0 if self.live is None else self.live.held_s
            self.timing_s["flight"] = time.monotonic() - began_s - held_s
            gc.enable()
            gc.unfreeze()

    def _processor(self) -> AbstractContextManager[Any]:
        """What the tick loop asks of the system's scheduler."""
        link = self.link
        if isinstance(link, FREE_RUNNING):
            # Whoever prepares the samples of an autopilot that waits for nobody must not wait for a processor either.
            return RealtimeProducer()
        config = self.config
        if isinstance(link, LockstepLink | ArduPilotJsonLink) and link.caps.busy_processors > 1 and config.pace is None:
            return SharedProcessor(link.pid if config.autopilot.share_processor else None)
        return nullcontext()

    def _reached(self) -> int:
        return 0 if self.station is None else self.station.reached

    def _status(self) -> tuple[str, int, int]:
        if self.station is None:
            return ("serving", 0, 0)
        return (self.station.phase.value, self.station.reached, self.station.waypoints)

    def _finish_recording(self) -> None:
        assert self.recorder is not None
        if self.scheduler is not None:
            self.scheduler.flush()
        if self.station is not None:
            for t_ns, severity, text in self.station.statustexts:
                self.recorder.event(t_ns, _event_kind(severity), text)
        for name in unknown_parameters(self.bench, self.out):
            self._event("warning", f"the firmware has no parameter {name}: autopilot.params has set nothing")
        if isinstance(self.link, FREE_RUNNING) and self.scheduler is not None:
            for finding in self.link.findings():
                self.recorder.event(self.scheduler.t_ns, finding.level, finding.text)
        if self.error is not None and self.scheduler is not None:
            self.recorder.event(self.scheduler.t_ns, "error", f"{self.error[0]}: {self.error[1]}")

    def _write_report(self, run: dict[str, Any]) -> None:
        # Half a second of matplotlib: not before it is needed.
        from hil.companion.timing_file import TIMING_NAME, read_timing
        from hil.report.page import Timing, write_report

        assert self.recorder is not None
        scheduler = self.scheduler
        timing = Timing()
        if scheduler is not None and self.link is not None:
            timing = Timing(
                rtt_bins_ns=self.link.stats.rtt.bins(),
                phase_us={name: scheduler.phase_ns[name].mean_ns / 1000 for name in PHASES},
            )
            sent = self.link.send_stats() if isinstance(self.link, FREE_RUNNING) else None
            if isinstance(self.link, FREE_RUNNING) and sent is not None:
                ages = self.link.age.age.bins()
                timing = replace(timing, lateness_bins_ns=sent.lateness.bins(), age_bins_ns=ages)
        points = self._points_W()
        write_report(
            self.out,
            run,
            self.recorder.track.arrays(),
            points,
            events=self.recorder.events,
            timing=timing,
            frames=self.recorder.album.shown(),
            classes=self.frames.classes if self.frames is not None else Classes(),
            chirps={name: radar.chirp for name, radar in (self.sensors.radars if self.sensors else {}).items()},
            companion_timing=read_timing(self.out / TIMING_NAME) if self.companion is not None else None,
        )


def _grid_ns(config: BenchConfig) -> int:
    return _GRID_NS if config.autopilot.kind in _ON_A_GRID else 0


def _event_kind(severity: int) -> str:
    """MAV_SEVERITY 0 (emergency) to 7 (debug) as a kind of event."""
    return "error" if severity <= 3 else "warning" if severity == 4 else "status"
