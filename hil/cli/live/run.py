"""`hil run`: flies a mission and judges the flight."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, error_console, exit_on_error
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
    takes,
)


@dataclass(frozen=True)
class RunOptions:
    config: ConfigArgument = None
    rig: RigOption = None
    scene: SceneOption = None
    mission: MissionOption = None
    follow: Annotated[
        Path | None,
        typer.Option(
            help="Fly the set-points of a real flight, and compare both: .ulg, .bin, run.mcap or its run folder.",
            metavar="LOG",
        ),
    ] = None
    flight: Annotated[
        int | None, typer.Option(help="With --follow: which flight of a log with several, from 1.", min=1)
    ] = None
    seed: SeedOption = None
    out: OutOption = None
    settings: SetOption = None
    quiet: QuietOption = False
    print_command: Annotated[
        bool,
        typer.Option(
            "--print-command",
            help="Print the command that starts the SITL of this bench by hand, write its defaults file, and end.",
        ),
    ] = False
    dash: Annotated[bool, typer.Option("--dash", help="Serve a page in the browser that follows the flight.")] = False
    dash_host: DashHostOption = "127.0.0.1"
    dash_port: DashPortOption = 8710
    dash_fd: Annotated[int | None, typer.Option("--dash-fd", hidden=True)] = None
    dash_pace: Annotated[float | None, typer.Option("--dash-pace", hidden=True, min=0.01, max=1000.0)] = None
    dash_paused: Annotated[bool, typer.Option("--dash-paused", hidden=True)] = False
    dash_runs: Annotated[Path, typer.Option("--dash-runs", hidden=True)] = Path("runs")


@takes(RunOptions)
def run(o: RunOptions) -> None:
    """Fly a mission on a rig and judge the flight.

    Exit status: 0 PASS, 1 FAIL, 2 a wrong file or option, 3 ERROR or stopped by a signal (Ctrl-C). A run without a
    mission, goal, search or companion in control ends at a signal as at duration_s: 0, or 1 if a limit is missed.
    """
    from hil.apps.dash.run_link import DashboardLink
    from hil.apps.fly.choice import BenchChoice
    from hil.apps.fly.command import fly

    choice = BenchChoice(o.config, o.rig, o.scene, o.mission, o.seed, tuple(o.settings or ()), o.follow, o.flight)
    if o.print_command:
        from hil.run.autopilot import start_command

        with exit_on_error():
            console.print(start_command(choice.load(), o.out or Path()), markup=False)
        return
    link = DashboardLink(
        serve=o.dash, host=o.dash_host, port=o.dash_port, fd=o.dash_fd, pace=o.dash_pace, paused=o.dash_paused
    )
    with exit_on_error():
        status = fly(choice, link.parts, console, error_console, out=o.out, runs=o.dash_runs, quiet=o.quiet)
    raise typer.Exit(status)
