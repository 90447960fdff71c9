"""`hil radar`: processes recorded radar data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import QuietOption, takes


@dataclass(frozen=True)
class RadarOptions:
    target: Annotated[
        Path,
        typer.Argument(
            help="Folder of a run, its run.mcap, a recording (.npz or .npy with its .json), or a TI board's capture "
            "(.bin with mmWave Studio's .json).",
            metavar="RECORDING",
        ),
    ]
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default `radar` beside the data.")] = None
    preset: Annotated[
        str | None, typer.Option(help="Radar preset, by name or file; default the recorded radar's settings.")
    ] = None
    sensor: Annotated[str | None, typer.Option(help="Name of the radar if the recording has several.")] = None
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Override any key, e.g. --set processing.cfar.kind=ca.", metavar="KEY=VALUE"),
    ] = None
    from_s: Annotated[float | None, typer.Option("--from", help="Time of the first frame in seconds.", metavar="S")] = (
        None
    )
    until_s: Annotated[
        float | None, typer.Option("--until", help="Time of the last frame in seconds.", metavar="S")
    ] = None
    dca1000: Annotated[
        Path | None,
        typer.Option(
            help="Also write the raw frames as TI's DCA1000 does, with mmWave Studio's settings.", metavar="FILE.bin"
        ),
    ] = None
    quiet: QuietOption = False


@takes(RadarOptions)
def radar(o: RadarOptions) -> None:
    """Make maps, points and tracks from recorded radar data, or from pictures if no radar data was recorded."""
    from hil.apps.radar.command import Outputs, TimeSpan, process_radar

    with exit_on_error():
        files = process_radar(
            o.target,
            console,
            outputs=Outputs(o.out, o.dca1000),
            preset=o.preset,
            sensor=o.sensor,
            settings=o.settings or (),
            span=TimeSpan(o.from_s, o.until_s),
            quiet=o.quiet,
        )
    console.print(f"{files[0]}  and {len(files) - 1} more files beside it", markup=False)
