"""`hil dataset`: plans and makes a data set from the command's options."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from hil.apps.dataset.make import DatasetResult, MakeOptions, make_dataset
from hil.apps.dataset.plan import DatasetPlan
from hil.cluster.join import uses_ray
from hil.cluster.waiting import Say, said_on
from hil.config.checks.course_notes import course_notes
from hil.run.report.run_folder import new_run_dir
from signals.errors import ConfigError, RecordingError
from signals.processors import usable_processors
from signals.words import counted

NO_OBJECTS = "warning: no picture has a labelled object: look where the camera points, and at the course (index.html)"
_MAX_WORKERS = 1024


def run_dataset(
    console: Console,
    out: Path | None,
    options: MakeOptions,
    plan_in: Callable[[Path], DatasetPlan],
    *,
    engine: str = "local",
    address: str | None = None,
) -> DatasetResult:
    """Make the data set, by default in a new folder of `runs`, and print frames, rate and folder.

    Raises HilError; ConfigError, with the data set complete, for a sensor whose samples all show nothing.

    `plan_in` makes the plan; it may write files into the folder that it is given. `address` is that of a Ray cluster.
    """
    if options.resume and out is None:
        raise ConfigError.at("--resume", "needs --out: the folder of the data set to continue")
    if options.workers is not None and not 1 <= options.workers <= _MAX_WORKERS:
        raise ConfigError.at("--workers", f"must be 1 to {_MAX_WORKERS}, not {options.workers}")
    on_ray = uses_ray(engine, address)
    with ExitStack() as stack:
        plan = plan_in(Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hil-dataset-"))))
        for note in course_notes(plan.bench):
            console.print(f"warning: {note}", markup=False)
        if on_ray:
            options = _with_ray(options, plan, address, stack, said_on(console, quiet=options.quiet))
        out = stack.enter_context(new_run_dir(out, "dataset"))
        try:
            result = make_dataset(plan, out, options)
        except KeyboardInterrupt as interrupt:
            text = str(interrupt) or "stopped from the keyboard"
            raise RecordingError(f"{text}; everything written is kept. Continue with: --out {out} --resume") from None
    text = f"{counted(result.frames, 'frame')} in {result.wall_s:.1f} s: {result.frames / result.wall_s:.1f} frames/s"
    if result.steady_frames_per_s:
        text += f", {result.steady_frames_per_s:.1f} frames/s after the first batch"
    if result.kept_batches:
        text += f"; {result.kept_batches} batches of an earlier attempt were kept"
    if result.objects:
        text += f"; {result.objects} labelled objects"
    console.print(text)
    if result.objects == 0:
        console.print(NO_OBJECTS)
    for warning in result.warnings:
        console.print(f"warning: {warning}", markup=False)
    console.print(f"data set  {out}/  (index.html, dataset.json)", markup=False)
    if result.problems:
        raise ConfigError(list(result.problems))
    return result


def _with_ray(options: MakeOptions, plan: DatasetPlan, address: str | None, stack: ExitStack, say: Say) -> MakeOptions:
    """Join the cluster, before anything is written, and return the options that make the batches on it."""
    from hil.apps.dataset.engines.ray import RayWorkers, batch_tasks

    at_once = options.workers if address is not None else options.workers or usable_processors()
    tasks = batch_tasks(address=address, at_once=at_once, say=say)
    stack.callback(tasks.close)
    return replace(options, make_workers=lambda _, factory: RayWorkers(tasks, plan, factory))
