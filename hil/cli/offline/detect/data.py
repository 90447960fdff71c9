"""`hil detect data`: makes the data sets of the shipped detector."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import QuietOption, options_of, takes


@dataclass(frozen=True)
class DataOptions:
    out: Annotated[Path, typer.Option(help="Folder for the data sets, each in a folder of its own.")]
    sets: Annotated[int, typer.Option(help="Number of data sets.", min=1)] = 84
    frames: Annotated[int, typer.Option(help="Pictures of each data set.", min=1)] = 60
    first_seed: Annotated[
        int, typer.Option(help="First seed of the series; maps, light and people depend on it.", min=0)
    ] = 1000
    people: Annotated[
        tuple[int, int] | None,
        typer.Option(help="Range of the number of people added to the map.", metavar="MIN MAX"),
    ] = None
    objects: Annotated[
        tuple[int, int] | None,
        typer.Option(help="Range of the number of still objects added to the map; default none.", metavar="MIN MAX"),
    ] = None
    scene: Annotated[list[str] | None, typer.Option(help="Scenes to take in turn; default the three outdoor ones.")] = (
        None
    )
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(help="Size of the pictures in pixels; default that of the bench file.", metavar="WIDTH HEIGHT"),
    ] = None
    quality: Annotated[
        str | None,
        typer.Option(help="low, medium, high, epic or cinematic, for all data sets; default one of three for each."),
    ] = None
    jobs: Annotated[int | None, typer.Option(help="Data sets made at once; default one per core.", min=1)] = None
    quiet: QuietOption = False


@takes(DataOptions)
def data(o: DataOptions) -> None:
    """Make the data sets on which the shipped detector is trained and tested."""
    from hil.apps.detect.data_sets import SCENES, DataSetSeries, make_data_sets

    with exit_on_error():
        series = options_of(DataSetSeries, o, scenes=o.scene or SCENES, size_px=o.size)
        folders = make_data_sets(o.out, console, series, jobs=o.jobs, quiet=o.quiet)
    console.print(f"{len(folders)} data sets in {o.out}", markup=False)
