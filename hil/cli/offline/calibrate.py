"""`hil calibrate radar`: fits a radar preset to a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error

calibrate = typer.Typer(no_args_is_help=True, help="Fit a sensor's preset to a recording of your own sensor.")


@calibrate.callback()
def _calibrate() -> None:
    """Fit a sensor's preset to a recording of your own sensor."""


@calibrate.command()
def radar(
    recording: Annotated[
        Path, typer.Argument(help=".npz (array adc) or .npy, with its .json beside it.", metavar="RECORDING")
    ],
    frames: Annotated[
        str | None, typer.Option(help="Frames to fit; default all.", metavar="FIRST:END", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File of the preset; default NAME.yaml.", metavar="FILE")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the preset; default the name of the recording.")] = None,
    keep_echoes: Annotated[
        bool, typer.Option("--keep-echoes", help="Do not remove the scene's reflectors from the fixed leakage pattern.")
    ] = False,
) -> None:
    """Fit leakage, noise and converter to a recording of an empty, still scene."""
    from hil.apps.calibrate.command import calibrate_radar

    with exit_on_error():
        files = calibrate_radar(recording, console, frames=frames, out=out, name=name, keep_echoes=keep_echoes)
    console.print(f"{files.preset}  and its picture {files.picture}", markup=False)
