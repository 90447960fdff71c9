"""`hil detect evaluate`: measures a detector on data sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import console, exit_on_error
from hil.cli.offline.detect.options import DataSets
from hil.cli.options import QuietOption


def evaluate(
    data_sets: DataSets,
    weights: Annotated[Path | None, typer.Option(help="fast, good or a .onnx with its .json; default fast.")] = None,
    part: Annotated[str, typer.Option(help="Part of the pictures: train, validation, test or all.")] = "test",
    backend: Annotated[str, typer.Option(help="opencv, onnxruntime or pytorch.")] = "opencv",
    threshold: Annotated[
        float | None,
        typer.Option(help="Lowest score of a box that counts in recall, precision, false boxes; default the model's."),
    ] = None,
    smallest_px: Annotated[
        int | None,
        typer.Option("--smallest-px", help="Visible pixels that an object needs to count; default 64.", min=64),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures to this file.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Measure the average precision of a detector by class, and its false boxes (false positives)."""
    from hil.apps.detect.command import EvaluationData, evaluate_detector

    with exit_on_error():
        evaluate_detector(
            EvaluationData(data_sets, part, smallest_px),
            console,
            weights=weights,
            backend=backend,
            threshold=threshold,
            json_file=json_file,
            quiet=quiet,
        )
