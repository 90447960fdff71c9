"""Clocks of the server: they call `Simulation.step` in the asyncio loop, in slices between which clients are served.

wall    Simulated time follows the wall clock at ClockSpeed. Tick k is due at a time that is computed from the start, so
        nothing drifts. A computer that is too slow falls behind by at most `_MOST_BEHIND_S`; the rest is lost and told.
calls   Simulated time moves only while a client waits for it, in a move or in simContinueForTime, as fast as it goes.
"""

from __future__ import annotations

import asyncio
import time

from hil.apps.airsim.simulation import Simulation
from signals.time import NS_PER_S

_SLICE_NS = 500_000  # of wall time; a request waits for this and one tick at most
_MOST_BEHIND_S = 0.25
_NS_PER_MINUTE = 60 * NS_PER_S


def _advance(simulation: Simulation, end_tick: int | None) -> None:
    """Advance up to a tick, None: as long as a client waits for it, and at most for one slice of wall time."""
    end_ns = time.perf_counter_ns() + _SLICE_NS
    while simulation.runs and (simulation.busy if end_tick is None else simulation.world.tick < end_tick):
        simulation.step()
        if time.perf_counter_ns() >= end_ns:
            break


async def _serve() -> None:
    """Let requests be read in one round of the event loop and answered in the next."""
    await asyncio.sleep(0)
    await asyncio.sleep(0)


class CallsClock:
    """Clock `calls`."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._work = asyncio.Event()
        simulation.wake = self._work.set

    async def run(self) -> None:
        """Advance the simulation until the task is cancelled."""
        simulation = self._simulation
        while True:
            await self._work.wait()
            self._work.clear()
            while simulation.busy and simulation.runs:
                # Time stands still at the tick in which the last task ended.
                _advance(simulation, None)
                await _serve()


class WallClock:
    """Clock `wall`."""

    def __init__(self, simulation: Simulation, speed: float) -> None:
        self._simulation, self._speed = simulation, speed
        self._work = asyncio.Event()
        self.lost_ns = 0  # of wall time, that the computer was too slow for
        self._told_ns = -_NS_PER_MINUTE
        simulation.wake = self._work.set
        simulation.begin_at(time.time_ns())

    async def run(self) -> None:
        """Advance the simulation until the task is cancelled."""
        simulation = self._simulation
        tick_wall_ns = simulation.world.tick_ns / self._speed
        while True:
            while not simulation.runs:
                self._work.clear()
                await self._work.wait()
            begin_ns, begin_tick = time.perf_counter_ns(), simulation.world.tick
            while simulation.runs:
                now_ns = time.perf_counter_ns()
                due = begin_tick + int((now_ns - begin_ns) / tick_wall_ns)
                behind = due - simulation.world.tick
                if behind * tick_wall_ns > _MOST_BEHIND_S * NS_PER_S:
                    excess = behind - int(_MOST_BEHIND_S * NS_PER_S / tick_wall_ns)
                    begin_ns += round(excess * tick_wall_ns)
                    self._lose(round(excess * tick_wall_ns), now_ns)
                    behind -= excess
                if behind > 0:
                    _advance(simulation, simulation.world.tick + behind)
                    await _serve()
                else:
                    next_ns = begin_ns + (due + 1 - begin_tick) * tick_wall_ns
                    await asyncio.sleep(max(0.0, (next_ns - now_ns) / NS_PER_S))

    def _lose(self, lost_ns: int, now_ns: int) -> None:
        self.lost_ns += lost_ns
        if now_ns - self._told_ns > _NS_PER_MINUTE:
            self._told_ns = now_ns
            self._simulation.log(
                f"the simulation is slower than the wall clock at ClockSpeed {self._speed:g}: "
                f"{self.lost_ns / NS_PER_S:.2f} s of wall time were lost so far; lower ClockSpeed or use --clock calls"
            )
