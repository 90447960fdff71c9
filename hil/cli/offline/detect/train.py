"""`hil detect train`: trains a detector on data sets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.offline.detect.options import DataSets
from hil.cli.options import QuietOption, options_of, takes


@dataclass(frozen=True)
class TrainOptions:
    data_sets: DataSets
    out: Annotated[Path, typer.Option(help="Folder for weights, curves and figures.")]
    epochs: Annotated[int, typer.Option(help="Passes over the pictures.")] = 30
    seed: Annotated[int, typer.Option(help="Seed of initial weights, order and augmentation.")] = 1
    batch: Annotated[int, typer.Option(help="Pictures per step.")] = 16
    learning_rate: Annotated[float, typer.Option(help="Highest learning rate.")] = 2e-3
    threads: Annotated[int, typer.Option(help="Threads of PyTorch; rounding depends on their number.")] = 2
    precision: Annotated[str, typer.Option(help="fp32 or bf16; bf16 is faster on processors that have it.")] = "fp32"
    min_objects: Annotated[int, typer.Option(help="Classes with fewer training objects are left out.")] = 100
    validate_every: Annotated[int, typer.Option(help="Epochs between two validations.")] = 3
    weak_epochs: Annotated[int, typer.Option(help="Last epochs, of weak augmentation; 0: a sixth.")] = 0
    input_px: Annotated[
        tuple[int, int],
        typer.Option("--input", help="Size of the network's input in pixels, multiples of 16.", metavar="WIDTH HEIGHT"),
    ] = (320, 240)
    part: Annotated[str, typer.Option(help="Part of the pictures to train on: train or all.")] = "train"
    validation: Annotated[
        list[Path] | None, typer.Option(help="Data sets for validation; default the part 'validation'.")
    ] = None
    test: Annotated[list[Path] | None, typer.Option(help="Data sets for the test; default the part 'test'.")] = None
    weights: Annotated[
        Path | None, typer.Option(help="Start from fast, good, a .onnx or a last.pt; what does not fit is ignored.")
    ] = None
    start_share: Annotated[
        float, typer.Option(help="Share of --weights in the result, 0 to 1; the rest is the training's.")
    ] = 0.0
    keep_classes: Annotated[
        bool, typer.Option("--keep-classes", help="Keep the classes of --weights, however few objects there are.")
    ] = False
    resume: Annotated[bool, typer.Option("--resume", help="Continue a stopped training in --out.")] = False
    quiet: QuietOption = False


@takes(TrainOptions)
def train(o: TrainOptions) -> None:
    """Train a detector on data sets, evaluate it and export it for the companion. Needs PyTorch."""
    from hil.apps.detect.command import TrainingData, train_detector
    from hil.apps.detect.training.settings import Settings

    with exit_on_error():
        settings = options_of(Settings, o)
        data = TrainingData(o.data_sets, o.part, o.validation or (), o.test or ())
        path = train_detector(
            data,
            settings,
            console,
            out=o.out,
            weights=o.weights,
            keep_classes=o.keep_classes,
            resume=o.resume,
            quiet=o.quiet,
        )
    console.print(f"weights  {path}  (and curves.png, training.json)", markup=False)
