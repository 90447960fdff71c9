"""`hil run`."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hil.cli.options import (
    ConfigArgument,
    DashHostOption,
    DashPortOption,
    MissionOption,
    OutOption,
    QuietOption,
    RigOption,
    SceneOption,
    SeedOption,
    SetOption,
    complain,
    console,
    error_console,
)
from hil.entry import CONFIG_STATUS, ERROR_STATUS
from hil.headline import print_result
from hil.run_folder import leave_config_error, new_run_dir
from hil.signals.errors import ConfigError, HilError

if TYPE_CHECKING:
    from hil.bench import RunResult
    from hil.dashboard.live_run import LiveRun


def run(
    config: ConfigArgument = None,
    rig: RigOption = None,
    scene: SceneOption = None,
    mission: MissionOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    settings: SetOption = None,
    quiet: QuietOption = False,
    dash: Annotated[bool, typer.Option("--dash", help="With a page in the browser that follows the flight.")] = False,
    dash_host: DashHostOption = "127.0.0.1",
    dash_port: DashPortOption = 8710,
    dash_fd: Annotated[int | None, typer.Option("--dash-fd", hidden=True)] = None,
    dash_pace: Annotated[float | None, typer.Option("--dash-pace", hidden=True, min=0.01, max=1000.0)] = None,
    dash_paused: Annotated[bool, typer.Option("--dash-paused", hidden=True)] = False,
    dash_runs: Annotated[Path, typer.Option("--dash-runs", hidden=True)] = Path("runs"),
) -> None:
    """Fly a mission on a rig and judge the flight."""
    began_s = time.monotonic()
    from hil.config import load_bench

    try:
        bench = load_bench(config, rig=rig, scene=scene, mission=mission, seed=seed, settings=settings or ())
    except ConfigError as error:
        complain(error)
        with contextlib.suppress(HilError):  # the message is out; no folder to leave run.json in is no second one
            leave_config_error(error, new_run_dir(out, rig or "unknown", dash_runs), rig=rig, scene=scene, seed=seed)
        raise typer.Exit(CONFIG_STATUS) from None
    from hil.bench import run_bench

    result: RunResult | None = None
    try:
        folder = new_run_dir(out, bench.config.rig, dash_runs)
        with contextlib.ExitStack() as stack:
            live: LiveRun | None = None
            if dash:
                from hil.dash_command import dashboard_beside

                runs = folder.resolve().parent
                live = stack.enter_context(dashboard_beside(config, console, host=dash_host, port=dash_port, runs=runs))
            elif dash_fd is not None:
                from hil.dash_command import live_on_fd

                live = live_on_fd(dash_fd, paused=dash_paused, pace=dash_pace)
                stack.callback(live.close)
            result = run_bench(bench, folder, quiet=quiet, live=live)
            with contextlib.suppress(OSError, ValueError):
                print_result(console, error_console, result.run, folder, time.monotonic() - began_s)
    except HilError as error:  # not even the folder could be written, or the page not be served
        complain(error)
        raise typer.Exit(ERROR_STATUS) from None
    except KeyboardInterrupt:
        if result is None:
            raise
    assert result is not None
    raise typer.Exit(result.exit_status)
