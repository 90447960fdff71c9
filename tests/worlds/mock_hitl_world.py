"""The world of `mock_pixhawk_world` around a mock in HITL: simulated time, with delays set by the test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.hitl import DEFAULT_BAUD, Board, BoardClock
from tests.worlds.mock_pixhawk_world import TICK_NS, World, results, texts
from tests.worlds.simulated_time import SimulatedTime

OUTPUT = MSGID["HIL_ACTUATOR_CONTROLS"]


class Cable:
    """A cable to the board: delivers writes in order, `delay_us(tick)` late, while the board runs by its clock."""

    def __init__(self, board: MockPixhawk, time: SimulatedTime) -> None:
        self.board, self.time = board, time
        self.delay_us: Callable[[int], int] = lambda tick: 300
        self.cut = False  # nothing gets through to the board
        self._start_ns = 0  # when the bench's next tick begins
        self._tick = 0
        self._under_way: list[tuple[int, bytes]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.board, name)

    def feed(self, data: bytes) -> bytes:
        """Write `data` as the bench; return the board's output up to the bench's next tick."""
        if not self.cut:
            at_ns = self._start_ns + self.delay_us(self._tick) * 1000
            if self._under_way:
                at_ns = max(at_ns, self._under_way[-1][0])
            self._under_way.append((at_ns, data))
        self._tick += 1
        return self.wait(TICK_NS)

    def wait(self, duration_ns: int) -> bytes:
        """Run the board alone, as while the bench's machine is busy; return its output."""
        end_ns = self._start_ns = self._start_ns + duration_ns
        out = b""
        while True:
            due_us = self.board.next_due_us
            due_ns = end_ns if due_us is None else self.board.clock.source_ns(due_us)
            arrival_ns = self._under_way[0][0] if self._under_way else end_ns
            next_ns = min(due_ns, arrival_ns)
            if next_ns >= end_ns:
                return out
            self.time.now_ns = max(next_ns, self.time.now_ns)
            out += self.board.feed(self._under_way.pop(0)[1] if arrival_ns <= due_ns else b"")


def hitl_world(*, offset_us: int = 0, drift_ppm: float = 0.0, baud: int = DEFAULT_BAUD, **settings: Any) -> World:
    """Return a world whose `autopilot` is a `Cable` to a board in HITL."""
    time = SimulatedTime()
    clock = BoardClock(time, offset_us=offset_us, drift_ppm=drift_ppm)
    world = World(board=Board(clock, baud), **settings)
    world.autopilot = Cable(world.autopilot, time)
    return world


def take_off(world: World) -> None:
    """Take off to hover and check the acknowledgements."""
    world.run(8.0)
    world.command(176, 1, 4, 2)
    world.command(400, 1)
    frames = world.run(0.2)
    assert results(frames) == [(176, 0), (400, 0)], texts(frames)


def lone_board(**settings: Any) -> tuple[MockPixhawk, SimulatedTime]:
    """Return a board in HITL without a world, and its clock's source."""
    time = SimulatedTime()
    return MockPixhawk(board=Board(BoardClock(time)), **settings), time
