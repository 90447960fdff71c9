"""Composition root: config + rig -> stages -> scheduler, and tear-down in reverse order.

The only file that names concrete classes. Whatever a run opens is closed whatever fails, in the reverse order of
opening, and what was recorded up to there is readable.
"""

from __future__ import annotations

import gc
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.signing import SigningKey
from firmware_bridge.ground_station.station import GroundStation, Phase
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.router import Router
from firmware_bridge.router_signing import AutopilotSide, ClientSide, SignedCommands, read_key
from hil.autopilots import make_autopilot
from hil.config import Bench, BenchConfig, SensorConfig, save_bench
from hil.missions.path import Leg, planned_path
from hil.progress import Progress
from hil.recorder.recorder import Recorder
from hil.report.run_json import write_run_json
from hil.scheduler import PHASES, AutopilotPorts, CommandSource, Scheduler, Sensor, SensorSlot
from hil.signals.errors import HilError, RecordingError
from hil.signals.samples import ActuatorFrame, TruthState
from hil.signals.time import NS_PER_S, RateAccumulator
from hil.stages import Port, Skipped, StageSpec, plan_stages
from hil.summary import summarise
from hil.verdict import FlightMeasurement, Verdict, judge
from sim.physics.quadrotor import QuadrotorPhysics
from sim.sensors.catalog import KINDS, make_sensor
from sim.sensors.faults import FaultySensor

RUN_JSON_NAME = "run.json"
# A flight that nobody scripted (no mission) is over this long after the motors stopped [ns of simulated time].
_AFTER_DISARM_NS = 3 * NS_PER_S

_TRUTH = Port("truth", TruthState)
_ACTUATORS = Port("actuators", ActuatorFrame)


@dataclass(frozen=True)
class RunResult:
    """Outcome of one run. `status` is PASS, FAIL or ERROR; `run` is what run.json holds."""

    status: str
    run: dict[str, Any]
    out: Path

    @property
    def exit_status(self) -> int:
        return {"PASS": 0, "FAIL": 1}.get(self.status, 3)


class RouterSource:
    """The router as a source of commands: hands the autopilot's words on, brings the clients' in.

    What is collected goes to the autopilot and is recorded with everything else that does; what clients say only to
    each other is taken by `on_overheard`.
    """

    def __init__(
        self,
        router: Router,
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        on_overheard: Callable[[int, Sequence[Frame]], None] = lambda _t_ns, _frames: None,
    ) -> None:
        self._router = router
        self._on_event, self._on_overheard = on_event, on_overheard

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        router = self._router
        if frames:
            router.forward(frames)
        data = router.collect(t_ns)
        for kind, text in router.take_events():
            self._on_event(t_ns, kind, text)
        overheard = router.take_overheard()
        if overheard:
            self._on_overheard(t_ns, overheard)
        return data


def run_bench(bench: Bench, out: Path, *, quiet: bool = False) -> RunResult:
    """Fly `bench` and leave run.json, the recordings and the report in `out`.

    A failure of the bench is a result (status ERROR), not an exception, so that run.json always tells.
    Raises RecordingError only where `out` itself cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be used as the folder of a run ({error.strerror or error})") from error
    run = _Run(bench, out, quiet=quiet)
    # What an earlier run left here must not pass for this one's result, however this one ends.
    run.write_provisional()
    return run.result()


def stage_specs(config: BenchConfig) -> list[StageSpec]:
    """The wiring of a bench: physics -> sensors -> autopilot -> (one tick later) physics; the recorder reads all."""
    sensor_ports = {name: Port(name, KINDS[s.kind].sample_type) for name, s in config.sensors.items()}
    to_autopilot = tuple(sensor_ports[name] for name in config.autopilot_sensors().values())
    recorded = tuple(sensor_ports.values()) if config.record.mcap else ()
    return [
        StageSpec("physics", delayed_inputs=(_ACTUATORS,), outputs=(_TRUTH,)),
        *(StageSpec(name, inputs=(_TRUTH,), outputs=(port,)) for name, port in sensor_ports.items()),
        StageSpec("autopilot", inputs=to_autopilot, outputs=(_ACTUATORS,), sink=True),
        StageSpec("recorder", inputs=(_TRUTH, *recorded, _ACTUATORS), sink=True),
    ]


class _Run:
    """One run on its way: what was built, and what came of it."""

    def __init__(self, bench: Bench, out: Path, *, quiet: bool) -> None:
        self.bench = bench
        self.config = bench.config
        self.out = out
        self.quiet = quiet
        self.error: tuple[str, str] | None = None
        self.cause = ""  # of the error: one word, where it has one
        self.timing_s: dict[str, float] = {}
        self.skipped: list[Skipped] = []
        self.legs: tuple[Leg, ...] = ()
        self.recorder: Recorder | None = None
        self.scheduler: Scheduler | None = None
        self.link: AutopilotLink | None = None
        self.station: GroundStation | None = None
        self.router: Router | None = None
        self.physics: QuadrotorPhysics | None = None
        self.slots: list[SensorSlot] = []
        self.measurement = FlightMeasurement(())
        self.attachments: dict[str, bytes] = {}

    def result(self) -> RunResult:
        began_s = time.monotonic()
        self._guard(self._prepare_and_fly)
        if self.recorder is not None:
            self._guard(self._finish_recording)
        verdict = judge(self.measurement.result(), self.config.limits)
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
        return RunResult(status, run, self.out)

    def write_provisional(self) -> None:
        """run.json of a run that is killed before it can write its own."""
        self.error = ("Killed", "the run is still going on, or it was killed before it could say how it ended")
        verdict = judge(self.measurement.result(), self.config.limits)
        write_run_json(self.out / RUN_JSON_NAME, self._summary(verdict, "ERROR"))
        self.error = None

    def _summary(self, verdict: Verdict, status: str) -> dict[str, Any]:
        routed = {} if self.router is None else {"router": self.router.report()}
        return routed | summarise(
            self.bench,
            verdict,
            status=status,
            error=self.error,
            cause=self.cause,
            scheduler=self.scheduler,
            link=self.link,
            physics=self.physics,
            slots=self.slots,
            digest=self.recorder.digest if self.recorder else "0" * 32,
            # Signatures carry wall-clock time.
            outside_input=self.config.autopilot.signing_key_file is not None
            or (self.router is not None and self.router.received_any),
            left_out=self.skipped,
            timing_s=self.timing_s,
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
            self._build(stack)
            self.timing_s["setup"] = time.monotonic() - began_s
            self._fly()

    def _build(self, stack: ExitStack) -> None:
        config = self.config
        plan = plan_stages(stage_specs(config))
        self.skipped = list(plan.skipped)
        self.physics = QuadrotorPhysics(
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
        if self.bench.mission is not None:
            x, y, z = self.physics.state[:3].tolist()
            self.legs = planned_path(self.bench.mission, self.bench.scene, home_W=(x, y, z))
        self.measurement = FlightMeasurement(self.legs, config.limits)
        self.recorder = Recorder(
            self.out,
            mcap=config.record.mcap,
            tlog=config.record.tlog,
            tick_ns=config.tick_ns,
            metadata={"rig": config.rig, "scene": self.bench.scene.name, "seed": str(config.seed)},
            attachments=self.attachments,
        )
        self.slots = [self._slot(name, s) for name, s in config.sensors.items() if name in plan.order]
        commands: list[CommandSource] = []
        if self.bench.mission is not None:
            self.station = GroundStation(self.bench.mission.items)
            commands.append(self.station)
        autopilot_signs = None
        if config.autopilot.signing_key_file is not None:
            autopilot_signs = AutopilotSide(self._key(config.autopilot.signing_key_file))
            commands = [SignedCommands(source, autopilot_signs) for source in commands]
        self.router = self._router(autopilot_signs)
        if self.router is not None:
            stack.callback(self.router.close)
            self.router.open()
            commands.append(RouterSource(self.router, self.recorder.event))
        self.link = make_autopilot(self.bench, self.out)
        stack.callback(self.link.close)
        self.link.open()
        chosen = config.autopilot_sensors()
        self.scheduler = Scheduler(
            tick_ns=config.tick_ns,
            physics=self.physics,
            sensors=self.slots,
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
            observers=[self.measurement.add],
            pace=config.pace,
        )

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

    def _slot(self, name: str, sensor: SensorConfig) -> SensorSlot:
        config = self.config
        simulated = make_sensor(
            name,
            kind=sensor.kind,
            rate_hz=sensor.rate_hz,
            seed=config.seed,
            scene=self.bench.scene,
            step_ns=config.tick_ns,
            overrides=sensor.parameters.model_dump(),
        )
        assert self.recorder is not None
        faults = [fault for fault in config.faults.sensors if fault.sensor == name]
        made: Sensor = FaultySensor(simulated, faults, on_event=self.recorder.event) if faults else simulated
        event_mhz = round(sensor.rate_hz * 1000)
        return SensorSlot(made, RateAccumulator(event_mhz=event_mhz, tick_mhz=config.tick_hz * 1000))

    def _fly(self) -> None:
        scheduler, station = self.scheduler, self.station
        assert scheduler is not None
        end_tick = round(self.config.duration_s * self.config.tick_hz)
        flight_over = _FlightOver(self.config.tick_ns)
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
        began_s = time.monotonic()
        try:
            with progress:
                while scheduler.tick < end_tick:
                    scheduler.step()
                    progress.tick(scheduler.tick)
                    if station is not None:
                        if station.phase is Phase.DONE:
                            break
                    elif flight_over.after(scheduler.tick, scheduler.actuators.armed):
                        break
        finally:
            self.timing_s["flight"] = time.monotonic() - began_s
            gc.enable()
            gc.unfreeze()

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
        if self.error is not None and self.scheduler is not None:
            self.recorder.event(self.scheduler.t_ns, "error", f"{self.error[0]}: {self.error[1]}")

    def _write_report(self, run: dict[str, Any]) -> None:
        # Half a second of matplotlib: not before it is needed.
        from hil.report.page import Timing, write_report

        assert self.recorder is not None
        scheduler = self.scheduler
        timing = Timing()
        if scheduler is not None and self.link is not None:
            timing = Timing(
                rtt_bins_ns=self.link.stats.rtt.bins(),
                phase_us={name: scheduler.phase_ns[name].mean_ns / 1000 for name in PHASES},
            )
        points = [leg.end_W for leg in self.legs]
        write_report(self.out, run, self.recorder.track.arrays(), points, events=self.recorder.events, timing=timing)


class _FlightOver:
    """Says when a flight that somebody else commands has ended: armed once, and disarmed for a while."""

    def __init__(self, tick_ns: int) -> None:
        self._after_ticks = _AFTER_DISARM_NS // tick_ns
        self._flown = False
        self._disarmed_tick = 0

    def after(self, tick: int, armed: bool) -> bool:
        if armed:
            self._flown = True
            self._disarmed_tick = tick
            return False
        return self._flown and tick - self._disarmed_tick >= self._after_ticks


def _event_kind(severity: int) -> str:
    """MAV_SEVERITY 0 (emergency) to 7 (debug) as a kind of event."""
    return "error" if severity <= 3 else "warning" if severity == 4 else "status"
