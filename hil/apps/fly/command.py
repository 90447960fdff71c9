"""`hil run`: load a bench, fly it, print the result."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from hil.apps.fly.choice import BenchChoice
from hil.apps.fly.result_table import print_result
from hil.run.report.run_folder import guard_unbegun, new_run_dir, write_unbegun
from signals.errors import ConfigError, HilError
from signals.shortage import named

if TYPE_CHECKING:
    from collections.abc import Callable

    from hil.config import Bench
    from hil.run.bench_run import MoreParts, RunResult

    # Opens what follows a run (bench file, folder of the runs, console), and yields the maker of its parts.
    Follower = Callable[[Path | None, Path, Console], contextlib.AbstractContextManager[MoreParts]]


def fly(
    choice: BenchChoice,
    follower: Follower,
    console: Console,
    errors: Console,
    *,
    out: Path | None,
    runs: Path = Path("runs"),
    quiet: bool = False,
) -> int:
    """Fly and return the exit status of the run: 0 PASS, 1 FAIL, 3 ERROR.

    The results go to `out`, by default to a new folder in `runs`. Raises HilError if no run could begin; after a
    ConfigError there is no folder that was not there before.
    """
    began_s = time.monotonic()
    result: RunResult | None = None
    if out is not None:
        guard_unbegun(out, rig=choice.rig, scene=choice.scene, seed=choice.seed)
    try:
        bench, run_bench = _load(choice, out, runs)
        with (
            follower(choice.config, runs if out is None else out.parent, console) as parts,
            new_run_dir(out, bench.config.rig, runs) as folder,
        ):
            result = run_bench(bench, folder, quiet=quiet, more=parts)
            if result.config_error is not None:
                raise result.config_error
            print_result(result.run, folder, time.monotonic() - began_s, console, errors)
    except KeyboardInterrupt:
        if result is None:  # after the run Ctrl-C only ends the page
            raise
    except ConfigError as error:
        if out is not None and out.is_dir():  # an earlier result there must not pass for this run's
            with contextlib.suppress(HilError):
                write_unbegun(error, out, rig=choice.rig, scene=choice.scene, seed=choice.seed)
        raise
    return result.exit_status


def _load(choice: BenchChoice, out: Path | None, runs: Path) -> tuple[Bench, Callable[..., RunResult]]:
    """Load the bench, and the function that flies it, with MuJoCo and the kernels.

    A resource that ran out leaves a folder with a run.json that names it. Raises HilError.
    """
    try:
        bench = choice.load()
        from hil.run.bench_run import run_bench

        return bench, run_bench
    except Exception as error:
        told = named(error)
        if told is None or isinstance(told, ConfigError):
            raise
        with contextlib.suppress(HilError), new_run_dir(out, choice.rig or "unknown", runs) as folder:
            write_unbegun(told, folder, rig=choice.rig, scene=choice.scene, seed=choice.seed)
        raise told from None
