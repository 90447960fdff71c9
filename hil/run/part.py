"""The part: one feature of a run, in one file, with the same life cycle as all others.

A run is a list of parts: the vehicle, the mission, the companions, the link to the autopilot, a dashboard. The
composition root (`hil.run.runs.vehicle_run`) calls them in the order of `hil.run.parts.catalog` and knows none by name:

    check()               raise a named error if the run cannot begin; nothing is opened or recorded yet
    open(run)             the recorder exists. Find out which samples the part needs, such as those its clients request
    ports()               topics that the part consumes; a sensor without a consumer is not computed
    watched_ports()       topics that it only watches: computed, but neither recorded nor in the digest for its sake
                          -> the run plans its stages (`run.plan`)
    build(run)            the sensors exist. Make command sources, open links
    command_sources()     asked at every tick for bytes that go to the autopilot
    observers()           called with the true state of every tick
    exchange()            stepped with every tick's samples while the autopilot computes
                          -> the run makes the scheduler (`run.scheduler`)
    begin(run)            everything is built, tick 0 comes next
      before_tick()         \\
      after_tick(tick)       |  every tick, in the order of the parts; only parts that override them are called, and the
      ended()               /   last two only every `every_ticks` ticks. True of `ended` ends the flight
    conclude(run)         the flight ended without an error, and everything is still open
    close()               always, in the reverse order of the parts; also where `open` or `build` failed
    finish(run)           last events into the recording
    verdict()             the part's own rows and reasons, which the run adds to those of all others
    run_keys()            keys of run.json that neither the run nor another part writes
    skipped(ticks)        rows of run.json's list of what was not computed
    report(run)           pictures and sections of the report page
    after_run(run)        run.json is written
    after_group(run)      in a run of several vehicles: run.json of all together is written

Every method has a default that does nothing, so a part overrides what it needs. An exception of any method up to
`finish` ends the run as ERROR; the methods after it are called all the same, so they must work on a part that was
never opened. What a part imports is loaded only in runs that ask for the part.

How to add one: CONTRIBUTING.md.
"""

# ruff: noqa: ARG002 (the defaults use none of their arguments)

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.config.missions.path import Leg, PlanPoint
from hil.run.loop.by_hand import HandControl
from hil.run.loop.scheduler import PHASES, CommandSource, Exchange, Scheduler
from hil.run.loop.stages import StagePlan
from hil.run.recorder.recorder import Recorder, Tap
from hil.run.report.page import Report
from hil.run.report.quantiles import quantiles_us
from hil.run.sensors.frame_stages import make_frames
from hil.run.sensors.sensor_slots import SensorSlots
from hil.run.verdict.verdict import Verdict
from signals.desired import DesiredState
from signals.detections import Detections
from signals.samples import TruthState
from sim.frame.source import SharedFrames
from sim.physics.vehicle_physics import VehiclePhysics


class FlightEnded(Exception):
    """Raised by a part to end the flight where `ended` is not asked: while the link waits for the autopilot."""


class FlightStatus(NamedTuple):
    """Progress of the flight, as shown to people."""

    phase: str
    reached: int  # waypoints
    waypoints: int


class RunContext:
    """The run that a part belongs to. Each field exists from the step named beside it on."""

    recorder: Recorder  # open
    physics: VehiclePhysics  # open, once the vehicle has been opened
    plan: StagePlan  # build
    sensors: SensorSlots  # build, once the sensors have been built
    link: AutopilotLink  # begin

    def __init__(
        self,
        bench: Bench,
        out: Path,
        parts: Sequence[Part],
        *,
        quiet: bool = True,
        frames: Callable[[], SharedFrames] | None = None,
    ) -> None:
        """`frames` makes the geometry for cameras, LiDARs and radars; None: that of the scene alone."""
        self.bench = bench
        self.make_frames = frames or partial(make_frames, bench)
        self._quiet = quiet
        self.out = out  # folder of the run
        self.parts = tuple(parts)
        self.fleet: tuple[RunContext, ...] = (self,)  # of all vehicles of the run; begin
        self.legs: tuple[Leg, ...] = ()  # planned path; open, once the mission's path is known
        self.route: list[PlanPoint] = []  # labelled points of the path, or the goal; likewise
        self.stopped_by_hand = False  # where a run without a mission may end at any tick
        self._scheduler: Scheduler | None = None

    def part(self, name: str) -> Any:
        """Return the part of that name, None where this run has none."""
        return next((part for part in self.parts if part.name == name), None)

    @property
    def scheduler(self) -> Scheduler:
        """The tick loop's scheduler; from `begin` on."""
        assert self._scheduler is not None
        return self._scheduler

    @scheduler.setter
    def scheduler(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler

    @property
    def ticks(self) -> int:
        """Ticks so far; 0 before the scheduler is made."""
        return 0 if self._scheduler is None else self._scheduler.tick

    def now_ns(self) -> int:
        """Return the simulated time of the next tick."""
        return self.ticks * self.bench.config.tick_ns

    def tick_began_ns(self) -> int:
        """Return the wall-clock time at which the present tick began, by `time.perf_counter_ns`; 0 before the first."""
        return 0 if self._scheduler is None else self._scheduler.begun_ns

    def timing_keys(self) -> dict[str, Any]:
        """Return wall-clock times of the ticks for run.json: late ticks, and quantiles by phase [us]."""
        scheduler = self._scheduler
        if scheduler is None:
            return {"paced_ticks_late": 0, "own_us": None, "step_us": None, "turnaround_us": None, "phase_us": None}
        scheduler.count_durations()
        return {
            "paced_ticks_late": scheduler.late,
            "own_us": quantiles_us(scheduler.own_ns),
            "step_us": quantiles_us(scheduler.step_ns),
            "turnaround_us": quantiles_us(scheduler.turnaround_ns) if scheduler.turnaround_ns.count else None,
            "phase_us": {name: quantiles_us(scheduler.phase_ns[name]) for name in PHASES},
        }

    def mean_phase_us(self) -> dict[str, float]:
        """Return the mean wall-clock time of each phase of a tick [us]; empty before the scheduler is made."""
        scheduler = self._scheduler
        if scheduler is None:
            return {}
        scheduler.count_durations()
        return {name: scheduler.phase_ns[name].mean_ns / 1000 for name in PHASES}

    def record_last_tick(self) -> None:
        """Record what the last tick received."""
        if self._scheduler is not None:
            self._scheduler.flush()

    def event(self, kind: str, text: str, t_ns: int | None = None) -> None:
        """Record an event of the simulated time `t_ns`; None: now."""
        self.recorder.event(self.now_ns() if t_ns is None else t_ns, kind, text)

    def say(self, kind: str, text: str, t_ns: int | None = None) -> None:
        """Record an event, and print it on the console: the user should know it before the run has ended."""
        self.event(kind, text, t_ns)
        if not self._quiet:
            with suppress(OSError, ValueError):  # the terminal or pipe was closed; the flight goes on
                print(f"{kind}: {text}", flush=True)  # noqa: T201

    def inject(self, fault: Any, *, declared: bool = True) -> None:
        """Begin a fault or gust now, in the first part that takes it.

        `declared`: the bench or its script contains the fault, so its sensor or link is prepared for faults.
        Raises ValueError where no part takes it, or it does not fit this run.
        """
        if not any(part.inject(fault, declared=declared) for part in self.parts):
            raise ValueError(f"nothing in this run can have a {type(fault).__name__}")

    def status(self) -> FlightStatus:
        """Return the phase of the part that flies the mission ("serving": none does), and waypoints as judged."""
        phase = next((phase for part in self.parts if (phase := part.phase())), "serving")
        counts = next((counts for part in self.parts if (counts := part.waypoints())), (0, 0))
        return FlightStatus(phase, *counts)

    def may_arm(self) -> bool:
        """Return True once every part agrees that the vehicle may be armed."""
        return all(part.may_arm() for part in self.parts)

    def texts(self) -> list[tuple[int, int, str]]:
        """Return the autopilot's status texts so far: time [ns], MAV_SEVERITY, text."""
        return [text for part in self.parts for text in part.texts()]


class Part:
    """A part that does nothing. See the header of this file for the order of the calls."""

    name = ""
    injects = False  # True: may inject faults that the bench does not declare
    every_ticks = 1  # `after_tick` and `ended` are called at multiples of this; fixed from `begin` on
    paused_s = 0.0  # wall-clock time for which this part has paused the run
    hand_control: HandControl | None = None  # of a part that takes commands by hand

    def check(self) -> None:
        """Raise a HilError if the run cannot begin, such as a port that does not exist. Takes next to no time."""

    def open(self, run: RunContext) -> None: ...

    def ports(self) -> frozenset[str]:
        return frozenset()

    def watched_ports(self) -> frozenset[str]:
        return frozenset()

    def build(self, run: RunContext) -> None: ...

    def tap(self) -> Tap | None:
        """Return a receiver of everything that is recorded; asked before `open`."""
        return None

    def wrap_link(self, transport: Transport) -> Transport:
        """Wrap the transport to the autopilot, to alter or watch its bytes."""
        return transport

    def wrap_commands(self, sources: list[CommandSource]) -> list[CommandSource]:
        """Wrap the command sources of all parts before this one."""
        return sources

    def command_sources(self) -> Sequence[CommandSource]:
        return ()

    def observers(self) -> Sequence[Callable[[TruthState], None]]:
        return ()

    def exchange(self) -> Exchange | None:
        return None

    def begin(self, run: RunContext) -> None: ...

    def around_flight(self) -> AbstractContextManager[Any]:
        """Return a context manager that is entered for the ticks of the flight."""
        return nullcontext()

    def before_tick(self) -> None: ...

    def after_tick(self, tick: int) -> None: ...

    def ended(self) -> bool:
        return False

    def conclude(self, run: RunContext) -> None: ...

    def close(self) -> None: ...

    def finish(self, run: RunContext) -> None: ...

    def verdict(self) -> Verdict:
        return Verdict()

    def run_keys(self) -> Mapping[str, Any]:
        return {}

    def skipped(self, ticks: int) -> Sequence[dict[str, Any]]:
        return ()

    def repeatable(self) -> bool:
        """Return False if the part gave the run an input that a second run would not get."""
        return True

    def report(self, run: RunContext) -> Report:
        return Report()

    def after_run(self, run: Mapping[str, Any]) -> None: ...

    def after_group(self, run: Mapping[str, Any]) -> None: ...

    # -- calls between parts --------------------------------------------------------------------------------------

    def inject(self, fault: Any, *, declared: bool) -> bool:
        """Begin a fault and return True, or return False if it concerns another part. See `RunContext.inject`."""
        return False

    def phase(self) -> str:
        """Return the phase of the flight if this part flies the mission, else an empty text."""
        return ""

    def waypoints(self) -> tuple[int, int] | None:
        """Return waypoints reached so far and waypoints of the plan; None: this part does not measure them."""
        return None

    def texts(self) -> Sequence[tuple[int, int, str]]:
        """Return status texts of the autopilot: time [ns], MAV_SEVERITY, text."""
        return ()

    def told(self) -> Sequence[str]:
        """Return texts of the autopilot that this part tells in its own words, so that no warning repeats them."""
        return ()

    def may_arm(self) -> bool:
        """Return False while the vehicle must not be armed yet, because what this part checks is not known."""
        return True

    def link_waits(self) -> None:
        """Called about four times a second while the link waits long for its autopilot; may raise, to end the run."""

    def on_desired(self, desired: DesiredState, t_apply_ns: int) -> None:
        """Receive the desired state of a companion in control, which applies from `t_apply_ns` on."""

    def on_report(self, client: str, report: Mapping[str, Any], t_ns: int, *, control: bool) -> None:
        """Receive the status report of a companion. `control`: companions fly the vehicle in this run."""

    def on_detections(self, client: str, detections: Detections, t_ns: int) -> None:
        """Receive the objects that a companion has detected in a picture."""
