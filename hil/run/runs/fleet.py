"""The vehicles of a run, one or several: opened, flown tick by tick in one world, and closed together."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

from hil.run.runs.lockstep import Lockstep
from hil.run.runs.tick_loop import Flight, VehicleFailed, fly_ticks
from hil.run.runs.vehicle_run import VehicleRun
from signals.errors import HilError
from signals.samples import TruthState
from sim.physics.vehicle_group import VehicleContact, VehicleGroup

Place = Callable[[Mapping[str, TruthState]], None]
OnTick = Callable[[Sequence[TruthState], Sequence[VehicleContact]], None]


class OtherVehicleFailed(HilError):
    """End of a flight because another vehicle of the run broke off with an error."""


class Fleet:
    """The runs of all vehicles, by name. An only vehicle has an empty name, and its errors are raised as they are."""

    def __init__(
        self,
        runs: Mapping[str, VehicleRun],
        *,
        quiet: bool,
        downwash: bool = False,
        place: Place = lambda _: None,
        on_tick: OnTick = lambda _truths, _contacts: None,
    ) -> None:
        """Make the fleet of `runs`; nothing is opened yet.

        `place` is called with all states of a tick before any sensor is sampled, `on_tick` at the tick's end and,
        without states, after the last; neither for an only vehicle. `downwash`: wakes are wind for the other vehicles.
        """
        self._runs, self._quiet, self._downwash = runs, quiet, downwash
        self._place, self._on_tick = place, on_tick
        self.flights: Mapping[str, Flight] = {}
        self.setup_s = self.wall_s = 0.0

    def run(self) -> None:
        """Prepare, fly and conclude. An error is noted by the run of its vehicle. Raises it, or VehicleFailed."""
        began_s = time.monotonic()
        try:
            with ExitStack() as stack:
                self.each(lambda run: run.prepare(stack))
                self.setup_s = time.monotonic() - began_s
                self.fly()
                self.each(VehicleRun.conclude)
        except VehicleFailed as failed:
            cause = failed.__cause__ or failed
            other = OtherVehicleFailed(f"the vehicle {failed.name} failed: {cause}")
            for name, run in self._runs.items():
                run.failure.note(cause if name == failed.name else other)
            raise
        except (Exception, KeyboardInterrupt) as error:
            for run in self._runs.values():
                run.failure.note(error)
            raise

    def each(self, step: Callable[[VehicleRun], None], *, lost: bool = True) -> None:
        """Do a step of every vehicle, in order; `lost`: also of those without autopilot. Raises VehicleFailed."""
        for name, run in self._runs.items():
            if not lost and self.flights[name].lost:
                continue
            try:
                step(run)
            except Exception as error:
                if not name:
                    raise
                raise VehicleFailed(name) from error

    def fly(self) -> None:
        """Fly until every flight has ended. The vehicles are built."""
        self.flights = {name: Flight(run.context, name) for name, run in self._runs.items()}
        for run in self._runs.values():
            run.context.fleet = tuple(each.context for each in self._runs.values())
        flights = list(self.flights.values())
        lockstep = None
        if flights[0].name:
            physics = {name: run.context.physics for name, run in self._runs.items()}
            world = VehicleGroup(physics, downwash=self._downwash)
            lockstep = Lockstep(flights, world, self._place_all, self._on_tick)
        began_s = time.monotonic()
        try:
            fly_ticks(flights, quiet=self._quiet, step=None if lockstep is None else lockstep.step)
        finally:
            if lockstep is not None:
                lockstep.end()
            self.wall_s = time.monotonic() - began_s - sum(run.paused_s for run in self._runs.values())
            for run in self._runs.values():
                run.flown(self.wall_s)

    def _place_all(self, truths: Sequence[TruthState]) -> None:
        self._place(dict(zip(self.flights, truths, strict=True)))
