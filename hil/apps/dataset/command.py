"""`hil dataset`: plans and makes a data set from the command's options."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from hil.apps.dataset.make import DatasetResult, MakeOptions, make_dataset
from hil.apps.dataset.plan import make_plan
from hil.run.report.run_folder import new_run_dir
from signals.errors import ConfigError, Problem, RecordingError

_MAX_WORKERS = 1024


def run_dataset(
    console: Console,
    config: Path | None,
    out: Path | None,
    options: MakeOptions,
    *,
    frames: int | None,
    quality: str | None,
    seed: int | None,
    settings: Sequence[str],
) -> DatasetResult:
    """Make the data set, by default in a new folder of `runs`, and print frames, rate and place. Raises HilError."""
    if options.resume and out is None:
        raise ConfigError([Problem("--resume", "needs --out: the folder of the data set to continue")])
    out = new_run_dir(out, "dataset")
    if options.workers is not None and not 1 <= options.workers <= _MAX_WORKERS:
        raise ConfigError([Problem("--workers", f"must be 1 to {_MAX_WORKERS}, not {options.workers}")])
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as folder:
        plan = make_plan(
            config,
            frames=frames,
            quality=quality,
            seed=seed,
            settings=tuple(settings),
            work=lambda: Path(folder),
        )
        try:
            result = make_dataset(plan, out, options)
        except KeyboardInterrupt as stop:
            text = str(stop) or "stopped from the keyboard"
            raise RecordingError(f"{text}; everything written is kept. Continue with: --out {out} --resume") from None
    steady = f", {result.steady_frames_per_s:.1f} a second once under way" if result.steady_frames_per_s else ""
    kept = f"; {result.found_batches} batches were there already" if result.found_batches else ""
    overall = result.frames / result.wall_s
    console.print(f"{result.frames} frames in {result.wall_s:.1f} s: {overall:.1f} a second in all{steady}{kept}")
    console.print(f"data set  {out}/  (index.html, dataset.json)", markup=False)
    return result
