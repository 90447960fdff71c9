"""One vehicle of a run as the dashboard follows it: its newest samples, log lines, trail, and commands by hand."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_bridge.codecs.companion_view import View
from hil.run.feed.companion_views import boxes_of, view_streams
from hil.run.feed.page_sticks import PageSticks
from hil.run.feed.payloads import frame_streams, scalar_samples
from hil.run.loop.by_hand import HandledVehicle, Present
from signals.detections import Detections
from signals.samples import Sample, Vec3

_SLOW_NS = 500_000_000  # wall clock between two updates of slowly changing values
_TRAIL_NS = 200_000_000  # simulated time between two points of the trail
_TRAIL_POINTS = 1500  # beyond this every second point is dropped and the spacing doubles
_EVENTS = 100  # in one update


@dataclass(frozen=True)
class RunAccess:
    """The part of a built run that the dashboard may read and change."""

    description: Mapping[str, Any]  # sent once
    scheduler: Present
    status: Callable[[], tuple[str, int, int]]  # phase, waypoints reached, waypoints
    wind_W_mps: Callable[[], Vec3]
    texts: Callable[[], Sequence[tuple[int, int, str]]]  # status texts of the autopilot so far: t_ns, severity, text
    slow_facts: Callable[[], dict[str, Any]]  # links, battery, skipped work: requested twice a second
    inject: Callable[[Any], None]  # a fault of a rotor, sensor or link, or a gust; ValueError if it does not fit
    set_turbulence: Callable[[float], None]  # wind at 20 ft [m/s]
    event: Callable[[int, str, str], None]
    lockstep: bool  # the autopilot waits for the bench, so the run can be paused
    views: Callable[[], Mapping[str, View]]  # newest view of each companion, by client
    stops: bool = True  # the page may stop the run
    # Payloads that are made for the page alone, of the wanted streams that were not `sent` (stream -> version).
    frames: Callable[[Sequence[str], dict[str, int]], dict[str, Any]] = lambda wanted, sent: {}  # noqa: ARG005


class LiveVehicle(HandledVehicle):
    """One vehicle, as the recorder and the page's commands change it. It is a tap of the recorder."""

    def __init__(self, name: str) -> None:
        """`name`: in a run of several vehicles; empty in a run of one."""
        super().__init__(name)
        self.sticks = PageSticks()
        self._run: RunAccess | None = None
        self._latest: dict[str, Sample] = {}
        self._detected: dict[str, Detections] = {}  # newest, by topic
        self._events: deque[tuple[int, str, str]] = deque(maxlen=_EVENTS)
        self._trail: list[tuple[float, ...]] = []  # t [s], x, y, z [m, W]
        self._trail_step_ns = _TRAIL_NS
        self._trail_ns = 0
        self._slow_ns = 0
        self._streams_sent: dict[str, int] = {}
        self._texts_logged = 0
        self._logged: set[tuple[int, str]] = set()
        self._progress = ("", 0)  # phase and waypoints reached, as last logged

    @property
    def run(self) -> RunAccess:
        """The built run."""
        assert self._run is not None
        return self._run

    @run.setter
    def run(self, run: RunAccess) -> None:
        self._run = self._access = run

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

    def extend_trail(self) -> None:
        """Add a point to the trail if one is due."""
        truth = self.run.scheduler.truth
        if truth is None or truth.t_ns < self._trail_ns:
            return
        self._trail_ns = truth.t_ns + self._trail_step_ns
        self._trail.append(tuple(round(value, 3) for value in (truth.t_ns * 1e-9, *truth.p_WB)))
        if len(self._trail) > _TRAIL_POINTS:
            del self._trail[1::2]
            self._trail_step_ns *= 2

    def _log_progress(self, phase: str, reached: int, waypoints: int) -> None:
        run = self.run
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

    def take_events(self) -> list[tuple[int, str, str]]:
        """Return the log lines since the last call; in a run of several vehicles they begin with the name."""
        self._log_progress(*self.run.status())
        prefix = f"{self.name}: " if self.name else ""
        events = [(t_ns, kind, prefix + text) for t_ns, kind, text in self._events]
        self._events.clear()
        return events

    def place(self) -> tuple[Any, ...] | None:
        """Return position [m, W] and attitude; None before the first tick."""
        truth = self.run.scheduler.truth
        return None if truth is None else (truth.p_WB, truth.q_WB)

    def state(self, now_ns: int, wanted: Sequence[str], *, slow: bool = False) -> dict[str, Any]:
        """Return what the page shows of this vehicle. `slow`: with the slowly changing values, even if not due.

        Frames of the `wanted` streams, which have names as in a run of one vehicle, are under `frames`.
        """
        run = self.run
        scheduler = run.scheduler
        truth, actuators = scheduler.truth, scheduler.actuators
        phase, reached, waypoints = run.status()
        state: dict[str, Any] = {
            "phase": phase,
            "reached": reached,
            "waypoints": waypoints,
            "wind": run.wind_W_mps(),
            "held": self.sticks.held,
            "armed": actuators.armed,
            "mode": actuators.mode,
        }
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
        if slow or now_ns - self._slow_ns >= _SLOW_NS:
            self._slow_ns = now_ns
            state["slow"] = run.slow_facts() | {"sensors": scalar_samples(self._latest), "trail": self._trail}
        streams = frame_streams(self._latest, wanted, self._streams_sent)
        streams |= view_streams(run.views(), wanted, self._streams_sent)
        streams |= run.frames(wanted, self._streams_sent)
        if streams:
            prefix = f"{self.name}/" if self.name else ""
            state["frames"] = {prefix + stream: payload for stream, payload in streams.items()}
        boxes = boxes_of(self._detected, wanted)
        if boxes:
            state["boxes"] = boxes
        return state

    def forget_closed(self, wanted: Sequence[str]) -> None:
        """Forget what was sent of other streams: a pane opened again needs its frame, even if that is not new."""
        for stream in [s for s in self._streams_sent if s not in wanted]:
            del self._streams_sent[stream]

    def log(self, kind: str, text: str) -> None:
        """Add a line to the page's log; it is not recorded."""
        self.event(self.run.scheduler.t_ns, kind, text)
