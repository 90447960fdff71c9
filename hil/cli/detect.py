"""`hil detect`: data sets, training and judgement of the detector. Light: what works is loaded when it is asked to."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import QuietOption, console, told

DataSets = Annotated[list[Path], typer.Argument(help="Folders that `hil dataset` has written.", metavar="DATASET...")]

detect_app = typer.Typer(
    help="Detect things in pictures: train on data sets, judge, and make the data.", no_args_is_help=True
)


@detect_app.command()
def train(
    data_sets: DataSets,
    out: Annotated[Path, typer.Option(help="Folder for weights, curves and figures.")],
    epochs: Annotated[int, typer.Option(help="Times that each picture is seen.")] = 30,
    seed: Annotated[int, typer.Option(help="Of first weights, order and augmentation.")] = 1,
    batch: Annotated[int, typer.Option(help="Pictures a step.")] = 16,
    learning_rate: Annotated[float, typer.Option(help="At its highest.")] = 2e-3,
    threads: Annotated[int, typer.Option(help="Of PyTorch; another number, another rounding.")] = 2,
    precision: Annotated[
        str, typer.Option(help="fp32, or bf16, faster on processors that have it and other in the last bits.")
    ] = "fp32",
    least_objects: Annotated[int, typer.Option(help="Classes with fewer in the training pictures are left out.")] = 100,
    judge_every: Annotated[int, typer.Option(help="Epochs between two measurements on validation pictures.")] = 3,
    part: Annotated[str, typer.Option(help="Which of the pictures to train on: train, or all.")] = "train",
    validation: Annotated[
        list[Path] | None, typer.Option(help="Other data sets to choose by; default the set 'validation'.")
    ] = None,
    test: Annotated[
        list[Path] | None, typer.Option(help="Other data sets to judge by; default the set 'test'.")
    ] = None,
    weights: Annotated[Path | None, typer.Option(help="PyTorch weights to begin from, as far as they fit.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what a stopped one left in --out.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Train a detector on data sets, judge it and export it for the companion. Needs PyTorch."""
    from hil.detect.command import train_detector

    options = {
        "epochs": epochs,
        "seed": seed,
        "batch": batch,
        "learning_rate": learning_rate,
        "threads": threads,
        "precision": precision,
        "least_objects": least_objects,
        "judge_every": judge_every,
    }
    with told():
        path = train_detector(
            data_sets,
            console,
            out=out,
            options=options,
            part=part,
            validation=validation or (),
            test=test or (),
            weights=weights,
            resume=resume,
            quiet=quiet,
        )
    console.print(f"weights  {path}  (and curves.png, training.json)", markup=False)


@detect_app.command()
def evaluate(
    data_sets: DataSets,
    weights: Annotated[Path | None, typer.Option(help="A .onnx with its .json; default the shipped model.")] = None,
    part: Annotated[str, typer.Option(help="Which pictures: train, validation, test, all.")] = "test",
    backend: Annotated[str, typer.Option(help="opencv, onnxruntime or pytorch.")] = "opencv",
    threshold: Annotated[float | None, typer.Option(help="Where false boxes are counted; default the model's.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="The figures as JSON.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Average precision of a detector, class by class, and its false boxes."""
    from hil.detect.command import evaluate_detector

    with told():
        evaluate_detector(
            data_sets,
            console,
            weights=weights,
            part=part,
            backend=backend,
            threshold=threshold,
            json_file=json_file,
            quiet=quiet,
        )


@detect_app.command()
def data(
    out: Annotated[Path, typer.Option(help="Folder for the data sets, one folder each.")],
    sets: Annotated[int, typer.Option(help="How many worlds.", min=1)] = 84,
    frames: Annotated[int, typer.Option(help="Pictures of each.", min=1)] = 60,
    first_seed: Annotated[int, typer.Option(help="Of the series; maps, light and people differ by it.", min=0)] = 1000,
    people: Annotated[
        tuple[int, int] | None, typer.Option(help="Least and most, besides those of the map.", metavar="LEAST MOST")
    ] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="Kinds of map, in turn; default the three outdoor ones.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Data sets made at a time; default one a core.", min=1)] = None,
    quiet: QuietOption = False,
) -> None:
    """Make the data sets that the shipped detector is trained on and judged by."""
    from hil.detect.data_sets import SCENES, make_data_sets

    with told():
        folders = make_data_sets(
            out,
            console,
            sets=sets,
            frames=frames,
            first_seed=first_seed,
            jobs=jobs,
            scenes=scene or SCENES,
            people=people,
            quiet=quiet,
        )
    console.print(f"{len(folders)} data sets in {out}", markup=False)
