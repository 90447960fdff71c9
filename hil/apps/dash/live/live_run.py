"""The dashboard's side of a run: sends the newest values to the page's server and carries out the page's commands.

Before each tick the bench calls `before_tick`, which usually only compares the clock. Every few milliseconds of wall-
clock time it polls the connection and, if the page has requested an update, sends the values at that time. The run does
not wait for the page, and following a run does not change it: the digest is the same with and without a page.

The tick recorded with a command is the first one that the command affects. `pause`, `step`, `resume` and `pace` only
delay the run and leave the digest as it is. `inject` and `wind` change what is simulated, and sticks steer the vehicle:
the run is then marked as altered by hand and not deterministic.
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
from hil.apps.dash.live.fault_request import requested_fault
from hil.apps.dash.live.page_sticks import PageSticks
from hil.apps.dash.live.server_connection import ServerConnection
from hil.apps.dash.messages import is_number
from hil.apps.dash.views.companion_views import boxes_of, view_streams
from hil.apps.dash.views.payloads import frame_streams, scalar_samples
from hil.run.loop.scheduler import Scheduler
from signals.detections import Detections
from signals.samples import Sample, Vec3
from sim.scene.wind import GustEvent

_POLL_NS = 12_000_000  # wall clock between two polls of the connection
_BUSY_POLL_NS = 4_000_000  # between two polls while an update is partly unsent
_UPDATE_NS = 46_000_000  # between two updates, on average
_SLOW_NS = 500_000_000  # between two updates of slowly changing values
_TRAIL_NS = 200_000_000  # simulated time between two points of the trail
_TRAIL_POINTS = 1500  # beyond this every second point is dropped and the spacing doubles
_EVENTS = 100  # in one update
_MAX_COMMANDS = 500  # of one run: limit of commands that alter it, and of recorded ones that do not
_WIND_RISE_S = 1.0
_MAX_WIND_CHANGES = 100  # in one run: each is a permanent gust, which every later tick adds
_LAST_MESSAGE_S = 2.0  # time limit for sending it
_WIND_LIMIT_MPS = 30.0
_PAUSED_WAIT_S = 0.02  # between two polls while paused


class StoppedByPage(KeyboardInterrupt):
    """The page's Stop button was pressed. It ends the run as Ctrl-C does, with everything so far recorded."""


@dataclass(frozen=True)
class RunAccess:
    """The part of a built run that the dashboard may read and change."""

    description: Mapping[str, Any]  # sent once
    scheduler: Scheduler
    status: Callable[[], tuple[str, int, int]]  # phase, waypoints reached, waypoints
    wind_W_mps: Callable[[], Vec3]
    texts: Callable[[], Sequence[tuple[int, int, str]]]  # status texts of the autopilot so far: t_ns, severity, text
    slow_facts: Callable[[], dict[str, Any]]  # links, battery, skipped work: requested twice a second
    inject: Callable[[Any], None]  # a fault of a rotor, sensor or link, or a gust; ValueError if it does not fit
    event: Callable[[int, str, str], None]
    lockstep: bool  # the autopilot waits for the bench, so the run can be paused
    views: Callable[[], Mapping[str, View]]  # newest view of each companion, by client


class LiveRun:
    """A run that the dashboard follows. The bench calls `attach` once, then `before_tick` before every tick."""

    def __init__(
        self,
        link: socket.socket,
        *,
        paused: bool = False,
        pace: float | None = None,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """`link`: to the page's server. `paused`: wait at tick 0. `pace`: times real time; None: unlimited."""
        self.sticks = PageSticks()
        self.commands: list[dict[str, Any]] = []  # commands that were carried out, for run.json
        self.altered = False  # a command changed what is simulated
        self.paused_s = 0.0  # wall clock
        self.service_ns = 0  # processor time of this thread spent on polls and updates
        self._connection = ServerConnection(link)
        self._link = link
        self._clock_ns = clock_ns
        self._run: RunAccess | None = None
        self._latest: dict[str, Sample] = {}
        self._detected: dict[str, Detections] = {}  # newest, by topic
        self._events: deque[tuple[int, str, str]] = deque(maxlen=_EVENTS)
        self._trail: list[tuple[float, ...]] = []  # t [s], x, y, z [m, W]
        self._trail_step_ns = _TRAIL_NS
        self._trail_ns = 0
        self._paused = paused
        self._steps = 0
        self._pace = pace
        self._pace_from: tuple[int, int] | None = None  # tick, wall clock [ns]
        self._poll_ns = 0  # wall clock of the next poll
        self._update_ns = 0  # wall clock before which no update is made
        self._slow_ns = 0
        self._requested: tuple[str, ...] | None = None  # streams of the requested update; None: no request
        self._streams_sent: dict[str, int] = {}
        self._wind_changes = 0
        self._wind_W_mps: Vec3 = (0.0, 0.0, 0.0)  # set by hand, on top of the bench's own
        self._texts_logged = 0
        self._logged: set[tuple[int, str]] = set()
        self._progress = ("", 0)  # phase and waypoints reached, as last logged
        self._speed_from = (0, 0)
        self._speed = 0.0

    # -- called by the recorder and the bench ------ ---------------------------------------------------------------

    def sample(self, port: str, sample: Sample) -> None:
        """Keep a released sample until the next one of its port."""
        self._latest[port] = sample

    def event(self, t_ns: int, kind: str, text: str) -> None:
        """Add a line to the page's log."""
        # Status texts of the autopilot are recorded at the end of the run, but logged here as soon as they arrive.
        if (t_ns, text) not in self._logged:
            self._events.append((t_ns, kind, text))

    def detected(self, client: str, detections: Detections) -> None:  # noqa: ARG002
        """Keep a companion's detections until the next ones of their topic."""
        self._detected[detections.topic] = detections

    def attach(self, run: RunAccess) -> None:
        """Connect to a built run, and describe it to the page."""
        self._run = run
        if not run.lockstep:
            self._paused, self._pace = False, None
        self._connection.write({"kind": "begin", **run.description})
        self._speed_from = (run.scheduler.tick, self._clock_ns())

    def finish(self, run_json: Mapping[str, Any]) -> None:
        """Send the last state and the contents of run.json: the run is over."""
        connection = self._connection
        if self._run is not None and not connection.lost and not connection.busy:
            self._slow_ns = 0  # include the slowly changing values
            connection.write_last(self._state(self._clock_ns()), _LAST_MESSAGE_S)
        if not connection.lost:
            connection.write_last({"kind": "end", "run": dict(run_json)}, _LAST_MESSAGE_S)

    def close(self) -> None:
        self._connection.close()

    # -- before each tick -----------------------------------------------------------------------------------------

    def before_tick(self) -> None:
        """Serve the page if a poll is due. Raises StoppedByPage."""
        now_ns = self._clock_ns()
        if now_ns < self._poll_ns:
            return
        self._serve(now_ns)

    def _serve(self, now_ns: int) -> None:
        assert self._run is not None
        scheduler = self._run.scheduler
        began_ns = time.thread_time_ns()
        self._poll(now_ns)
        self.service_ns += time.thread_time_ns() - began_ns
        wait_began_ns = self._clock_ns()
        while self._paused and not self._steps and not self._connection.lost:
            self._wait(_PAUSED_WAIT_S)
            self._poll(self._clock_ns())
        after_ns = self._clock_ns()
        self.paused_s += (after_ns - wait_began_ns) * 1e-9
        if self._steps:
            self._steps -= 1
        elif self._pace is not None and not self._connection.lost:
            self._keep_pace(scheduler)
        if self._connection.lost:
            self._paused, self._pace = False, None
        if self._paused or self._steps or self._pace is not None:
            self._poll_ns = 0  # at every tick
        else:
            self._poll_ns = after_ns + self._until_poll_ns(after_ns)

    def _until_poll_ns(self, now_ns: int) -> int:
        """Return the wall-clock time until the next poll. A poll is short, but it evicts the run's data from caches."""
        if self._connection.lost:
            return 1 << 62
        if self._connection.busy:
            return _BUSY_POLL_NS
        if self._requested is not None and self._update_ns > now_ns:
            return min(_POLL_NS, self._update_ns - now_ns)
        return _POLL_NS

    def _keep_pace(self, scheduler: Scheduler) -> None:
        assert self._pace is not None
        now_ns = self._clock_ns()
        if self._pace_from is None:
            self._pace_from = (scheduler.tick, now_ns)
        tick, from_ns = self._pace_from
        due_ns = from_ns + round((scheduler.tick - tick) * scheduler.tick_ns / self._pace)
        if now_ns - due_ns > 200_000_000:  # too slow for this pace: measure it from here, so that no burst follows
            self._pace_from = (scheduler.tick, now_ns)
        while now_ns < due_ns and not self._connection.lost and not self._paused and self._pace is not None:
            self._wait((due_ns - now_ns) * 1e-9)
            now_ns = self._clock_ns()
            if now_ns < due_ns:
                self._poll(now_ns)

    def _wait(self, limit_s: float) -> None:
        writing = [self._link] if self._connection.busy else []
        select.select([self._link], writing, [], limit_s)

    def _poll(self, now_ns: int) -> None:
        connection = self._connection
        self._extend_trail()
        if connection.busy:
            connection.push()
        for message in sorted(connection.read(), key=lambda message: message.get("kind") != "stop"):
            self._carry_out(message)
        idle = not connection.busy and not connection.lost
        if self._requested is not None and idle and now_ns >= self._update_ns:
            # A late update, such as after a rendered frame, does not delay the updates after it.
            self._update_ns = max(self._update_ns + _UPDATE_NS, now_ns + _UPDATE_NS // 2)
            connection.write(self._state(now_ns))

    # -- updates --------------------------------------------------------------------------------------------------

    def _extend_trail(self) -> None:
        truth = None if self._run is None else self._run.scheduler.truth
        if truth is None or truth.t_ns < self._trail_ns:
            return
        self._trail_ns = truth.t_ns + self._trail_step_ns
        self._trail.append(tuple(round(value, 3) for value in (truth.t_ns * 1e-9, *truth.p_WB)))
        if len(self._trail) > _TRAIL_POINTS:
            del self._trail[1::2]
            self._trail_step_ns *= 2

    def _log_progress(self, phase: str, reached: int, waypoints: int) -> None:
        run = self._run
        assert run is not None
        t_ns = run.scheduler.t_ns
        texts = run.texts()
        for text_ns, severity, text in texts[self._texts_logged :]:
            self.event(text_ns, "error" if severity <= 3 else "warning" if severity == 4 else "status", text)
            self._logged.add((text_ns, text))
        self._texts_logged = len(texts)
        logged_phase, logged_reached = self._progress
        if phase != logged_phase:
            self.event(t_ns, "phase", phase)
        if reached > logged_reached:
            self.event(t_ns, "waypoint", f"{reached} of {waypoints} reached")
        self._progress = (phase, reached)

    def _state(self, now_ns: int) -> dict[str, Any]:
        run = self._run
        assert run is not None
        scheduler = run.scheduler
        truth, actuators = scheduler.truth, scheduler.actuators
        phase, reached, waypoints = run.status()
        self._log_progress(phase, reached, waypoints)
        from_tick, from_ns = self._speed_from
        if now_ns - from_ns > 400_000_000:
            self._speed = (scheduler.tick - from_tick) * scheduler.tick_ns / (now_ns - from_ns)
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
            "wind": run.wind_W_mps(),
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
            state["slow"] = run.slow_facts() | {"sensors": scalar_samples(self._latest), "trail": self._trail}
        wanted = self._requested or ()
        streams = frame_streams(self._latest, wanted, self._streams_sent)
        streams |= view_streams(run.views(), wanted, self._streams_sent)
        if streams:
            state["frames"] = streams
        boxes = boxes_of(self._detected, wanted)
        if boxes:
            state["boxes"] = boxes
        self._requested = None
        return state

    # -- commands -------------------------------------------------------------------------------------------------

    def _carry_out(self, message: Mapping[str, Any]) -> None:
        kind = message.get("kind")
        if kind == "next":
            wanted = message.get("streams", ())
            self._requested = tuple(stream for stream in wanted if isinstance(stream, str))
            # A pane that is closed and opened again needs its frame, even if that frame is not new.
            for stream in [s for s in self._streams_sent if s not in self._requested]:
                del self._streams_sent[stream]
        elif kind == "sticks":
            self.sticks.move(message)
        elif kind == "stop":
            self._record("stop", alters=False)
            raise StoppedByPage("stopped from the dashboard")
        elif kind in ("pause", "resume", "step", "pace"):
            self._control_time(str(kind), message)
        elif kind in ("inject", "wind"):
            try:
                self._alter(str(kind), message)
            except (ValueError, KeyError, TypeError, pydantic.ValidationError) as error:
                self._log("refused", f"{kind}: {_brief(error)}")

    def _control_time(self, kind: str, message: Mapping[str, Any]) -> None:
        assert self._run is not None
        if not self._run.lockstep:
            self._log("refused", f"{kind}: this autopilot runs on wall-clock time and cannot be held")
            return
        self._pace_from = None
        if kind == "pace":
            pace = message.get("pace")
            if pace is not None and not (is_number(pace) and 0.01 <= pace <= 1000.0):
                self._log("refused", "pace: must be from 0.01 to 1000 times real time, or none")
                return
            if pace != self._pace:
                self._pace = pace
                self._record("pace: as fast as it goes" if pace is None else f"pace: {pace:g} times real time")
            return
        if kind == "step":
            self._paused, self._steps = True, self._steps + 1
            self._record("step one tick")
            return
        if self._paused != (kind == "pause"):
            self._paused = kind == "pause"
            self._record(kind)

    def _alter(self, kind: str, message: Mapping[str, Any]) -> None:
        """Change the wind or inject a fault. Raises what `requested_fault` raises if it does not fit this run."""
        run = self._run
        assert run is not None
        if sum(command["alters"] for command in self.commands) >= _MAX_COMMANDS:
            raise ValueError(f"no more than {_MAX_COMMANDS} commands may alter one run; start a new run")
        at_s = run.scheduler.t_ns / 1e9
        if kind == "wind":
            x, y, z = (float(v) for v in message["velocity_W_mps"])
            if not all(math.isfinite(v) and abs(v) <= _WIND_LIMIT_MPS for v in (x, y, z)):
                raise ValueError(f"three numbers within {_WIND_LIMIT_MPS:g} m/s are needed (east, north, up)")
            # Gusts add up, so the new gust is the difference from the wind set before.
            previous = self._wind_W_mps
            change = (x - previous[0], y - previous[1], z - previous[2])
            self._wind_changes += 1
            if self._wind_changes > _MAX_WIND_CHANGES:
                raise ValueError(f"no more than {_MAX_WIND_CHANGES} changes of the wind in one run; start a new run")
            run.inject(GustEvent(at_s=at_s, velocity_W_mps=change, rise_s=_WIND_RISE_S))
            self._wind_W_mps = (x, y, z)
            self._record(f"wind by hand: {x:g}, {y:g}, {z:g} m/s (east, north, up)", alters=True)
            return
        fault, text = requested_fault(message["fault"], at_s)
        run.inject(fault)
        self._record(f"fault: {text}", alters=True)

    def _record(self, text: str, *, alters: bool = False) -> None:
        """Add a command that was carried out to the recording, the page's log and run.json."""
        run = self._run
        assert run is not None
        tick = run.scheduler.tick
        self.altered = self.altered or alters
        if len(self.commands) < _MAX_COMMANDS or alters:
            self.commands.append({"tick": tick, "what": text, "alters": alters})
            run.event(run.scheduler.t_ns, "by_hand", f"before tick {tick}: {text}")

    def _log(self, kind: str, text: str) -> None:
        """Add a line to the page's log; it is not recorded."""
        assert self._run is not None
        self.event(self._run.scheduler.t_ns, kind, text)


def _brief(error: Exception) -> str:
    if isinstance(error, pydantic.ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(str(part) for part in first['loc'])} {first['msg']}".strip()
    return str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
