"""`hil calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import console, told

calibrate_app = typer.Typer(no_args_is_help=True, help="A sensor's preset from a recording of your own sensor.")


@calibrate_app.callback()
def _calibrate() -> None:
    """A sensor's preset from a recording of your own sensor."""


@calibrate_app.command("radar")
def calibrate_radar(
    recording: Annotated[
        Path, typer.Argument(help=".npz (array adc) or .npy, with its .json beside it.", metavar="RECORDING")
    ],
    frames: Annotated[
        str | None, typer.Option(help="Which frames to fit; default all.", metavar="FIRST:END", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The preset; default NAME.yaml here.", metavar="FILE")] = None,
    name: Annotated[str | None, typer.Option(help="What to call it; default the recording's name.")] = None,
    keep_echoes: Annotated[
        bool, typer.Option("--keep-echoes", help="Leave the reflectors of the scene in the fixed pattern.")
    ] = False,
) -> None:
    """Fit leakage, noise and converter to a recording of an empty, still scene."""
    from hil.calibrate_command import calibrate_radar as fit_radar

    with told():
        files = fit_radar(recording, console, frames=frames, out=out, name=name, keep_echoes=keep_echoes)
    console.print(f"{files.preset}  and its picture {files.picture}", markup=False)
