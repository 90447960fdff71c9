"""`hil view`: writes pictures of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import takes


@dataclass(frozen=True)
class ViewOptions:
    scene: Annotated[str, typer.Argument(help="Scene: a name (rigs/scenes/*.yaml) or a file.", metavar="SCENE")]
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default runs/view-<scene>.")] = None
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of a generated map; default the scene's own.")] = None
    at: Annotated[str | None, typer.Option(help="Position in metres.", metavar="X,Y,Z")] = None
    look: Annotated[
        str | None, typer.Option(help="Direction in degrees: from east to north, and downwards.", metavar="YAW,PITCH")
    ] = None
    size: Annotated[
        str | None, typer.Option(help="Size of the pictures in pixels; default 640x480.", metavar="WxH")
    ] = None
    quality: Annotated[str | None, typer.Option(help="low, medium, high, epic or cinematic.")] = None
    colour: Annotated[
        str | None, typer.Option(help="Renderer of the colour: native, egl, filament or path_traced.")
    ] = None
    variants: Annotated[
        int,
        typer.Option(min=0, max=64, help="Write one sheet with N randomised variants instead.", metavar="N"),
    ] = 0
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Set weather or randomize, e.g. weather.visibility_m=800.", metavar="KEY=VALUE"),
    ] = None


@takes(ViewOptions)
def view(o: ViewOptions) -> None:
    """Write pictures of a scene in every channel of a camera."""
    from hil.apps.view.command import ViewCamera, view_scene

    options = {"quality": o.quality, "colour": o.colour}
    chosen = [f"{key}={text}" for key, text in options.items() if text is not None]
    with exit_on_error():
        files = view_scene(
            o.scene,
            o.out,
            ViewCamera(o.at, o.look, o.size),
            seed=o.seed,
            variants=o.variants,
            settings=[*(o.settings or ()), *chosen],
        )
    console.print(f"{files[0]}  and {len(files) - 1} more pictures beside it", markup=False)
