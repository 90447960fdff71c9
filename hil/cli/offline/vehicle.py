"""`hil vehicle aero`: coefficients and polars of a vehicle's panels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error

vehicle = typer.Typer(no_args_is_help=True, help="Tools for vehicle files.")


@vehicle.callback()
def _vehicle() -> None:
    """Tools for vehicle files."""


@vehicle.command()
def aero(
    vehicle: Annotated[str, typer.Argument(help="A vehicle of rigs/vehicles, or a file.", metavar="FILE")],
    airspeed: Annotated[float, typer.Option(min=1.0, max=100.0, help="Airspeed of the coefficients [m/s].")] = 15.0,
    out: Annotated[Path, typer.Option(help="Folder of the table and the picture.", metavar="DIR")] = Path(),
    lattice: Annotated[
        bool | None,
        typer.Option(
            "--aerosandbox/--no-aerosandbox",
            help="With AeroSandbox's coefficients; default if it is installed.",
            show_default=False,
        ),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            help="CSV of the source: alpha_deg, CL, CD, Cm; default rigs/vehicles/polars/NAME.csv.", metavar="CSV"
        ),
    ] = None,
) -> None:
    """Print the derivatives of an aircraft by panels, and plot its polars."""
    from hil.apps.vehicle.command import vehicle_aero

    with exit_on_error():
        files = vehicle_aero(vehicle, console, airspeed_mps=airspeed, out=out, lattice=lattice, points=points)
    console.print(f"{files.table}  and its picture {files.picture}", markup=False)
