"""Runs of a bench: with one vehicle, with several, or without a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from hil.config import Bench
from hil.run.part import Part
from hil.run.parts.catalog import parts_of, settled, shared_parts
from hil.run.recorder.no_recorder import NoRecorder
from hil.run.recorder.recorder import Recorder
from hil.run.report.run_folder import remove_earlier, run_folder
from hil.run.runs.fleet import Fleet, Place
from hil.run.runs.tick_loop import VehicleFailed
from hil.run.runs.vehicle_run import RunResult, VehicleRun
from signals.errors import HilError, RecordingError

__all__ = ["RunResult", "fly", "run_bench"]

MoreParts = Callable[[str], Sequence[Part]]


def _maker_of(more: Sequence[Part] | MoreParts, bench: Bench) -> MoreParts:
    """Return the maker of the parts that come with those of each vehicle: the caller's, then those that all share."""
    first = next(iter(bench.vehicles), "")
    shared = shared_parts(bench)

    def make(vehicle: str) -> list[Part]:
        own = more(vehicle) if callable(more) else more if vehicle == first else ()
        return [*own, *(part for maker in shared for part in maker(vehicle))]

    return make


def run_bench(bench: Bench, out: Path, *, quiet: bool = False, more: Sequence[Part] | MoreParts = ()) -> RunResult:
    """Fly `bench` and leave run.json, the recordings and the report in `out`.

    `more`: parts that the caller adds to those of the only or first vehicle, such as a dashboard, or a function that
    makes them for each vehicle by name (empty: the only one). A failure of the bench is a result (status ERROR), not an
    exception, so that run.json always exists. Raises RecordingError if `out` itself cannot be written or another run
    writes there, ConfigError if the settings of a part are invalid.
    """
    bench = settled(bench)
    with run_folder(out, bench.vehicles):
        configs = [own.config for own in bench.each_vehicle.values()]
        read = (path for config in configs for path in (config.follow.log, config.companion.trace))
        remove_earlier(out, bench.vehicles, [path for path in read if path is not None])
        if bench.vehicles:
            from hil.run.runs.group_run import GroupRun

            return GroupRun(bench, out, _maker_of(more, bench), quiet=quiet).result()
        run = VehicleRun(bench, out, parts_of(bench, _maker_of(more, bench)("")), quiet=quiet)
        run.mark_unfinished()
        if run.failure.error is None:
            run.failure.guard(Fleet({"": run}, quiet=quiet).run)
        return run.finish()


def fly(
    bench: Bench, out: Path, recorder: Recorder, part: Part, *, vehicle: str = "", place: Place = lambda _: None
) -> None:
    """Fly `bench` into `recorder`, without run.json, report and saved bench; `part` ends the flight.

    Of several vehicles `vehicle` is recorded and has the part, and `place` is called with all states of a tick before
    that tick is recorded. Nothing is measured or judged but crashes. Raises HilError, also for a crash, whatever
    `recorder` and `part` raise, and KeyboardInterrupt.
    """
    bench = settled(bench)
    runs: dict[str, VehicleRun] = {}
    for name, own in bench.each_vehicle.items():
        folder = out / name
        folder.mkdir(exist_ok=True)
        more = part if name == vehicle else _EndsWith(part)
        runs[name] = VehicleRun(own, folder, parts_of(own, [more], judged=False), quiet=True)
    fleet = Fleet(runs, quiet=True, downwash=bench.config.group.downwash, place=place)
    nowhere = NoRecorder(bench.each_vehicle[vehicle].config.tick_ns)
    try:
        with ExitStack() as stack:
            fleet.each(lambda run: run.build(stack, recorder if run is runs[vehicle] else nowhere))
            fleet.fly()
        fleet.each(VehicleRun.raise_causes, lost=False)
    except VehicleFailed as failed:
        cause = failed.__cause__
        assert cause is not None
        if isinstance(cause, HilError) and not isinstance(cause, RecordingError):
            raise HilError(f"{failed.name}: {cause}") from cause
        raise cause from None


class _EndsWith(Part):
    """Part that ends a flight together with that of another vehicle."""

    def __init__(self, other: Part) -> None:
        self._other = other

    def ended(self) -> bool:
        return self._other.ended()
