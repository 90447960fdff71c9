"""A link to an autopilot, whatever wire and firmware are behind it: what the bench demands of it, what each one has."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from firmware_bridge.links.child_process import ChildProcess
from hil.signals.errors import LinkClosed, LinkError
from hil.signals.latency import LatencyHistogram
from hil.signals.samples import ActuatorFrame, BaroSample, GpsSample, ImuSample, MagSample, Sample


class InvalidControls(LinkError, ValueError):
    """The autopilot answered this tick with controls that are not numbers, or out of range."""


@dataclass(frozen=True)
class LinkCaps:
    """What a link can do. The bench branches on these facts, never on the class of a link."""

    kind: str  # the registry's name of it
    lockstep: bool  # simulated time stands still until the autopilot has answered; if not, the link has `begin`
    deterministic: bool  # the same bytes in give the same bytes out, run after run
    boot_sensors: int | None  # first HIL_SENSORs that get no answer; None: found out by running at wall-clock pace
    busy_processors: int = 1  # that the autopilot keeps busy while it thinks, where it runs on this machine
    takes_truth: bool = False  # is told the vehicle's true state before each `send` (`observe`)


@dataclass
class LinkStats:
    """Counters of one link since `open`."""

    steps: int = 0  # HIL_SENSORs sent
    late: int = 0  # answers that came after the tick they answer had passed (free-running links only)
    rtt: LatencyHistogram = field(default_factory=LatencyHistogram)  # from the write to the answer, wall clock
    tx_bytes: int = 0
    rx_bytes: int = 0
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


class Wire(Protocol):
    """What a link opens and closes."""

    @property
    def name(self) -> str: ...

    def open(self) -> None: ...

    def close(self) -> None: ...


def _tell_nobody(kind: str, text: str) -> None:
    """No events are wanted."""


class AutopilotLink:
    """One autopilot. Per tick: one `send`, one `wait`, one `take_frames`, in this order.

    `open` opens its wires in their order, starts the program, then waits for the far side (`_await_far_side`).

    `start_process` is called once the wires are open, and the process it returns started; `close` ends that process.
    `aside` is a wire that errors do not name. `deaf`: a program that waits for the bench does not hear SIGTERM.
    `on_event(kind, text)` hears what happens on the link and is worth a line in the recording.
    """

    _stats: LinkStats

    def __init__(
        self,
        caps: LinkCaps,
        *wires: Wire,
        aside: Wire | None = None,
        start_process: Callable[[], ChildProcess] | None = None,
        deaf: bool = False,
        on_event: Callable[[str, str], None] | None = None,
    ) -> None:
        self._caps = caps
        self._named_wires = wires
        self._all_wires = wires if aside is None else (*wires, aside)
        self._start_process = start_process
        self._deaf = deaf
        self._on_event = on_event if on_event is not None else _tell_nobody
        self._process: ChildProcess | None = None
        self._frames: list[Frame] = []  # for take_frames
        self._reset()

    def _reset(self) -> None:
        """As before the first byte."""
        raise NotImplementedError

    def _await_far_side(self) -> None:
        """Return once the autopilot is there; named LinkErrors if it does not come."""
        raise NotImplementedError

    def _parsers(self) -> Sequence[FrameParser]:
        """Of the wires that speak MAVLink."""
        raise NotImplementedError

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
        raise NotImplementedError

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """The answer to this tick's `send`; None while the autopilot boots.

        LockstepLost: no answer within the wall-clock limit, or the answer to another time. LinkClosed: the
        far side is gone. InvalidControls: the answer's controls are no commands.
        """
        raise NotImplementedError

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
        return f"autopilot ({self._caps.kind}, {', '.join(wire.name for wire in self._named_wires)})"

    @property
    def pid(self) -> int | None:
        """Of the autopilot, if the bench started it."""
        return None if self._process is None else self._process.pid

    def open(self) -> None:
        """Bring the far side up and wait for it. Named LinkErrors if it does not come."""
        self._frames = []
        self._reset()
        try:
            for wire in self._all_wires:
                wire.open()
            if self._start_process is not None:
                self._process = self._start_process()
                self._process.start()
            self._await_far_side()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the link and whatever `open` started. May be called at any time, any number of times."""
        # The wires first: a well-behaved far side sees the hang-up and leaves by itself.
        for wire in self._all_wires:
            wire.close()
        process, self._process = self._process, None
        if process is not None:
            if self._deaf and process.running() and process.pid is not None:
                os.kill(process.pid, signal.SIGKILL)
            process.close()

    def take_frames(self) -> list[Frame]:
        """Every frame received since the last call, in the order of arrival, the answers included."""
        frames, self._frames = self._frames, []
        return frames

    def _check_process(self, what: str) -> None:
        """LinkClosed if the program has ended; `what` it did then."""
        if self._process is not None and not self._process.running():
            raise LinkClosed(self.name, f"{what}: {self._process.describe_end()}", cause="crashed")
