"""`hil view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import console, told


def view(
    scene: Annotated[str, typer.Argument(help="Scene: a name (rigs/scenes/*.yaml) or a file.", metavar="SCENE")],
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default runs/view-<scene>.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of a generated map; default the scene's own.")] = None,
    at: Annotated[str | None, typer.Option(help="Where to stand, in metres.", metavar="X,Y,Z")] = None,
    look: Annotated[
        str | None, typer.Option(help="Degrees from east to north, and downwards.", metavar="YAW,PITCH")
    ] = None,
    size: Annotated[str | None, typer.Option(help="Pixels; default 640x480.", metavar="WxH")] = None,
    quality: Annotated[str | None, typer.Option(help="low, medium, high, epic or cinematic.")] = None,
    variants: Annotated[
        int, typer.Option(min=0, max=64, help="One sheet of so many seeds of `randomize` instead.", metavar="N")
    ] = 0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="weather or randomize, e.g. --set weather.visibility_m=800.", metavar="KEY=VALUE"),
    ] = None,
) -> None:
    """Pictures of a scene in every channel that a camera can have."""
    from hil.view_command import view_scene

    with told():
        chosen = [*(settings or ()), *([f"quality={quality}"] if quality is not None else ())]
        files = view_scene(scene, out, seed=seed, at=at, look=look, size=size, variants=variants, settings=chosen)
    console.print(f"{files[0]}  and {len(files) - 1} more pictures beside it", markup=False)
