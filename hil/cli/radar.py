"""`hil radar`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import QuietOption, console, told


def radar(
    target: Annotated[
        Path,
        typer.Argument(
            help="Folder of a run, its run.mcap, or a recording (.npz or .npy with its .json).", metavar="RECORDING"
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default `radar` beside the data.")] = None,
    preset: Annotated[
        str | None, typer.Option(help="Radar preset, by name or file; default the recorded radar's settings.")
    ] = None,
    sensor: Annotated[str | None, typer.Option(help="Which radar, where the recording has several.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Override any key, e.g. --set processing.cfar.kind=ca.", metavar="KEY=VALUE"),
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", help="First time of the frames taken [s].", metavar="S")
    ] = None,
    until_s: Annotated[float | None, typer.Option("--until", help="Last time of them [s].", metavar="S")] = None,
    quiet: QuietOption = False,
) -> None:
    """Radar data of a recording to maps, points and tracks; without radar data, made from its pictures."""
    from hil.radar_command import process_radar

    with told():
        files = process_radar(
            target,
            console,
            out=out,
            preset=preset,
            sensor=sensor,
            settings=settings or (),
            from_s=from_s,
            until_s=until_s,
            quiet=quiet,
        )
    console.print(f"{files[0]}  and {len(files) - 1} more files beside it", markup=False)
