"""`hil run`: load a bench, fly it, print the result."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from hil.apps.fly.choice import BenchChoice
from hil.apps.fly.dashboard import DashboardLink
from hil.apps.fly.result_table import print_result
from hil.run.report.run_folder import guard_unbegun, new_run_dir, write_unbegun
from signals.errors import ConfigError, HilError
from signals.shortage import named

if TYPE_CHECKING:
    from hil.run.bench_run import RunResult


def fly(
    choice: BenchChoice,
    link: DashboardLink,
    console: Console,
    errors: Console,
    *,
    out: Path | None,
    runs: Path = Path("runs"),
    quiet: bool = False,
) -> int:
    """Fly and return the exit status of the run: 0 PASS, 1 FAIL, 3 ERROR.

    The results go to `out`, by default to a new folder in `runs`; after a ConfigError too there is a run.json. Raises
    HilError if no run could begin.
    """
    began_s = time.monotonic()
    if out is not None:
        guard_unbegun(out, rig=choice.rig, scene=choice.scene, seed=choice.seed)
    try:
        bench = choice.load()
    except Exception as error:
        told = named(error)
        if told is None:
            raise
        with contextlib.suppress(HilError):  # the error matters more than a folder that cannot be made
            folder = new_run_dir(out, choice.rig or "unknown", runs)
            write_unbegun(told, folder, rig=choice.rig, scene=choice.scene, seed=choice.seed)
        raise told from None
    from hil.run.bench_run import run_bench  # MuJoCo and the kernels, loaded only for a bench that can fly

    result: RunResult | None = None
    folder = new_run_dir(out, bench.config.rig, runs)
    try:
        with link.parts(choice.config, folder, console) as dashboard_parts:
            result = run_bench(bench, folder, quiet=quiet, more=dashboard_parts)
            with contextlib.suppress(OSError, ValueError):  # a closed pipe changes neither run.json nor the status
                print_result(result.run, folder, time.monotonic() - began_s, console, errors)
    except KeyboardInterrupt:
        if result is None:  # after the run Ctrl-C only ends the page
            raise
    except ConfigError as error:  # of a part, such as a package that is not installed
        with contextlib.suppress(HilError):
            write_unbegun(error, folder, rig=choice.rig, scene=choice.scene, seed=choice.seed)
        raise
    assert result is not None
    return result.exit_status
