"""What the bench demands of a link to an autopilot, whatever wire and firmware are behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from hil.signals.errors import LinkError
from hil.signals.latency import LatencyHistogram
from hil.signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample, TruthState, Vec3


class InvalidControls(LinkError, ValueError):
    """The autopilot answered this tick with controls that are not numbers, or out of range."""


@dataclass(frozen=True)
class LinkCaps:
    """What a link can do. The bench branches on these facts, never on the class of a link."""

    kind: str  # the registry's name of it
    lockstep: bool  # simulated time stands still until the autopilot has answered
    deterministic: bool  # the same bytes in give the same bytes out, run after run
    max_rate_hz: float  # fastest tick at which one message gets one answer
    boot_sensors: int | None  # first HIL_SENSORs that get no answer; None: found out by running at wall-clock pace
    busy_processors: int = 1  # that the autopilot keeps busy while it thinks, where it runs on this machine
    takes_truth: bool = False  # is told the vehicle's true state before each `send` (`TruthTaker`)


@dataclass
class LinkStats:
    """Counters of one link since `open`."""

    steps: int = 0  # HIL_SENSORs sent
    late: int = 0  # answers that came after the tick they answer had passed (free-running links only)
    rtt: LatencyHistogram = field(default_factory=LatencyHistogram)  # from the write to the answer, wall clock
    tx_bytes: int = 0
    rx_bytes: int = 0
    tx_frames: int = 0  # the link's own: sensors and GPS, not those handed to it
    rx_frames: int = 0
    bad_crc: int = 0
    garbage_bytes: int = 0
    lost_frames: int = 0  # gaps in the autopilot's sequence numbers
    bad_controls: int = 0  # commands that are no numbers, passed over (free-running links only)

    def take_received(self, *parsers: FrameParser) -> None:
        """Bring the counters of what was received up to date: the sums over the link's wires."""
        self.rx_frames = sum(parser.frames for parser in parsers)
        self.bad_crc = sum(parser.bad_crc for parser in parsers)
        self.garbage_bytes = sum(parser.garbage_bytes for parser in parsers)
        self.lost_frames = sum(parser.lost for parser in parsers)


class FreeRunning(Protocol):
    """What a link to an autopilot that waits for nobody (`caps.lockstep` False) has besides."""

    def begin(self, tick: int) -> ActuatorFrame | None:
        """Wait for the tick's wall-clock time; the newest command, None if none came since the last tick."""
        ...


class TruthTaker(Protocol):
    """What a link has besides whose autopilot simulates its own sensors from the vehicle's pose."""

    def observe(self, truth: TruthState, wind_W: Vec3) -> None:
        """The state of this tick and the wind at the vehicle [m/s, W]. Called before `send`."""
        ...


class AutopilotLink(Protocol):
    """One autopilot. Per tick: one `send`, one `wait`, one `take_frames`, in this order."""

    @property
    def caps(self) -> LinkCaps: ...

    @property
    def stats(self) -> LinkStats: ...

    def open(self) -> None:
        """Bring the far side up and wait for its first heartbeat. Named LinkErrors if it does not come."""
        ...

    def send(
        self,
        tick: int,
        t_ns: int,
        imu: ImuSample | None,
        mag: MagSample | None,
        baro: BaroSample | None,
        gps: GpsSample | None,
        extra: bytes,
        ranging: Sequence[Sample] = (),
    ) -> bytes:
        """Write [extra][range and flow][HIL_GPS if given][HIL_SENSOR] at once and return exactly these bytes."""
        ...

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """The answer to this tick's `send`; None while the autopilot boots.

        LockstepLost: no answer within the wall-clock limit, or the answer to another time. LinkClosed: the
        far side is gone. InvalidControls: the answer's controls are no commands.
        """
        ...

    def take_frames(self) -> list[Frame]:
        """Every frame received since the last call, in the order of arrival, the answers included."""
        ...

    def close(self) -> None:
        """End the link and whatever `open` started. May be called at any time, any number of times."""
        ...
