"""The course of a training as a picture and as a table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hil.signals.errors import RecordingError

if TYPE_CHECKING:
    from hil.detect.train import Epoch

HEADER = ("epoch", "loss_scores", "loss_boxes", "learning_rate", "mean_average_precision", "person")


def write_table(epochs: Sequence[Epoch], path: Path) -> None:
    """One row an epoch. RecordingError."""
    try:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(HEADER)
            for e in epochs:
                judged = ("", "")
                if e.evaluation is not None:
                    judged = (f"{e.evaluation.mean_average_precision:.4f}", _person(e))
                losses = (f"{e.loss_scores:.4f}", f"{e.loss_boxes:.4f}", f"{e.learning_rate:.6f}")
                writer.writerow([e.number, *losses, *judged])
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error


def _person(e: Epoch) -> str:
    judged = e.evaluation.judged.get("person") if e.evaluation is not None else None
    return f"{judged.average_precision:.4f}" if judged is not None else ""


def draw(epochs: Sequence[Epoch], path: Path) -> None:
    """Losses, and average precision where it was measured. RecordingError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    numbers = [e.number for e in epochs]
    left.plot(numbers, [e.loss_scores for e in epochs], label="scores")
    left.plot(numbers, [e.loss_boxes for e in epochs], label="boxes")
    left.set(xlabel="epoch", ylabel="training loss", ylim=(0.0, None))
    left.legend()
    judged = [(e.number, e.evaluation) for e in epochs if e.evaluation is not None]
    right.plot([n for n, _ in judged], [v.mean_average_precision for _, v in judged], "o-", label="all classes")
    people = [(n, v.judged["person"].average_precision) for n, v in judged if "person" in v.judged]
    right.plot([n for n, _ in people], [v for _, v in people], "o-", label="person")
    right.set(xlabel="epoch", ylabel="average precision at IoU 0.5, validation", ylim=(0.0, 1.0))
    right.legend()
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error
