"""`hil video`: makes a film of a recorded run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import QuietOption, takes
from signals.words import counted


@dataclass(frozen=True)
class VideoCommandOptions:
    run_dir: Annotated[Path, typer.Argument(help="Folder of a run.", metavar="RUN_DIR")]
    view: Annotated[
        str, typer.Option(help="chase: from behind; a camera of the bench; split: both.", metavar="chase|CAMERA|split")
    ] = "chase"
    out: Annotated[Path | None, typer.Option(help="The MP4 file; default RUN_DIR/video.mp4.", metavar="FILE")] = None
    vehicle: Annotated[str, typer.Option(help="Vehicle that is followed; default the first.", metavar="NAME")] = ""
    size: Annotated[
        str | None, typer.Option(help="Size of the pictures in pixels; default 1280x720.", metavar="WxH")
    ] = None
    rate: Annotated[float, typer.Option(min=1.0, max=240.0, help="Pictures a second.")] = 30.0
    speed: Annotated[float, typer.Option(min=0.01, max=1000.0, help="2: twice as fast as the flight.")] = 1.0
    start: Annotated[float, typer.Option(min=0.0, help="Simulated time at which the film begins [s].")] = 0.0
    end: Annotated[float | None, typer.Option(min=0.0, help="Simulated time at which it ends [s].")] = None
    quiet: QuietOption = False


@takes(VideoCommandOptions)
def video(o: VideoCommandOptions) -> None:
    """Make an MP4 film of a recorded run: from behind the vehicle, from a camera on board, or both."""
    from hil.apps.video.command import VideoOptions, film_run

    next_s = 10.0

    def progress(t_s: float) -> None:
        nonlocal next_s
        if t_s >= next_s and not o.quiet:
            console.print(f"t = {t_s:6.1f} s", markup=False)
            next_s = t_s + 10.0

    with exit_on_error():
        options = VideoOptions(o.view, o.vehicle, o.size, o.rate, o.speed, o.start, o.end)
        path, pictures = film_run(o.run_dir, o.out, options, progress)
    console.print(f"{path}  {counted(pictures, 'picture')}", markup=False)
