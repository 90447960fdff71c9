"""A flight of several vehicles without a result: nothing but crashes is judged, and one vehicle is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hil.config import Bench
from hil.run.part import Part
from hil.run.parts.catalog import parts_of
from hil.run.recorder.no_recorder import NoRecorder
from hil.run.recorder.recorder import Recorder
from hil.run.runs.lockstep import Lockstep
from hil.run.runs.tick_loop import Flight, VehicleFailed, fly_ticks
from hil.run.runs.vehicle_run import VehicleRun
from signals.errors import HilError, RecordingError
from signals.samples import TruthState
from sim.physics.vehicle_group import VehicleGroup

Place = Callable[[Mapping[str, TruthState]], None]


class _EndsWith(Part):
    """Part that ends a flight together with that of another vehicle."""

    def __init__(self, other: Part) -> None:
        self._other = other

    def ended(self) -> bool:
        return self._other.ended()


def for_each(runs: Mapping[str, VehicleRun], step: Callable[[VehicleRun], None]) -> None:
    """Do a step of every vehicle, in order. Raises VehicleFailed."""
    for name, run in runs.items():
        try:
            step(run)
        except Exception as error:
            raise VehicleFailed(name) from error


def group_of(runs: Mapping[str, VehicleRun], bench: Bench) -> VehicleGroup:
    """Return the physics of all vehicles, which are built."""
    return VehicleGroup({name: run.context.physics for name, run in runs.items()}, downwash=bench.config.group.downwash)


class GroupFlight:
    """Flight of all vehicles of a bench, of which one is recorded."""

    def __init__(self, bench: Bench, out: Path, vehicle: str, place: Place) -> None:
        """`vehicle` is recorded. `place` is called with all states of a tick before that tick is recorded."""
        self._bench, self._out, self._vehicle, self._place = bench, out, vehicle, place

    def fly(self, recorder: Recorder, part: Part) -> None:
        """Fly until `part`, one of the recorded vehicle's, ends the flight. Raises as `hil.run.bench_run.fly`."""
        try:
            with ExitStack() as stack:
                self._fly(stack, recorder, part)
        except VehicleFailed as failed:
            cause = failed.__cause__
            assert cause is not None
            if isinstance(cause, HilError) and not isinstance(cause, RecordingError):
                raise HilError(f"{failed.name}: {cause}") from cause
            raise cause from None

    def _fly(self, stack: ExitStack, recorder: Recorder, part: Part) -> None:
        runs: dict[str, VehicleRun] = {}
        for name, bench in self._bench.vehicles.items():
            folder = self._out / name
            folder.mkdir(exist_ok=True)
            more = part if name == self._vehicle else _EndsWith(part)
            runs[name] = VehicleRun(bench, folder, parts_of(bench, [more], judged=False), quiet=True)
        nowhere = NoRecorder(self._bench.vehicles[self._vehicle].config.tick_ns)
        recorders = {name: recorder if name == self._vehicle else nowhere for name in runs}
        for_each(runs, lambda run: run.build(stack, recorders[run.context.bench.config.name]))
        flights = [Flight(run.context, name) for name, run in runs.items()]
        lockstep = Lockstep(
            flights,
            group_of(runs, self._bench),
            lambda truths: self._place(dict(zip(runs, truths, strict=True))),
            lambda _truths, _contacts: None,
        )
        fly_ticks(flights, quiet=True, step=lockstep.step)
        for_each({flight.name: runs[flight.name] for flight in flights if not flight.lost}, VehicleRun.raise_causes)
