"""The companion link of one run: opened before the bench plans what to draw, closed after the flight."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from firmware_bridge.codecs.companion import ReportValue, topic_schema
from firmware_bridge.companion.frames import SessionFacts
from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from hil.companion.answers import Answers, LiveAnswers
from hil.companion.link_faults import CompanionFault, CompanionFaults
from hil.companion.settings import link_settings
from hil.companion.stage import CompanionStage, Waiting
from hil.companion.started import StartedClient, close_all
from hil.companion.timing import ClientTiming, TimedPilot, TimingLog
from hil.companion.trace import TRACE_NAME, TracedAnswers, TraceWriter
from hil.companion.view_log import VIEWS_EVERY_NS, ViewLog
from hil.config import BenchConfig
from hil.config.radar_checks import view_of
from hil.frame_stages import available_ports
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections
from hil.signals.errors import RecordingError
from hil.signals.latency import LatencyHistogram
from hil.signals.samples import Vec3
from hil.signals.time import NS_PER_S, RateAccumulator
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.mount import Mount
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.radar_parameters import RadarParameters

_EVENTS_OF_A_KIND = 50

Event = Callable[[int, str, str], None]


class CompanionLink:
    """Clients on the wire, or the trace of an earlier run."""

    def __init__(
        self,
        config: BenchConfig,
        out: Path,
        *,
        waypoints_W: Sequence[Vec3],
        on_event: Event,
        begun_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """`begun_ns`: when the present tick began, by `time.perf_counter_ns`."""
        self.config, self._out, self._on_event, self._begun_ns = config, out, on_event, begun_ns
        self._waypoints_W = tuple(waypoints_W)
        self._server: CompanionServer | None = None
        self._started: list[StartedClient] = []
        self._answers: Answers
        self._trace: TraceWriter | None = None
        self._timing: TimingLog | None = None
        self._stage: CompanionStage | None = None
        self._told: Counter[str] = Counter()  # events, by kind
        self.views = ViewLog(out)
        self._faults = CompanionFaults(config.seed, on_event, self._unplug)
        self.topics: frozenset[str] = frozenset()

    def open(self) -> None:
        """Wait for the clients; afterwards `topics` is what they want. LinkErrors, ConfigError, RecordingError."""
        companion = self.config.companion
        if companion.trace is not None:
            traced = TracedAnswers(Path(companion.trace))
            unknown = traced.topics - available_ports(self.config).keys()
            if unknown:
                names = ", ".join(sorted(unknown))
                raise RecordingError(f"{companion.trace}: is of another bench: this one has no topics {names}")
            self._answers, self.topics = traced, traced.topics
            return
        self.views.begin()
        server = CompanionServer(
            link_settings(companion),
            self._facts(),
            on_event=self._server_event,
            on_view=self.views.take,
            barred=self._faults.unplugged,
        )
        server.open()
        self._server = server
        keys = None if companion.arrangement == "shared_memory" else server.settings.keys
        for cut in companion.start:
            settings = companion.settings | cut.settings
            self._started.append(StartedClient(cut.name, server.endpoint, self._out, settings, keys))

        def still_there() -> None:
            for client in self._started:
                client.check()

        server.wait_for_clients(companion.expected, companion.connect_timeout_s, still_there)
        self.topics = server.topics
        server.limit_topics(self.topics)
        timing = self._timing = TimingLog(self._out, begun_ns=self._begun_ns)
        self._answers = LiveAnswers(server, on_sending=timing.handing, on_reply=timing.replied, ended=self._ended)

    def stage(
        self,
        desire: Callable[[DesiredState, int, int], None] | None,
        on_report: Callable[[str, Mapping[str, ReportValue], int], None] = lambda _client, _report, _t_ns: None,
        on_detections: Callable[[str, Detections, int], None] = lambda _client, _detections, _t_ns: None,
    ) -> CompanionStage:
        """What the scheduler steps. `desire` hears what controlling clients want, `on_report` what they say of
        themselves, `on_detections` what they see."""
        companion, config = self.config.companion, self.config
        if self._server is not None and not (companion.control and companion.time == "realtime"):
            # Also where nobody controls: a repetition then needs no clients, and draws what was drawn.
            controlling = [c for c in self._answers.clients(0) if c.control and companion.control]
            self._trace = TraceWriter(self._out / TRACE_NAME, controlling, sorted(self.topics))
        self._stage = CompanionStage(
            self._answers,
            mode=companion.time,
            topics=sorted(self.topics),
            rate=RateAccumulator(event_mhz=round(companion.rate_hz * 1000), tick_mhz=config.tick_hz * 1000),
            waiting=Waiting(companion.reply_timeout_s, companion.reconnect_s, companion.on_loss == "error"),
            link_delay_ns=None if companion.link_delay_s is None else round(companion.link_delay_s * NS_PER_S),
            desire=desire,
            on_report=on_report,
            on_detections=on_detections,
            on_event=self._on_event,
            detected_then=self._answers.detected_then if isinstance(self._answers, TracedAnswers) else lambda _t_ns: (),
            trace=self._trace,
            timing=self._timing,
            faults=self._faults,
        )
        return self._stage

    @property
    def here(self) -> list[str]:
        """Names of those that are connected."""
        return [] if self._server is None else sorted(client.name for client in self._server.clients)

    def inject(self, fault: CompanionFault, t_ns: int) -> None:
        """Begins now. ValueError where there is no such client on the wire."""
        if fault.client not in self.here:
            raise ValueError(f"no client {fault.client!r} is connected; there are: {', '.join(self.here) or 'none'}")
        self._faults.inject(fault, t_ns)

    def _unplug(self, client: str, why: str) -> None:
        if self._server is not None:
            self._server.drop(client, why)

    def timed(self, pilot: OffboardPilot) -> OffboardPilot | TimedPilot:
        """The pilot as a source of commands, each of which ends a frame's t3."""
        return pilot if self._timing is None else TimedPilot(pilot, self._timing)

    def close(self, status: str = "") -> None:
        """Tell the clients, and let go. May be called twice."""
        if self._server is not None:
            with suppress(OSError):
                self._server.close(status, "the run is over")
        started, self._started = self._started, []
        close_all(started)
        if self._trace is not None:
            self._trace.close()
            self._trace = None
        if self._timing is not None:
            self._timing.close()
        self.views.close()

    def report(self) -> dict[str, Any]:
        """For run.json."""
        companion = self.config.companion
        stage = self._stage
        seats = {} if stage is None else stage.all_seats
        clients: dict[str, Any] = {
            name: {"control": seat.client.control, "topics": sorted(seat.client.topics), "frames": seat.sent}
            | {"dropped": seat.dropped, "finished": seat.finished}
            | ({"report": dict(seat.report)} if seat.report else {})
            for name, seat in seats.items()
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

    def _facts(self) -> SessionFacts:
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

    def _ended(self, name: str) -> str | None:
        return next((client.how_it_ended() for client in self._started if client.name == name), None)

    def _server_event(self, kind: str, text: str) -> None:
        """What clients do, whoever they are: they cannot fill the recording."""
        self._told[kind] += 1
        if self._told[kind] <= _EVENTS_OF_A_KIND:
            more = "" if self._told[kind] < _EVENTS_OF_A_KIND else " (more of this kind are not told)"
            self._on_event(-1, f"companion_{kind}", text + more)


def _quantiles(histogram: LatencyHistogram) -> dict[str, float | None]:
    if not histogram.count:
        return {"p50": None, "p99": None, "max": None}
    return {
        "p50": histogram.quantile_ns(0.5) / 1e6,
        "p99": histogram.quantile_ns(0.99) / 1e6,
        "max": histogram.max_ns / 1e6,
    }


def calibrations(config: BenchConfig, sensors: Iterable[str]) -> dict[str, dict[str, Any]]:
    """By sensor: kind, rate_hz, p_BC [m] and q_BC of its frame in B; of cameras the pinhole model; of LiDARs the
    elevation of each ring, none where a ring has none of its own."""
    found = {}
    for name in sensors:
        sensor = config.sensors[name]
        told: dict[str, Any] = {"kind": sensor.kind, "rate_hz": sensor.rate_hz}
        p = sensor.parameters
        if isinstance(p, CameraParameters):
            told |= _camera(view_of(sensor).camera) | _place(p.mount_m, p.mount_rpy_deg, optical=True)
        elif isinstance(p, RadarParameters):
            view = p.view() if p.frame is None else view_of(config.sensors[p.frame])
            told |= _place(view.mount_m, view.mount_rpy_deg, optical=False) | {"chirp": p.chirp.model_dump(mode="json")}
        elif hasattr(p, "mount_m") and hasattr(p, "mount_rpy_deg"):
            told |= _place(p.mount_m, p.mount_rpy_deg, optical=False)
            if isinstance(p, LidarParameters):
                told |= {"elevation_deg": list(p.pattern.ring_elevations_deg)}
        found[name] = told
    return found


def _camera(camera: Any) -> dict[str, Any]:
    return {
        "width": camera.width,
        "height": camera.height,
        "camera_matrix": [float(x) for x in camera.opencv_matrix],
        "projection_matrix": [float(x) for x in projection_matrix(camera)],
        "distortion": distortion_name(camera),
        "coefficients": [float(x) for x in coefficients(camera)],
    }


def _place(mount_m: Any, mount_rpy_deg: Any, *, optical: bool) -> dict[str, Any]:
    mount = Mount(mount_m, mount_rpy_deg, optical=optical)
    return {"p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}
