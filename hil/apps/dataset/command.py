"""`hil dataset`: plans and makes a data set from the command's options."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from hil.apps.dataset.make import DatasetResult, MakeOptions, make_dataset
from hil.apps.dataset.plan import DatasetPlan
from hil.run.report.run_folder import new_run_dir
from signals.errors import ConfigError, Problem, RecordingError

_MAX_WORKERS = 1024


def run_dataset(
    console: Console, out: Path | None, options: MakeOptions, plan_in: Callable[[Path], DatasetPlan]
) -> DatasetResult:
    """Make the data set, by default in a new folder of `runs`, and print frames, rate and folder. Raises HilError.

    `plan_in` makes the plan; it may write files into the folder that it is given.
    """
    if options.resume and out is None:
        raise ConfigError([Problem("--resume", "needs --out: the folder of the data set to continue")])
    out = new_run_dir(out, "dataset")
    if options.workers is not None and not 1 <= options.workers <= _MAX_WORKERS:
        raise ConfigError([Problem("--workers", f"must be 1 to {_MAX_WORKERS}, not {options.workers}")])
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as folder:
        plan = plan_in(Path(folder))
        try:
            result = make_dataset(plan, out, options)
        except KeyboardInterrupt as interrupt:
            text = str(interrupt) or "stopped from the keyboard"
            raise RecordingError(f"{text}; everything written is kept. Continue with: --out {out} --resume") from None
    text = f"{result.frames} frames in {result.wall_s:.1f} s: {result.frames / result.wall_s:.1f} frames/s"
    if result.steady_frames_per_s:
        text += f", {result.steady_frames_per_s:.1f} frames/s after the first batch"
    if result.kept_batches:
        text += f"; {result.kept_batches} batches of an earlier attempt were kept"
    console.print(text)
    console.print(f"data set  {out}/  (index.html, dataset.json)", markup=False)
    return result
