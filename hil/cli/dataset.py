"""`hil dataset`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import QuietOption, SeedOption, SetOption, console, told
from hil.run_folder import new_run_dir
from hil.signals.errors import ConfigError, Problem


def dataset(
    config: Annotated[
        Path | None,
        typer.Argument(help="Bench file; default a square over the city park, with all sensors.", metavar="[CONFIG]"),
    ] = None,
    frames: Annotated[int | None, typer.Option(help="How many; default 500.", show_default=False)] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for it; default runs/<time>-dataset.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that draw and write; default one a core.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what an interrupted one left in --out.")] = False,
    quality: Annotated[
        str | None, typer.Option(help="low, medium, high, epic, cinematic; default as the file says.")
    ] = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    quiet: QuietOption = False,
) -> None:
    """Fly, and record labelled data of all sensors: EuRoC, VOC and COCO files, and an MCAP of it all."""
    from hil.dataset.command import run_dataset

    with told():
        if resume and out is None:
            raise ConfigError([Problem("--resume", "needs --out: the folder to go on with")])
        run_dataset(
            console,
            config,
            frames=frames,
            out=new_run_dir(out, "dataset"),
            workers=workers,
            resume=resume,
            quality=quality,
            seed=seed,
            settings=settings or (),
            quiet=quiet,
        )
