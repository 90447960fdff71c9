"""Wraps any transport with declared faults.

Both directions are split into units (`FrameSplitter`), which pass the faults in the order of the list. The same seed
and the same traffic give the same hits. Units that were held back leave at the first call of `read` or `write` after
they are due; `read` wakes up for them. There is no thread.

Effects on a run in lockstep, with the limits of `LockstepLink`:

    a HIL_SENSOR or its answer dropped or damaged    LockstepLost: the autopilot does not answer what it never received
    an answer doubled                                LockstepLost: it answers an earlier tick twice
    delayed, stalled or reordered, not too long      only a slower run: simulated time stands still
    the same for longer than the reply limit         LockstepLost
    the heartbeat lost                               HandshakeError
    unplugged                                        LinkClosed; PortNotFound from `open` until it is over

Bytes that may begin a frame are held back until the frame is whole or the line has been quiet for a while; that is the
only effect of a fault that never hits. Units held back when the transport is closed are lost.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from firmware_bridge.codecs.mavlink_frame import FrameSplitter
from firmware_bridge.faults.fault_stage import FaultStage
from firmware_bridge.faults.hit_log import EventSink, HitLog
from firmware_bridge.faults.link_fault import Direction, LinkFault
from firmware_bridge.transports.transport import Transport
from signals.errors import LinkClosed, PortNotFound

# The beginning of a frame, followed by silence for this long, is not a frame.
_QUIET_NS = 200_000_000


class _Direction:
    """One direction: the splitter, then the faults."""

    def __init__(self, direction: Direction, faults: Sequence[LinkFault], *, seed: int, log: HitLog) -> None:
        self.splitter = FrameSplitter()
        self._direction: Direction = direction
        self._seed, self._log = seed, log
        self.stages = [
            FaultStage(index, fault, direction, seed=seed, log=log)
            for index, fault in enumerate(faults)
            if fault.kind != "unplug" and fault.acts_on(direction)
        ]

    def add(self, index: int, fault: LinkFault) -> None:
        if fault.kind != "unplug" and fault.acts_on(self._direction):
            self.stages.append(FaultStage(index, fault, self._direction, seed=self._seed, log=self._log))

    @property
    def holds(self) -> bool:
        return self.splitter.pending > 0 or any(stage.holds for stage in self.stages)

    def clear(self) -> None:
        self.splitter.clear()
        for stage in self.stages:
            stage.clear()

    def push(self, units: list[bytes], t_ns: int, wall_ns: int) -> bytes:
        """Pass `units` through the faults. Return the bytes that leave now, units that were due included."""
        for stage in self.stages:
            units = stage.push(units, t_ns, wall_ns)
        return b"".join(units)

    def next_release_ns(self) -> int | None:
        """Return the wall clock at which the next held unit is due; None if none is held."""
        times = [at for stage in self.stages if (at := stage.next_release_ns) is not None]
        return min(times) if times else None


class _Plug:
    """The unplug faults: the one that is active, and when it ends."""

    def __init__(self, faults: Sequence[LinkFault], log: HitLog) -> None:
        self._waiting = [(index, fault) for index, fault in enumerate(faults) if fault.kind == "unplug"]
        self._log = log
        self._active: tuple[int, int, int] | None = None  # index, end in simulated time, end by wall clock

    def add(self, index: int, fault: LinkFault) -> None:
        if fault.kind == "unplug":
            self._waiting.append((index, fault))

    @property
    def index(self) -> int:
        """Index of the active unplug fault."""
        assert self._active is not None
        return self._active[0]

    def unplug_if_due(self, t_ns: int, wall_ns: int) -> bool:
        """Unplug if a fault is due. Return True if so. Each fault unplugs once."""
        for position, (index, fault) in enumerate(self._waiting):
            if t_ns >= fault.begin_ns:
                del self._waiting[position]
                self._active = (index, t_ns + fault.length_ns, wall_ns + fault.length_ns)
                self._log.plug(index, t_ns, out=True)
                return True
        return False

    def can_open(self, t_ns: int, wall_ns: int) -> bool:
        """Return True if the port can be opened: no fault is active, or it has ended."""
        if self._active is None:
            return True
        index, end_ns, end_wall_ns = self._active
        if t_ns < end_ns and wall_ns < end_wall_ns:
            return False
        self._log.plug(index, t_ns, out=False)
        self._active = None
        return True


class FaultyTransport:
    """Wraps `inner` with `faults`.

    `now_ns` returns simulated time, 0 before the run. `on_event` gets the hits as `HitLog` describes. One thread at a
    time, as with any transport.
    """

    def __init__(
        self,
        inner: Transport,
        faults: Sequence[LinkFault],
        seed: int,
        now_ns: Callable[[], int],
        on_event: EventSink | None = None,
        *,
        wall_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._inner = inner
        self._now_ns = now_ns
        self._wall_ns = wall_ns
        self._sleep = sleep
        self.faults = list(faults)
        self._log = HitLog(faults, on_event)
        self._plug = _Plug(faults, self._log)
        self._out = _Direction("to_autopilot", faults, seed=seed, log=self._log)
        self._in = _Direction("from_autopilot", faults, seed=seed, log=self._log)
        self._heard_wall_ns = 0  # last bytes from the far side
        self._unplugged: str | None = None  # the error text of all calls until `open`
        self._closed_error: LinkClosed | None = None  # raised once all bytes from the far side have been read
        self._silent_pipe: tuple[int, int] | None = None

    @property
    def name(self) -> str:
        return self._inner.name

    def inject(self, fault: LinkFault) -> None:
        """Add a fault, after the others."""
        self.faults.append(fault)
        index = self._log.add(fault)
        for part in (self._plug, self._out, self._in):
            part.add(index, fault)

    def unmet(self) -> dict[int, int]:
        """Return the faults that have hit nothing, by index, with the number of units that each could have hit.

        One with a rate of 0 cannot hit, and is not among them.
        """
        stages = [*self._out.stages, *self._in.stages]
        return {
            index: sum(stage.count for stage in stages if stage.index == index)
            for index, hits in self.hits().items()
            if not hits and self.faults[index].rate != 0.0
        }

    def hits(self) -> dict[int, int]:
        """Return the exact number of hits of each fault since this object was made, by the fault's index."""
        return self._log.counts()

    def open(self) -> None:
        """Open `inner`. PortNotFound while a fault keeps it unplugged."""
        t_ns, wall_ns = self._now_ns(), self._wall_ns()
        if not self._plug.can_open(t_ns, wall_ns) or self._plug.unplug_if_due(t_ns, wall_ns):
            raise PortNotFound(self.name, f"unplugged by the declared link fault {self._plug.index}")
        self._out.clear()
        self._in.clear()
        self._unplugged = self._closed_error = None
        self._inner.open()
        self._heard_wall_ns = wall_ns

    def close(self) -> None:
        self._inner.close()
        self._out.clear()
        self._in.clear()
        self._log.summarise(self._now_ns())
        pipe, self._silent_pipe = self._silent_pipe, None
        for fd in pipe or ():
            with suppress(OSError):
                os.close(fd)

    def _check_plug(self, t_ns: int, wall_ns: int) -> None:
        if self._unplugged is None and self._plug.unplug_if_due(t_ns, wall_ns):
            self._unplugged = f"unplugged by the declared link fault {self._plug.index} at {t_ns * 1e-9:g} s"
            # The far side sees the line closed as well.
            self._inner.close()
        if self._unplugged is not None:
            raise LinkClosed(self.name, self._unplugged, cause="unplugged")

    def write(self, data: bytes) -> None:
        if not self.faults:  # the usual case takes no extra time
            self._inner.write(data)
            return
        t_ns, wall_ns = self._now_ns(), self._wall_ns()
        self._check_plug(t_ns, wall_ns)
        if not self._out.stages:
            self._inner.write(data)
            return
        # Callers write whole frames, so a remainder is not a frame.
        units = self._out.splitter.feed(data) + self._out.splitter.flush()
        self._send(self._out.push(units, t_ns, wall_ns))

    def _send(self, data: bytes) -> None:
        if data:
            self._inner.write(data)

    def read(self, timeout_s: float) -> bytes:
        if not self.faults:
            return self._inner.read(timeout_s)
        deadline_ns = self._wall_ns() + int(max(timeout_s, 0.0) * 1e9)
        while True:
            t_ns, wall_ns = self._now_ns(), self._wall_ns()
            self._check_plug(t_ns, wall_ns)
            if self._out.stages:
                self._send(self._out.push([], t_ns, wall_ns))
            data = self._in.push(self._quiet(wall_ns), t_ns, wall_ns)
            if data:
                return data
            if self._closed_error is not None and not self._in.holds:
                raise self._closed_error
            until_ns = min([deadline_ns, *self._wake_times()])
            wait_s = max(until_ns - wall_ns, 0) * 1e-9
            heard = self._listen(wait_s)
            if heard:
                self._heard_wall_ns = self._wall_ns()
                if not self._in.stages:
                    return heard
                units = self._in.splitter.feed(heard)
                data = self._in.push(units, self._now_ns(), self._heard_wall_ns)
                if data:
                    return data
            elif self._closed_error is not None and not self._in.holds:
                continue  # the next round raises the error
            elif self._in_memory and not self._holds:
                return b""
            if self._wall_ns() >= deadline_ns:
                return b""

    def _quiet(self, wall_ns: int) -> list[bytes]:
        """Return bytes held back as the beginning of a frame, once it is clear that they are none."""
        if not self._in.splitter.pending:
            return []
        if self._in_memory or self._closed_error is not None or wall_ns - self._heard_wall_ns >= _QUIET_NS:
            return self._in.splitter.flush()
        return []

    def _wake_times(self) -> list[int]:
        times = [at for direction in (self._in, self._out) if (at := direction.next_release_ns()) is not None]
        if self._in.splitter.pending:
            times.append(self._heard_wall_ns + _QUIET_NS)
        return times

    def _listen(self, wait_s: float) -> bytes:
        """Read from `inner`, or sleep where its `read` does not wait."""
        if self._closed_error is None:
            try:
                data = self._inner.read(wait_s)
            except LinkClosed as error:
                # Raised after all bytes from the far side have been read.
                self._closed_error = error
                return b""
            if data or not self._in_memory or not self._holds:
                return data
        if wait_s > 0.0:
            self._sleep(wait_s)
        return b""

    @property
    def _in_memory(self) -> bool:
        return self._inner.fileno() is None

    @property
    def _holds(self) -> bool:
        return self._in.holds or self._out.holds

    def fileno(self) -> int | None:
        """Return the descriptor of `inner`.

        None means that no more bytes can come. So while units are held back over a transport without a descriptor, this
        is one on which no bytes ever arrive; `read` returns the held units when they are due, whatever it signals.
        """
        fd = self._inner.fileno()
        if fd is not None or not self._holds or self._unplugged is not None:
            return fd
        if self._silent_pipe is None:
            self._silent_pipe = os.pipe()
        return self._silent_pipe[0]
