"""The run's side of the dashboard: a look at the newest values, and a few commands, both between two ticks.

The scheduler's tick is not touched. Before each tick the bench calls `before_tick`; nearly always that is one
comparison of the clock. Every few milliseconds of wall clock the wire is looked at, and where the page has asked for
an update, one is made of what is true then. Nothing waits for the page, and nothing that only looks changes the run:
the digest is the same with and without it.

Commands act before the tick that is then recorded with them. `pause`, `step`, `resume` and `pace` only hold the run
up; they leave the digest as it is. `inject` and `wind` change what is simulated, sticks change what is flown: the run
then says that it was altered by hand, and is not deterministic.
"""

from __future__ import annotations

import math
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pydantic

from firmware_bridge.codecs.companion_view import View
from hil.dashboard.client_views import boxes_of, view_streams
from hil.dashboard.faults_by_hand import fault_of
from hil.dashboard.page_sticks import PageSticks
from hil.dashboard.snapshot import frame_streams, scalar_samples
from hil.dashboard.wire import RunEnd, is_number
from hil.scheduler import Scheduler
from hil.signals.detections import Detections
from hil.signals.samples import Sample, Vec3
from sim.scene.wind import GustEvent

_LOOK_NS = 12_000_000  # wall clock between two looks at the wire
_BUSY_NS = 4_000_000  # the same while an update is still to be written
_UPDATE_NS = 46_000_000  # between two updates, on average: a little over twenty a second
_SLOW_NS = 500_000_000  # between two looks at what changes slowly
_TRAIL_NS = 200_000_000  # simulated time between two points of the trail
_TRAIL_POINTS = 1500  # beyond that every second one goes, and half as many are added
_EVENTS = 100  # in one update
_COMMANDS = 500  # recorded of one run; each is kept
_WIND_RISE_S = 1.0
_WINDS = 100  # changes of the wind in one run: each is a gust that stays, and every tick adds them all up
_LAST_S = 2.0  # the page's server has so long to take the last message
_WIND_LIMIT_MPS = 30.0
_HELD_S = 0.02  # one wait while held up


class StoppedByPage(KeyboardInterrupt):
    """Somebody pressed Stop. Ends the run as Ctrl-C does: everything up to here is recorded."""


@dataclass(frozen=True)
class Flown:
    """What the dashboard may see and touch of a run that is built."""

    about: Mapping[str, Any]  # told once
    scheduler: Scheduler
    status: Callable[[], tuple[str, int, int]]  # phase, waypoints reached, waypoints
    wind_W_mps: Callable[[], Vec3]
    texts: Callable[[], Sequence[tuple[int, int, str]]]  # what the vehicle has said so far: t_ns, severity, text
    slow: Callable[[], dict[str, Any]]  # links, battery, what is skipped: asked twice a second
    inject: Callable[[Any], None]  # a fault of a rotor, a sensor, a link, or a gust. ValueError where it does not fit
    event: Callable[[int, str, str], None]
    can_wait: bool  # whether the autopilot waits for the bench
    views: Callable[[], Mapping[str, View]]  # what companions show of themselves, by client


class LiveRun:
    """One run, watched. The bench attaches what it built, then calls `before_tick` before every tick."""

    def __init__(
        self,
        wire: socket.socket,
        *,
        paused: bool = False,
        pace: float | None = None,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """`paused`: tick 0 waits for the page. `pace`: times real time; None: as fast as it goes."""
        self.sticks = PageSticks()
        self.commands: list[dict[str, Any]] = []  # every one that was carried out
        self.altered = False  # one of them changed what is simulated
        self.held_s = 0.0  # wall clock spent held up
        self.looks_ns = 0  # of this thread's processor time, spent on looks and updates
        self._end = RunEnd(wire)
        self._fd = wire
        self._clock_ns = clock_ns
        self._flown: Flown | None = None
        self._latest: dict[str, Sample] = {}
        self._detected: dict[str, Detections] = {}  # by topic, the newest
        self._events: deque[tuple[int, str, str]] = deque(maxlen=_EVENTS)
        self._trail: list[tuple[float, ...]] = []  # t [s], x, y, z [m, W]
        self._trail_step_ns = _TRAIL_NS
        self._trail_ns = 0
        self._paused = paused
        self._steps = 0
        self._pace = pace
        self._pace_from: tuple[int, int] | None = None  # tick, wall clock
        self._due_ns = 0
        self._update_ns = 0  # when the next one may be made
        self._slow_ns = 0
        self._asked: tuple[str, ...] | None = None  # streams of the update that is wanted; None: none is
        self._streams_sent: dict[str, int] = {}
        self._winds = 0
        self._wind_W_mps: Vec3 = (0.0, 0.0, 0.0)  # by hand, on top of the bench's own
        self._texts = 0  # of the vehicle's that were told
        self._told: set[tuple[int, str]] = set()
        self._stage = ("", 0)  # phase and waypoints that were told
        self._speed_from = (0, 0)
        self._speed = 0.0

    # -- taps: called by the recorder and the bench ---------------------------------------------------------------

    def sample(self, port: str, sample: Sample) -> None:
        """A sample was released: kept until the next of its port."""
        self._latest[port] = sample

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """A line for the page's log."""
        # What the vehicle says is recorded when the run is over, but told at once.
        if (t_ns, text) not in self._told:
            self._events.append((t_ns, kind, text))

    def detected(self, client: str, detections: Detections) -> None:  # noqa: ARG002
        """What a companion made out in a picture: kept until the next of its topic."""
        self._detected[detections.topic] = detections

    def attach(self, flown: Flown) -> None:
        """The run is built. Tells the page what it is."""
        self._flown = flown
        if not flown.can_wait:
            self._paused, self._pace = False, None
        self._end.write({"kind": "begin", **flown.about})
        self._speed_from = (flown.scheduler.tick, self._clock_ns())

    def finish(self, run: Mapping[str, Any]) -> None:
        """The run is over; `run` is what run.json says."""
        if self._flown is not None and not self._end.lost and not self._end.busy:
            self._slow_ns = 0  # the whole of it once more
            self._end.write_last(self._state(self._clock_ns()), _LAST_S)
        if not self._end.lost:
            self._end.write_last({"kind": "end", "run": dict(run)}, _LAST_S)

    def close(self) -> None:
        self._end.close()

    # -- the one place in the tick --------------------------------------------------------------------------------

    def before_tick(self) -> None:
        """Look, and obey. Raises StoppedByPage."""
        now_ns = self._clock_ns()
        if now_ns < self._due_ns:
            return
        self._serve(now_ns)

    def _serve(self, now_ns: int) -> None:
        assert self._flown is not None
        scheduler = self._flown.scheduler
        began_ns = time.thread_time_ns()
        self._look(now_ns)
        self.looks_ns += time.thread_time_ns() - began_ns
        before_ns = self._clock_ns()
        while self._paused and not self._steps and not self._end.lost:
            self._wait(_HELD_S)
            self._look(self._clock_ns())
        after_ns = self._clock_ns()
        self.held_s += (after_ns - before_ns) * 1e-9
        if self._steps:
            self._steps -= 1
        elif self._pace is not None and not self._end.lost:
            self._keep_pace(scheduler)
        if self._end.lost:
            self._paused, self._pace = False, None
        if self._paused or self._steps or self._pace is not None:
            self._due_ns = 0  # at every tick
        else:
            self._due_ns = after_ns + self._rest_ns(after_ns)

    def _rest_ns(self, now_ns: int) -> int:
        """Until the next look. Looks are short, but each finds the processor's caches full of other things."""
        if self._end.lost:
            return 1 << 62
        if self._end.busy:
            return _BUSY_NS
        if self._asked is not None and self._update_ns > now_ns:
            return min(_LOOK_NS, self._update_ns - now_ns)
        return _LOOK_NS

    def _keep_pace(self, scheduler: Scheduler) -> None:
        assert self._pace is not None
        now_ns = self._clock_ns()
        if self._pace_from is None:
            self._pace_from = (scheduler.tick, now_ns)
        tick, from_ns = self._pace_from
        due_ns = from_ns + round((scheduler.tick - tick) * scheduler.tick_ns / self._pace)
        if now_ns - due_ns > 200_000_000:  # too slow for this pace: no catching up in a hurry
            self._pace_from = (scheduler.tick, now_ns)
        while now_ns < due_ns and not self._end.lost and not self._paused and self._pace is not None:
            self._wait((due_ns - now_ns) * 1e-9)
            now_ns = self._clock_ns()
            if now_ns < due_ns:
                self._look(now_ns)

    def _wait(self, limit_s: float) -> None:
        writing = [self._fd] if self._end.busy else []
        select.select([self._fd], writing, [], limit_s)

    def _look(self, now_ns: int) -> None:
        end = self._end
        self._keep_trail()
        if end.busy:
            end.push()
        for message in end.read():
            self._obey(message)
        if self._asked is not None and not end.busy and not end.lost and now_ns >= self._update_ns:
            # One that is late, for a picture that was drawn, does not put off all the others.
            self._update_ns = max(self._update_ns + _UPDATE_NS, now_ns + _UPDATE_NS // 2)
            end.write(self._state(now_ns))

    # -- what is told ---------------------------------------------------------------------------------------------

    def _keep_trail(self) -> None:
        flown = self._flown
        truth = None if flown is None else flown.scheduler.truth
        if truth is None or truth.t_ns < self._trail_ns:
            return
        self._trail_ns = truth.t_ns + self._trail_step_ns
        self._trail.append(tuple(round(value, 3) for value in (truth.t_ns * 1e-9, *truth.p_WB)))
        if len(self._trail) > _TRAIL_POINTS:
            del self._trail[1::2]
            self._trail_step_ns *= 2

    def _tell_news(self, phase: str, reached: int) -> None:
        flown = self._flown
        assert flown is not None
        t_ns = flown.scheduler.t_ns
        texts = flown.texts()
        for said_ns, severity, text in texts[self._texts :]:
            self.event(said_ns, "error" if severity <= 3 else "warning" if severity == 4 else "status", text)
            self._told.add((said_ns, text))
        self._texts = len(texts)
        told_phase, told_reached = self._stage
        if phase != told_phase:
            self.event(t_ns, "phase", phase)
        if reached > told_reached:
            self.event(t_ns, "waypoint", f"{reached} reached")
        self._stage = (phase, reached)

    def _state(self, now_ns: int) -> dict[str, Any]:
        flown = self._flown
        assert flown is not None
        scheduler = flown.scheduler
        truth, actuators = scheduler.truth, scheduler.actuators
        phase, reached, waypoints = flown.status()
        self._tell_news(phase, reached)
        tick, then_ns = self._speed_from
        if now_ns - then_ns > 400_000_000:
            self._speed = (scheduler.tick - tick) * scheduler.tick_ns / (now_ns - then_ns)
            self._speed_from = (scheduler.tick, now_ns)
        state: dict[str, Any] = {
            "kind": "state",
            "tick": scheduler.tick,
            "t_ns": scheduler.t_ns,
            "phase": phase,
            "reached": reached,
            "waypoints": waypoints,
            "speed": self._speed,
            "paused": self._paused,
            "pace": self._pace,
            "wind": flown.wind_W_mps(),
            "by_hand": self._wind_W_mps,
            "altered": self.altered,
            "held": self.sticks.held,
            "armed": actuators.armed,
            "mode": actuators.mode,
            "events": list(self._events),
        }
        self._events.clear()
        if truth is not None:
            rotors = len(truth.rotor_speed_radps)
            state |= {
                "p": truth.p_WB,
                "q": truth.q_WB,
                "v": truth.v_WB_W,
                "w": truth.w_WB_B,
                "rotors": truth.rotor_speed_radps,
                "controls": actuators.controls[:rotors],
                "contact": truth.in_contact,
            }
        if now_ns - self._slow_ns >= _SLOW_NS:
            self._slow_ns = now_ns
            state["slow"] = flown.slow() | {"sensors": scalar_samples(self._latest), "trail": self._trail}
        asked = self._asked or ()
        streams = frame_streams(self._latest, asked, self._streams_sent)
        streams |= view_streams(flown.views(), asked, self._streams_sent)
        if streams:
            state["frames"] = streams
        boxes = boxes_of(self._detected, asked)
        if boxes:
            state["boxes"] = boxes
        self._asked = None
        return state

    # -- what is obeyed -------------------------------------------------------------------------------------------

    def _obey(self, message: Mapping[str, Any]) -> None:
        kind = message.get("kind")
        if kind == "next":
            wanted = message.get("streams", ())
            self._asked = tuple(stream for stream in wanted if isinstance(stream, str))
            # A pane that was closed and opened again wants its picture, also where it is the old one.
            for stream in [s for s in self._streams_sent if s not in self._asked]:
                del self._streams_sent[stream]
        elif kind == "sticks":
            self.sticks.move(message)
        elif kind == "stop":
            self._note("stop", alters=False)
            raise StoppedByPage("stopped from the dashboard")
        elif kind in ("pause", "resume", "step", "pace"):
            self._hold(str(kind), message)
        elif kind in ("inject", "wind"):
            try:
                self._change(str(kind), message)
            except (ValueError, KeyError, TypeError, pydantic.ValidationError) as error:
                self._say("refused", f"{kind}: {_brief(error)}")

    def _hold(self, kind: str, message: Mapping[str, Any]) -> None:
        assert self._flown is not None
        if not self._flown.can_wait:
            self._say("refused", f"{kind}: this autopilot runs on wall-clock time and waits for nobody")
            return
        self._pace_from = None
        if kind == "pace":
            pace = message.get("pace")
            if pace is not None and not (is_number(pace) and 0.01 <= pace <= 1000.0):
                self._say("refused", "pace: must be 0.01 to 1000 times real time, or none")
                return
            if pace != self._pace:
                self._pace = pace
                self._note("pace: as fast as it goes" if pace is None else f"pace: {pace:g} times real time")
            return
        if kind == "step":
            self._paused, self._steps = True, self._steps + 1
            self._note("step one tick")
            return
        if self._paused != (kind == "pause"):
            self._paused = kind == "pause"
            self._note(kind)

    def _change(self, kind: str, message: Mapping[str, Any]) -> None:
        """ValueError and its like where it is nothing that can happen to this run."""
        flown = self._flown
        assert flown is not None
        if sum(one["alters"] for one in self.commands) >= _COMMANDS:
            raise ValueError(f"{_COMMANDS} commands that alter in one run; start a new one")
        at_s = flown.scheduler.t_ns / 1e9
        if kind == "wind":
            x, y, z = (float(v) for v in message["velocity_W_mps"])
            if not all(math.isfinite(v) and abs(v) <= _WIND_LIMIT_MPS for v in (x, y, z)):
                raise ValueError(f"three numbers within {_WIND_LIMIT_MPS:g} m/s are needed")
            # Gusts add up: what is added now is what is missing.
            before = self._wind_W_mps
            more = (x - before[0], y - before[1], z - before[2])
            self._winds += 1
            if self._winds > _WINDS:
                raise ValueError(f"{_WINDS} changes in one run; start a new one")
            flown.inject(GustEvent(at_s=at_s, velocity_W_mps=more, rise_s=_WIND_RISE_S))
            self._wind_W_mps = (x, y, z)
            self._note(f"wind by hand: {x:g}, {y:g}, {z:g} m/s (east, north, up)", alters=True)
            return
        what, words = fault_of(message["fault"], at_s)
        flown.inject(what)
        self._note(f"fault: {words}", alters=True)

    def _note(self, text: str, *, alters: bool = False) -> None:
        """Of every command carried out: in the recording, for the page, and for run.json."""
        flown = self._flown
        assert flown is not None
        tick = flown.scheduler.tick
        self.altered = self.altered or alters
        if len(self.commands) < _COMMANDS or alters:
            self.commands.append({"tick": tick, "what": text, "alters": alters})
            flown.event(flown.scheduler.t_ns, "by_hand", f"before tick {tick}: {text}")

    def _say(self, kind: str, text: str) -> None:
        """For the page alone."""
        assert self._flown is not None
        self.event(self._flown.scheduler.t_ns, kind, text)


def _brief(error: Exception) -> str:
    if isinstance(error, pydantic.ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(str(part) for part in first['loc'])} {first['msg']}".strip()
    return str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
