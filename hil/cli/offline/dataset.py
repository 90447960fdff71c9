"""`hil dataset`: records a labelled data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.options import AddressOption, EngineOption, QuietOption, SeedOption, SetOption, takes
from hil.data_set_files import LABEL_FORMATS


@dataclass(frozen=True)
class DatasetOptions:
    config: Annotated[
        Path | None,
        typer.Argument(help="Bench file; default a loop through the city park, with all sensors.", metavar="[CONFIG]"),
    ] = None
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle to record, of a bench with several.", show_default=False)
    ] = None
    frames: Annotated[int | None, typer.Option(help="Number of frames; default 500.", show_default=False)] = None
    out: Annotated[Path | None, typer.Option(help="Folder of the data set; default runs/<time>-dataset.")] = None
    engine: EngineOption = "local"
    address: AddressOption = None
    workers: Annotated[
        int | None, typer.Option(help="Processes that render and write; default one per core.", show_default=False)
    ] = None
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted data set in --out.")] = False
    quality: Annotated[
        str | None, typer.Option(help="low, medium, high, epic or cinematic; default as in the file.")
    ] = None
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help=f"3-D labels beside EuRoC, VOC and COCO, of {', '.join(LABEL_FORMATS)}; may be given several times.",
            show_default=False,
        ),
    ] = None
    seed: SeedOption = None
    settings: SetOption = None
    quiet: QuietOption = False


@takes(DatasetOptions)
def dataset(o: DatasetOptions) -> None:
    """Fly and record labelled data of all sensors as EuRoC, VOC, COCO, KITTI and nuScenes files and as MCAP."""
    from hil.apps.dataset.command import run_dataset
    from hil.apps.dataset.make import MakeOptions
    from hil.apps.dataset.plan import DatasetPlan, make_plan

    def plan_in(folder: Path) -> DatasetPlan:
        return make_plan(
            o.config,
            vehicle=o.vehicle,
            frames=o.frames,
            quality=o.quality,
            seed=o.seed,
            settings=tuple(o.settings or ()),
            work=lambda: folder,
            formats=tuple(o.formats or ()),
        )

    options = MakeOptions(workers=o.workers, resume=o.resume, quiet=o.quiet)
    with exit_on_error():
        run_dataset(console, o.out, options, plan_in, engine=o.engine, address=o.address)
