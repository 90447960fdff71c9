"""`hil dataset`: options to a plan, a plan to a data set."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from hil.dataset.make import DatasetResult, Means, make_dataset
from hil.dataset.plan import make_plan
from hil.signals.errors import ConfigError, Problem, RecordingError

_MOST_WORKERS = 1024


def run_dataset(
    console: Console,
    config: Path | None,
    *,
    frames: int | None,
    out: Path,
    workers: int | None,
    resume: bool,
    quality: str | None,
    seed: int | None,
    settings: Sequence[str],
    quiet: bool,
) -> DatasetResult:
    """Make the data set and say how it went. Raises HilError."""
    if workers is not None and not 1 <= workers <= _MOST_WORKERS:
        raise ConfigError([Problem("--workers", f"must be 1 to {_MOST_WORKERS}, not {workers}")])
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
            result = make_dataset(plan, out, Means(workers or 0, resume, quiet))
        except KeyboardInterrupt as stop:
            text = str(stop) or "stopped from the keyboard"
            raise RecordingError(f"{text}; what was written is kept. Go on with: --out {out} --resume") from None
    steady = f", {result.steady_frames_per_s:.1f} a second once under way" if result.steady_frames_per_s else ""
    kept = f"; {result.found_batches} batches were there already" if result.found_batches else ""
    whole = result.frames / result.wall_s
    console.print(f"{result.frames} frames in {result.wall_s:.1f} s: {whole:.1f} a second in all{steady}{kept}")
    console.print(f"data set  {out}/  (index.html, dataset.json)", markup=False)
    return result
