"""Runs of a bench: with one vehicle, with several, or without a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from hil.config import Bench
from hil.run.part import Part
from hil.run.parts.catalog import parts_of
from hil.run.recorder.recorder import Recorder
from hil.run.report.run_folder import run_folder
from hil.run.runs.vehicle_run import RunResult, VehicleRun

__all__ = ["RunResult", "fly", "run_bench"]

MoreParts = Callable[[str], Sequence[Part]]


def _no_parts(vehicle: str) -> Sequence[Part]:  # noqa: ARG001
    return ()


def run_bench(bench: Bench, out: Path, *, quiet: bool = False, more: MoreParts = _no_parts) -> RunResult:
    """Fly `bench` and leave run.json, the recordings and the report in `out`.

    `more` makes the parts that the caller adds to those of the bench, such as a dashboard, for each vehicle by name;
    the name is empty in a bench with one vehicle. A failure of the bench is a result (status ERROR), not an exception,
    so that run.json always exists. Raises RecordingError if `out` itself cannot be written or another run writes there,
    ConfigError if the settings of a part are invalid.
    """
    with ExitStack() as folders:
        for folder in (out, *(out / name for name in bench.vehicles)):
            folders.enter_context(run_folder(folder))
        if bench.vehicles:
            from hil.run.runs.group_run import GroupRun

            return GroupRun(bench, out, more, quiet=quiet).result()
        return VehicleRun(bench, out, parts_of(bench, more("")), quiet=quiet).result()


def fly(bench: Bench, out: Path, recorder: Recorder, part: Part) -> None:
    """Fly `bench` into `recorder`, without run.json, report and saved bench; `part` ends the flight.

    Nothing is measured or judged. Raises HilError, whatever `recorder` and `part` raise, and KeyboardInterrupt.
    """
    run = VehicleRun(bench, out, parts_of(bench, [part], judged=False), quiet=True)
    with ExitStack() as stack:
        run.build(stack, recorder)
        run.fly()
