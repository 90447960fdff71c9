"""The companion link of one run: opened before the run plans its sensors, closed after the flight."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.companion import topic_schema
from firmware_bridge.companion.frames import SessionFacts
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.faults.companion_fault import CompanionFault
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.config import BenchConfig
from hil.config.companion.clients import client_name
from hil.config.companion.link_settings import link_settings
from hil.config.schema import Start
from hil.config.sensors.radar_checks import view_of
from hil.run.companion.answers import Answers, LiveAnswers
from hil.run.companion.link_faults import CompanionFaults
from hil.run.companion.pacing import FramePacing, Timeouts
from hil.run.companion.stage import AnswerCallbacks, CompanionLogs, CompanionStage
from hil.run.companion.started import StartedClient, close_all
from hil.run.companion.timing import ClientTiming, TimedPilot, TimingLog
from hil.run.companion.trace import TracedAnswers, TraceWriter
from hil.run.companion.view_log import VIEWS_EVERY_NS, ViewLog
from hil.run.sensors.frame_stages import available_ports
from hil.run_files import TRACE_NAME
from signals.errors import RecordingError
from signals.latency import LatencyHistogram
from signals.samples import Vec3
from signals.time import NS_PER_S, RateAccumulator
from signals.units import RAD_PER_DEG
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.mount import Mount
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.radar_parameters import RadarParameters

_MAX_EVENTS_PER_KIND = 50
_LOCALISING_CLIENTS = frozenset({"detect", "explore"})

Event = Callable[[int, str, str], None]


class CompanionLink:
    """Connection to the clients of a run, or to the trace of an earlier run in their place."""

    def __init__(
        self,
        config: BenchConfig,
        out: Path,
        *,
        waypoints_W: Sequence[Vec3],
        on_event: Event,
        begun_ns: Callable[[], int] = time.perf_counter_ns,
        standing_height_m: float = 0.0,
    ) -> None:
        """`begun_ns` returns the time at which the present tick began, by `time.perf_counter_ns`."""
        self._standing_height_m = standing_height_m
        self.config, self._out, self._on_event, self._begun_ns = config, out, on_event, begun_ns
        self._waypoints_W = tuple(waypoints_W)
        self._server: CompanionServer | None = None
        self._started: list[StartedClient] = []
        self._answers: Answers
        self._trace: TraceWriter | None = None
        self._timing: TimingLog | None = None
        self._stage: CompanionStage | None = None
        self._event_counts: Counter[str] = Counter()  # by kind
        self.views = ViewLog(out)
        self._faults = CompanionFaults(config.noise_seed, on_event, self._unplug)
        self.topics: frozenset[str] = frozenset()
        self._awaited: frozenset[str] = frozenset()  # clients with which the flight begins
        self._traced_missing: list[str] | None = None  # clients lost in the run whose trace this one repeats
        self._bad_ends: dict[str, str] = {}  # texts of started clients that ended with an error, by name

    def _start_settings(self, client: str) -> dict[str, Any]:
        """Return the setting `start` of a shipped client that localises itself, if the bench moves the start."""
        start = self.config.start
        if client not in _LOCALISING_CLIENTS or start == Start():
            return {}
        x, y, z = start.p_W
        return {"start": [x, y, z + self._standing_height_m, start.yaw_deg * RAD_PER_DEG]}

    def open(self) -> None:
        """Wait for the clients, then set `topics` to what they requested.

        Raises LinkError, ConfigError or RecordingError.
        """
        companion = self.config.companion
        if companion.trace is not None:
            traced = TracedAnswers(Path(companion.trace))
            unknown = traced.topics - available_ports(self.config).keys()
            if unknown:
                names = ", ".join(sorted(unknown))
                raise RecordingError(f"{companion.trace}: belongs to another bench: this one has no topics {names}")
            self._answers, self.topics, self._traced_missing = traced, traced.topics, traced.missing
            return
        self.views.begin()
        server = CompanionServer(
            link_settings(companion),
            self._session_facts(),
            on_event=self._server_event,
            on_view=self.views.take,
            unplugged=self._faults.unplugged,
        )
        server.open()
        self._server = server
        keys = None if companion.arrangement == "shared_memory" else server.settings.keys
        for cut in companion.start:
            settings = self._start_settings(cut.name) | companion.settings | cut.settings
            self._started.append(StartedClient(cut.name, server.endpoint, self._out, settings, keys))

        def check_processes() -> None:
            for client in self._started:
                client.check()

        server.wait_for_clients(companion.expected, companion.connect_timeout_s, check_processes)
        self.topics = server.topics
        self._awaited = frozenset(self.connected)
        server.limit_topics(self.topics)
        timing = self._timing = TimingLog(self._out, begun_ns=self._begun_ns)
        self._answers = LiveAnswers(
            server, on_sending=timing.sending, on_reply=timing.replied, process_end=self._process_end
        )

    def stage(self, callbacks: AnswerCallbacks) -> CompanionStage:
        """Make the stage that the scheduler steps."""
        companion, config = self.config.companion, self.config
        if self._server is not None and not (companion.control and companion.time == "realtime"):
            # Also written without clients in control, so that a replay needs no clients and computes the same sensors.
            controlling = [c for c in self._answers.clients(0) if c.control and companion.control]
            self._trace = TraceWriter(self._out / TRACE_NAME, controlling, sorted(self.topics))
        self._stage = CompanionStage(
            self._answers,
            FramePacing(
                companion.time,
                RateAccumulator(event_millihz=round(companion.rate_hz * 1000), tick_millihz=config.tick_hz * 1000),
                Timeouts(companion.reply_timeout_s, companion.reconnect_s, companion.on_loss == "error"),
                None if companion.link_delay_s is None else round(companion.link_delay_s * NS_PER_S),
            ),
            topics=sorted(self.topics),
            callbacks=callbacks,
            on_event=self._on_event,
            logs=CompanionLogs(self._trace, self._timing),
            faults=self._faults,
        )
        return self._stage

    @property
    def connected(self) -> list[str]:
        """Names of the connected clients, sorted."""
        return [] if self._server is None else sorted(client.name for client in self._server.clients)

    def missing(self) -> list[str]:
        """Return when and why each client was lost that the flight needs: those started, and as many as awaited.

        A client that came back and answers is not missing, nor is one that had finished. After `close` also those
        started that ended as failed: what a client finds out only in its `stop()` counts. In a replay: those of the
        recorded run.
        """
        companion, stage = self.config.companion, self._stage
        if stage is None:
            return []
        if self._traced_missing is not None:
            return self._traced_missing
        lost = {name: loss for name, loss in stage.losses.items() if name in self._awaited}
        if len(stage.all_sessions) - len(stage.losses) >= companion.expected:
            started = {client_name(cut.name) for cut in companion.start}
            lost = {name: loss for name, loss in lost.items() if name in started}
        return [
            f"the companion {name} was lost {t_ns / NS_PER_S:.2f} s after the start and answered no more: {reason}"
            for name, (t_ns, reason) in sorted(lost.items())
        ] + [text for name, text in sorted(self._bad_ends.items()) if name not in stage.losses]

    def inject(self, fault: CompanionFault, t_ns: int) -> None:
        """Begin a fault now. Raises ValueError if its client is not connected."""
        if fault.client not in self.connected:
            names = ", ".join(self.connected) or "none"
            raise ValueError(f"no client {fault.client!r} is connected; connected: {names}")
        self._faults.inject(fault, t_ns)

    def _unplug(self, client: str, reason: str) -> None:
        if self._server is not None:
            self._server.drop(client, reason)

    def timed(self, pilot: OffboardPilot) -> OffboardPilot | TimedPilot:
        """Return the pilot as a command source that logs the time of each set-point, the end of t3."""
        return pilot if self._timing is None else TimedPilot(pilot, self._timing)

    def conclude(self) -> None:
        """Write into the trace what the verdict will say about lost clients: a replay has none to lose."""
        if self._trace is not None:
            self._trace.missing(self.missing())

    def close(self, status: str = "") -> None:
        """End the sessions with `status`, stop the started clients and close the files. Idempotent."""
        if self._server is not None:
            with suppress(OSError):
                self._server.close(status, "the run is over")
        started, self._started = self._started, []
        ends = close_all(started)
        if status == "over":
            bad = {name: f"the companion {name} ended with an error: {end}" for name, end in ends.bad.items()}
            self._bad_ends |= bad
            # Under go_on no reason of the verdict tells of an error.
            told = bad.values() if self.config.companion.on_loss == "go_on" else ()
            for text in (*ends.terminated, *told):
                self._on_event(-1, "warning", text)
        trace, self._trace = self._trace, None
        try:
            if trace is not None:
                if ends.bad:
                    trace.missing(self.missing())
                trace.close()
        finally:
            if self._timing is not None:
                self._timing.close()
            self.views.close()

    def report(self) -> dict[str, Any]:
        """Return the key `companion` of run.json."""
        companion = self.config.companion
        stage = self._stage
        sessions = {} if stage is None else stage.all_sessions
        clients: dict[str, Any] = {
            name: {"control": session.client.control, "topics": sorted(session.client.topics), "frames": session.sent}
            | {"dropped": session.dropped, "finished": session.finished}
            | ({"report": dict(session.report)} if session.report else {})
            for name, session in sessions.items()
        }
        if self._server is not None:
            for name, stats in self._server.stats().items():
                timing = ClientTiming() if self._timing is None else self._timing.clients.get(name, ClientTiming())
                clients.setdefault(name, {}).update(
                    bytes=stats.bytes,
                    malformed=stats.malformed,
                    clock_offset_ms=stats.clock_offset_ns / 1e6,
                    render_ms=_quantiles(timing.render),
                    link_ms=_quantiles(timing.link),
                    t1_ms=_quantiles(timing.t1),
                    t2_ms=_quantiles(timing.t2),
                    reply_ms=_quantiles(timing.reply),
                    t3_ms=_quantiles(timing.t3),
                    overhead_ms=_quantiles(stats.overhead),
                )
        return {
            "time": companion.time,
            "arrangement": companion.arrangement if companion.trace is None else "trace",
            "rate_hz": companion.rate_hz,
            "frames": 0 if stage is None else stage.frames,
            "topics": sorted(self.topics),
            "clients": clients,
            "refused": [] if self._server is None else list(self._server.refused),
        }

    def _session_facts(self) -> SessionFacts:
        ports, config = available_ports(self.config), self.config
        return SessionFacts(
            topics={topic: topic_schema(port.type, topic.partition("/")[2] or None) for topic, port in ports.items()},
            mode=config.companion.time,
            tick_ns=config.tick_ns,
            rate_hz=config.companion.rate_hz,
            sensors=calibrations(config, config.sensors),
            waypoints_W=self._waypoints_W,
            control=config.companion.control,
            views_every_ns=VIEWS_EVERY_NS,
        )

    def _process_end(self, name: str) -> str | None:
        return next((client.process_end() for client in self._started if client.name == name), None)

    def _server_event(self, kind: str, text: str) -> None:
        """Record an event of the server; limited per kind, so that clients cannot fill the recording."""
        self._event_counts[kind] += 1
        if self._event_counts[kind] <= _MAX_EVENTS_PER_KIND:
            last = self._event_counts[kind] == _MAX_EVENTS_PER_KIND
            note = " (further events of this kind are not recorded)" if last else ""
            self._on_event(-1, f"companion_{kind}", text + note)


def _quantiles(histogram: LatencyHistogram) -> dict[str, float | None]:
    if not histogram.count:
        return {"p50": None, "p99": None, "max": None}
    return {
        "p50": histogram.quantile_ns(0.5) / 1e6,
        "p99": histogram.quantile_ns(0.99) / 1e6,
        "max": histogram.max_ns / 1e6,
    }


def calibrations(config: BenchConfig, sensors: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the calibration of each sensor: kind, rate_hz, p_BC [m] and q_BC of its frame in B.

    A camera also has its pinhole model, a radar its chirp, a LiDAR the elevation of each ring [deg], an empty list if
    the rings have no fixed elevation.
    """
    calibration_of = {}
    for name in sensors:
        sensor = config.sensors[name]
        calibration: dict[str, Any] = {"kind": sensor.kind, "rate_hz": sensor.rate_hz}
        p = sensor.parameters
        if isinstance(p, CameraParameters):
            calibration |= _camera(view_of(sensor).camera) | _mount(p.mount_m, p.mount_rpy_deg, optical=True)
        elif isinstance(p, RadarParameters):
            view = p.view() if p.frame is None else view_of(config.sensors[p.frame])
            calibration |= _mount(view.mount_m, view.mount_rpy_deg, optical=False) | {
                "chirp": p.chirp.model_dump(mode="json")
            }
            array = p.antenna.array
            if array.transmitters > 1:
                calibration |= {
                    "tx_positions_m": [list(t) for t in array.tx_positions_m],
                    "rx_positions_m": [list(r) for r in array.rx_positions_m],
                    "doppler_bands": array.doppler_bands,
                }
        elif hasattr(p, "mount_m") and hasattr(p, "mount_rpy_deg"):
            calibration |= _mount(p.mount_m, p.mount_rpy_deg, optical=False)
            if isinstance(p, LidarParameters):
                calibration |= {"elevation_deg": list(p.pattern.ring_elevations_deg)}
        calibration_of[name] = calibration
    return calibration_of


def _camera(camera: Any) -> dict[str, Any]:
    return {
        "width": camera.width,
        "height": camera.height,
        "camera_matrix": [float(x) for x in camera.opencv_matrix],
        "projection_matrix": [float(x) for x in projection_matrix(camera)],
        "distortion": distortion_name(camera),
        "coefficients": [float(x) for x in coefficients(camera)],
    }


def _mount(mount_m: Any, mount_rpy_deg: Any, *, optical: bool) -> dict[str, Any]:
    mount = Mount(mount_m, mount_rpy_deg, optical=optical)
    return {"p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}
