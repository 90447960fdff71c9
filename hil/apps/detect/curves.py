"""Learning curves of a training, as a plot and as a table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from signals.errors import file_errors

if TYPE_CHECKING:
    from hil.apps.detect.training.train import Epoch

HEADER = ("epoch", "loss_scores", "loss_boxes", "learning_rate", "mean_average_precision", "person")


def write_table(epochs: Sequence[Epoch], path: Path) -> None:
    """Write one CSV row per epoch, columns `HEADER`. Raises RecordingError."""
    with file_errors(path), path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for e in epochs:
            precisions = ("", "")
            if e.evaluation is not None:
                precisions = (f"{e.evaluation.mean_average_precision:.4f}", _person_precision(e))
            losses = (f"{e.loss_scores:.4f}", f"{e.loss_boxes:.4f}", f"{e.learning_rate:.6f}")
            writer.writerow([e.number, *losses, *precisions])


def _person_precision(e: Epoch) -> str:
    people = e.evaluation.classes.get("person") if e.evaluation is not None else None
    return f"{people.average_precision:.4f}" if people is not None else ""


def draw(epochs: Sequence[Epoch], path: Path) -> None:
    """Plot the losses and the average precisions by epoch. Raises RecordingError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    loss_axes, precision_axes = figure.subplots(1, 2)
    numbers = [e.number for e in epochs]
    loss_axes.plot(numbers, [e.loss_scores for e in epochs], label="scores")
    loss_axes.plot(numbers, [e.loss_boxes for e in epochs], label="boxes")
    loss_axes.set(xlabel="epoch", ylabel="training loss", ylim=(0.0, None))
    loss_axes.legend()
    evaluated = [(e.number, e.evaluation) for e in epochs if e.evaluation is not None]
    precision_axes.plot(
        [n for n, _ in evaluated], [v.mean_average_precision for _, v in evaluated], "o-", label="all classes"
    )
    people = [(n, v.classes["person"].average_precision) for n, v in evaluated if "person" in v.classes]
    precision_axes.plot([n for n, _ in people], [v for _, v in people], "o-", label="person")
    precision_axes.set(xlabel="epoch", ylabel="average precision at IoU 0.5, validation", ylim=(0.0, 1.0))
    precision_axes.legend()
    with file_errors(path):
        figure.savefig(path, dpi=110)
