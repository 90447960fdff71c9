"""The interface and the common part of all links to autopilots, whatever their transport and firmware."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from firmware_bridge.links.child_process import ChildProcess
from signals.errors import LinkClosed, LinkError
from signals.latency import LatencyHistogram
from signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample, TruthState, Vec3

if TYPE_CHECKING:
    from firmware_bridge.links.realtime.health import Finding, Punctuality

# The bench's MAVLink address: neither the ground station's (255) nor that of any vehicle.
SIMULATOR_SYSID, SIMULATOR_COMPID = 254, 200


class InvalidControls(LinkError, ValueError):
    """The autopilot answered this tick with controls that are not numbers, or out of range."""


@dataclass(frozen=True)
class LinkCaps:
    """Capabilities of a link. The bench branches on these facts, never on the class of a link."""

    kind: str  # its name in a bench file
    lockstep: bool  # simulated time stands still until the autopilot has answered; if not, it has `begin`
    deterministic: bool  # the same input bytes give the same output bytes in every run
    boot_sensors: int | None  # HIL_SENSORs that a booting autopilot does not answer; None: unknown
    busy_processors: int = 1  # processors that the autopilot keeps busy, where it runs on this machine
    takes_truth: bool = False  # `observe` must give it the true state before each `send`
    uneven_answers: bool = False  # where its mode changes, it answers a tick twice or not at all: PX4's VTOLs
    air_temperature: bool = False  # the autopilot takes HIL_SENSOR's temperature for that of the air (`AirTemperature`)


@dataclass(frozen=True)
class LinkTimeouts:
    """Limits of a link on the wall clock [s]; infinite for no limit."""

    reply_s: float = 10.0  # for the answer to a tick; with a free-running autopilot, for any message
    connect_s: float = 20.0  # for the first message after `open`
    reconnect_s: float = 10.0  # for a lost transport to come back (free-running links only)


@dataclass
class LinkStats:
    """Counters of one link since `open`."""

    steps: int = 0  # HIL_SENSORs sent
    late: int = 0  # samples that left more than 2 ms late (free-running links only)
    rtt: LatencyHistogram = field(default_factory=LatencyHistogram)  # from the write to the answer, wall clock
    tx_bytes: int = 0
    rx_bytes: int = 0
    rx_frames: int = 0
    bad_crc: int = 0
    garbage_bytes: int = 0
    lost_frames: int = 0  # gaps in the autopilot's sequence numbers
    bad_controls: int = 0  # skipped commands that were not numbers (free-running links only)
    unanswered: int = 0  # ticks without an answer, in which the command before was held (`uneven_answers` only)
    repeated: int = 0  # further answers to a tick, which were left out (`uneven_answers` only)

    def take_received(self, *parsers: FrameParser) -> None:
        """Update the counters of received data: the sums over the link's parsers."""
        self.rx_frames = sum(parser.frames for parser in parsers)
        self.bad_crc = sum(parser.bad_crc for parser in parsers)
        self.garbage_bytes = sum(parser.garbage_bytes for parser in parsers)
        self.lost_frames = sum(parser.lost for parser in parsers)


class TickSamples(NamedTuple):
    """Samples that an autopilot gets in one tick: of the first four kinds the newest, or None."""

    imu: ImuSample | None = None
    mag: MagSample | None = None
    baro: BaroSample | None = None
    gps: GpsSample | None = None
    others: Sequence[Sample] = ()  # of all other kinds each, in order


class Connection(Protocol):
    """Anything that a link opens and closes."""

    @property
    def name(self) -> str: ...

    def open(self) -> None: ...

    def close(self) -> None: ...


def _nothing() -> None:
    """Do nothing while the link waits: no other function was given."""


def _ignore_event(kind: str, text: str) -> None:
    """Drop an event: the caller gave no `on_event`."""


class AutopilotLink:
    """One autopilot. Per tick: one `send`, one `wait`, one `take_frames`, in this order.

    `open` opens the connections in their order, starts the program, then waits for the far side (`_await_far_side`).

    `start_process` is called once the connections are open, and the returned process is started; `close` ends it.
    `unnamed` is a connection that errors do not name. `on_event(kind, text)` gets events of the link for the recording.
    """

    # A lockstep link polls for the reply this long before it sleeps: waking up takes longer than many a reply.
    busy_wait_ns = 0
    _stats: LinkStats
    _ignores_sigterm = False  # True if the program ignores SIGTERM while it waits for the bench

    def __init__(
        self,
        caps: LinkCaps,
        *connections: Connection,
        unnamed: Connection | None = None,
        start_process: Callable[[], ChildProcess] | None = None,
        on_event: Callable[[str, str], None] | None = None,
    ) -> None:
        self._caps = caps
        self._named_connections = connections
        self._all_connections = connections if unnamed is None else (*connections, unnamed)
        self._start_process = start_process
        self._on_event = on_event if on_event is not None else _ignore_event
        self._process: ChildProcess | None = None
        self.while_waiting: Callable[[], None] = _nothing  # called about four times a second in a long wait; may raise
        self._frames: list[Frame] = []  # for take_frames
        self._reset()

    def _reset(self) -> None:
        """Set the state before the first byte."""
        raise NotImplementedError

    def _await_far_side(self) -> None:
        """Wait for the autopilot. Raise a named LinkError if it does not answer."""
        raise NotImplementedError

    def _parsers(self) -> Sequence[FrameParser]:
        """Return the parsers of the connections that carry MAVLink."""
        raise NotImplementedError

    def send(self, tick: int, t_ns: int, samples: TickSamples, extra: bytes) -> bytes:
        """Write [extra][range, flow, vision][HIL_GPS if given][HIL_SENSOR] at once and return exactly these bytes."""
        raise NotImplementedError

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """Return the answer to this tick's `send`; None while the autopilot boots.

        LockstepLost: no answer within the wall-clock limit, or an answer to another time. LinkClosed: the far side has
        disconnected. InvalidControls: the answer's controls are not numbers, or out of range.
        """
        raise NotImplementedError

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for a tick's time on the wall clock, and return the newest command (free-running links only)."""
        raise NotImplementedError

    def observe(self, truth: TruthState, wind_W_mps: Vec3) -> None:
        """Take the true state of the vehicle and the wind there [m/s, W], before `send` (`caps.takes_truth` only)."""
        raise NotImplementedError

    def punctuality(self) -> Punctuality | None:
        """Return the timing of a free-running link so far; None before `open`, and in lockstep, where it has none."""
        return None

    def findings(self) -> Sequence[Finding]:
        """Return the faults in this run's timing that affect the autopilot."""
        return ()

    @property
    def stats(self) -> LinkStats:
        """Counters; brought up to date by reading this property."""
        self._stats.take_received(*self._parsers())
        return self._stats

    @property
    def caps(self) -> LinkCaps:
        return self._caps

    @property
    def name(self) -> str:
        return f"autopilot ({self._caps.kind}, {', '.join(connection.name for connection in self._named_connections)})"

    @property
    def pid(self) -> int | None:
        """Process id of the autopilot, if the bench started it."""
        return None if self._process is None else self._process.pid

    def open(self) -> None:
        """Open the connections, start the program, wait for the far side. Raise a named LinkError on failure."""
        self._frames = []
        self._reset()
        try:
            for connection in self._all_connections:
                connection.open()
            if self._start_process is not None:
                self._process = self._start_process()
                self._process.start()
            self._await_far_side()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the link and end the program that `open` started. May be called at any time, any number of times."""
        # Connections close first, so that a far side that notices it can end by itself.
        for connection in self._all_connections:
            connection.close()
        process, self._process = self._process, None
        if process is not None:
            if self._ignores_sigterm and process.running() and process.pid is not None:
                os.kill(process.pid, signal.SIGKILL)
            process.close()

    def take_frames(self) -> list[Frame]:
        """Return every frame received since the last call in the order of arrival, the answers included."""
        frames, self._frames = self._frames, []
        return frames

    def _check_process(self, what: str) -> None:
        """Raise LinkClosed if the program has ended; `what` describes the moment."""
        if self._process is not None and not self._process.running():
            raise LinkClosed(self.name, f"{what}: {self._process.describe_end()}", cause="crashed")
