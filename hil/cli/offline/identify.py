"""`hil identify`: fits a vehicle to flight logs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import QuietOption, takes


@dataclass(frozen=True)
class IdentifyCommandOptions:
    vehicle: Annotated[
        str, typer.Option(help="The vehicle to begin with: a file, or a name of rigs/vehicles.", metavar="FILE")
    ]
    logs: Annotated[
        list[Path] | None,
        typer.Argument(help=".ulg, .bin, .csv, .parquet, run.mcap or its run folder.", metavar="LOG..."),
    ] = None
    fix: Annotated[
        list[str] | None, typer.Option(help="A value to keep, e.g. mass_kg=2.06. May be repeated.", metavar="KEY=VALUE")
    ] = None
    columns: Annotated[
        Path | None, typer.Option(help="Map of a table's columns, units and frames (YAML).", metavar="MAP")
    ] = None
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default identify-VEHICLE.", metavar="DIR")
    ] = None
    of: Annotated[str, typer.Option(help="Vehicle of a recording that has several.", metavar="NAME")] = ""
    horizon: Annotated[
        list[float] | None,
        typer.Option(min=1e-3, help="Horizon that decides the exit status, in seconds; default all. May be repeated."),
    ] = None
    excite: Annotated[
        bool, typer.Option("--excite", help="Write a mission that shows what the logs do not, and fit nothing.")
    ] = False
    room: Annotated[
        float, typer.Option(min=5.0, max=500.0, help="With --excite: half the side of the field in metres.")
    ] = 20.0
    ceiling: Annotated[float, typer.Option(min=5.0, max=120.0, help="With --excite: greatest height in metres.")] = 15.0
    home: Annotated[str, typer.Option(help="With --excite: where the mission starts.", metavar="LAT,LON")] = (
        "47.397742,8.545594"
    )
    quiet: QuietOption = False


@takes(IdentifyCommandOptions)
def identify(o: IdentifyCommandOptions) -> None:
    """Fit a vehicle to flight logs: a vehicle file with the deviation of every number, and a page.

    Exit status 1: the fitted vehicle predicts held-out flight worse than the one it began with.
    """
    from hil.apps.identify import command
    from hil.apps.identify.excite import Limits

    options = command.IdentifyOptions(o.vehicle, o.fix or (), o.columns, o.out, o.of, tuple(o.horizon or ()), o.quiet)
    with exit_on_error():
        if o.excite:
            limits = Limits(o.room, o.ceiling)
            files = command.excite(o.logs or (), options, console, limits=limits, home_deg=command.read_home(o.home))
            for script, plan in zip(files.scripts, files.plans, strict=True):
                console.print(f"{script}  flies {plan}", markup=False)
            return
        found = command.identify(command.named_logs(o.logs), options, console)
    console.print(f"{found.folder}/  (vehicle.yaml, report.html, identify.json)", markup=False)
    if found.worse:
        raise typer.Exit(1)
