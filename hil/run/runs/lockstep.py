"""One tick of several vehicles: all move to the same time, and all samples are sent before any answer is awaited.

    1 begin    each autopilot's controls of the tick before; free-running links wait for the tick's wall-clock time
    2 physics  the world moves every vehicle to t_k, with contact between them
    3 send     each vehicle's sensors are sampled and sent; the autopilots compute side by side from here on
    4 work     each vehicle's cameras, LiDARs and radars, its recording and its companions
    5 wait     each autopilot's answer, in the order of the file

The phases are those of `hil.run.loop.scheduler`. A vehicle whose flight is over stays in the world with its rotors
stopped, and is not recorded any more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from hil.run.part import FlightEnded
from hil.run.runs.tick_loop import Flight, VehicleFailed
from signals.errors import HandshakeError, LinkError, ModelRangeError
from signals.samples import TruthState
from sim.physics.vehicle_group import VehicleContact, VehicleGroup

_STOPPED = (0.0,) * 16


class Lockstep:
    """Steps the flights of all vehicles together."""

    def __init__(
        self,
        flights: Sequence[Flight],
        world: VehicleGroup,
        place: Callable[[Sequence[TruthState]], None],
        on_tick: Callable[[Sequence[TruthState], Sequence[VehicleContact]], None],
    ) -> None:
        """`place` is called with all states of a tick before any sensor is sampled, `on_tick` at the tick's end.

        `end` calls `on_tick` once more, without states.
        """
        self._flights, self._world, self._place, self._on_tick = tuple(flights), world, place, on_tick
        self._tick = 0

    def step(self) -> bool:
        """Run one tick. Raises VehicleFailed; a lost autopilot with `on_loss: go_on` only makes its vehicle fall."""
        controls = [self._each(flight, flight.run.scheduler.begin) or _STOPPED for flight in self._flights]
        began_ns = time.perf_counter_ns()
        try:
            truths = self._world.advance(self._tick, controls)
        except ModelRangeError as error:
            raise VehicleFailed(error.vehicle) from error
        self._tick += 1
        self._place(truths)
        for flight, truth in zip(self._flights, truths, strict=True):
            scheduler = flight.run.scheduler
            self._each(flight, scheduler.send, truth, began_ns)
            if flight.lost and not flight.over:
                scheduler.fall(truth)
        for flight in self._flights:
            self._each(flight, flight.run.scheduler.work, may_lose=False)
        for flight in self._flights:
            self._each(flight, flight.run.scheduler.wait)
            if flight.lost and not flight.over:
                flight.run.scheduler.tick = self._tick
        self._on_tick(truths, self._world.take_contacts())
        return True

    def end(self) -> None:
        """Report the contacts that still go on after the last tick."""
        self._on_tick((), self._world.take_contacts(last=True))

    def _each(self, flight: Flight, phase: Callable[..., Any], *arguments: Any, may_lose: bool = True) -> Any:
        """Run one phase of a vehicle that still flies, and return its result.

        `may_lose`: a LinkError of this phase is one of the autopilot, not of a companion.
        """
        if flight.over or flight.lost:
            return None
        config = flight.run.bench.config
        try:
            return phase(*arguments)
        except FlightEnded:
            raise
        except Exception as error:
            is_lost = may_lose and isinstance(error, LinkError) and not isinstance(error, HandshakeError)
            if not is_lost or config.autopilot.on_loss == "error":
                raise VehicleFailed(flight.name) from error
            flight.lost = True
            flight.run.event("error", f"the autopilot is lost, and the vehicle falls (on_loss: go_on): {error}")
            return None
