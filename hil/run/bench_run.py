"""Runs of a bench: with one vehicle, with several, or without a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from hil.config import Bench
from hil.run.part import Part
from hil.run.parts.catalog import parts_of, shared_parts
from hil.run.recorder.recorder import Recorder
from hil.run.report.run_folder import run_folder
from hil.run.runs.vehicle_run import RunResult, VehicleRun

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
    with run_folder(out, bench.vehicles):
        if bench.vehicles:
            from hil.run.runs.group_run import GroupRun

            return GroupRun(bench, out, _maker_of(more, bench), quiet=quiet).result()
        return VehicleRun(bench, out, parts_of(bench, _maker_of(more, bench)("")), quiet=quiet).result()


def fly(bench: Bench, out: Path, recorder: Recorder, part: Part) -> None:
    """Fly `bench` into `recorder`, without run.json, report and saved bench; `part` ends the flight.

    Nothing is measured or judged but crashes. Raises HilError, also for a crash, whatever `recorder` and `part` raise,
    and KeyboardInterrupt.
    """
    run = VehicleRun(bench, out, parts_of(bench, [part], judged=False), quiet=True)
    with ExitStack() as stack:
        run.build(stack, recorder)
        run.fly()
    run.raise_causes()
