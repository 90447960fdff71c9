"""What every link to an autopilot has: wires, the program behind them if the bench starts one, the frames that came."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from typing import Protocol

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser
from firmware_bridge.links.autopilot_link import LinkCaps, LinkStats
from firmware_bridge.links.child_process import ChildProcess
from hil.signals.errors import LinkClosed


class Wire(Protocol):
    """What a link opens and closes."""

    @property
    def name(self) -> str: ...

    def open(self) -> None: ...

    def close(self) -> None: ...


def _tell_nobody(kind: str, text: str) -> None:
    """No events are wanted."""


class WiredLink:
    """Opens its wires in their order, starts the program, then waits for the far side (`_await_far_side`).

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
        # The wires first: a well-behaved far side sees the hang-up and leaves by itself.
        for wire in self._all_wires:
            wire.close()
        process, self._process = self._process, None
        if process is not None:
            if self._deaf and process.running() and process.pid is not None:
                os.kill(process.pid, signal.SIGKILL)
            process.close()

    def take_frames(self) -> list[Frame]:
        """Every frame received since the last call, in order."""
        frames, self._frames = self._frames, []
        return frames

    def _check_process(self, what: str) -> None:
        """LinkClosed if the program has ended; `what` it did then."""
        if self._process is not None and not self._process.running():
            raise LinkClosed(self.name, f"{what}: {self._process.describe_end()}", cause="crashed")
