"""`hil detect train` and `hil detect evaluate`. PyTorch is imported only to train."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from hil.config.companion.clients import make_client_importable
from hil.run.report.run_folder import locked_folder
from signals.errors import ConfigError, file_errors
from signals.words import counted

if TYPE_CHECKING:
    from hil_companion.detect.model_file import ModelFile

    from hil.apps.detect.evaluate import Evaluation
    from hil.apps.detect.pictures import Picture
    from hil.apps.detect.training.settings import Settings
    from hil.apps.detect.training.train import Epoch, Training

NAME = "hil_ssdlite"  # stem of the model files that a training writes


@dataclass(frozen=True)
class TrainingData:
    """Folders of data sets for training, validation and test.

    Without `validation` or `test` folders, the parts of that name of `data_sets` are used.
    """

    data_sets: Sequence[Path]
    part: str = "train"  # of `data_sets`: train, or all
    validation: Sequence[Path] = ()
    test: Sequence[Path] = ()

    def read(self) -> tuple[Sequence[Picture], Sequence[Picture], Sequence[Picture]]:
        """Return the pictures for training, validation and test (none with part `all`). Raises ConfigError."""
        from hil.apps.detect.pictures import read_data_sets

        pictures = read_data_sets(self.data_sets, self.part)
        if self.part == "all" and not self.validation:
            hint = "give data sets for validation with --validation"
            raise ConfigError.at("--part all", "leaves no pictures of these data sets for validation", hint)

        def of(given: Sequence[Path], part: str) -> Sequence[Picture]:
            return read_data_sets(given, "all") if given else read_data_sets(self.data_sets, part)

        validation = of(self.validation, "validation")
        return pictures, validation, [] if self.part == "all" and not self.test else of(self.test, "test")


def overlap_notes(trained: Sequence[Picture], **judged: Sequence[Picture]) -> list[str]:
    """Describe pictures that are trained on and judge the training, too, by what they judge: its figures are too good.

    They are told by their files.
    """
    known = {p.path.resolve() for p in trained}
    counts = {name: sum(p.path.resolve() in known for p in pictures) for name, pictures in judged.items()}
    return [
        f"{name}: {count} of {counted(len(judged[name]), 'picture')} are trained on, too: its figures are too good"
        for name, count in counts.items()
        if count
    ]


@dataclass(frozen=True)
class EvaluationData:
    """Folders of data sets, and what of them counts: `part`, and objects of at least `smallest_px` visible pixels."""

    data_sets: Sequence[Path]
    part: str = "test"
    smallest_px: int | None = None  # None: as the data sets say

    def read(self) -> Sequence[Picture]:
        """Return the pictures. Raises ConfigError."""
        from hil.apps.detect.pictures import read_data_sets, with_smallest

        pictures = read_data_sets(self.data_sets, self.part)
        return pictures if self.smallest_px is None else with_smallest(pictures, self.smallest_px)


def train_detector(
    data: TrainingData,
    settings: Settings,
    console: Console,
    *,
    out: Path,
    weights: Path | None = None,
    keep_classes: bool = False,
    resume: bool = False,
    quiet: bool = False,
) -> Path:
    """Train, export and evaluate a detector, and return its .onnx file.

    `weights`: a model or checkpoint to start from; with `keep_classes` the detector has its classes. Raises ConfigError
    for unusable data or weights, RecordingError if a file cannot be written.
    """
    make_client_importable()
    try:
        from hil.apps.detect.training import export
        from hil.apps.detect.training.start_weights import read_start_weights
        from hil.apps.detect.training.train import Training
    except ImportError as error:
        hint = "pip install 'hil-bench[train]', or torch alone; flying and evaluating work without it"
        raise ConfigError.at("hil detect train", f"needs PyTorch ({error})", hint) from None
    from hil.apps.detect.picture_store import digest

    pictures, validation, test = data.read()
    for note in overlap_notes(pictures, validation=validation, test=test):
        console.print(f"warning: {note}", markup=False)
    classes: tuple[str, ...] = ()
    if keep_classes:
        classes = () if weights is None else read_start_weights(weights).classes
        if not classes:
            hint = "give a model or a last.pt with --weights"
            raise ConfigError.at("--keep-classes", "needs weights whose classes are known", hint)
    training = Training(pictures, validation, settings, out=out, classes=classes)
    if weights is None and settings.start_share:
        raise ConfigError.at("--start-share", "needs weights to start from", "give them with --weights")
    if weights is not None:
        loaded, total = training.load_weights(weights)
        console.print(f"{loaded} of {total} tensors loaded from {weights}", markup=False)
    with locked_folder(out):
        if resume and not training.resume():
            console.print(f"nothing to resume in {out}: starting from the beginning", markup=False)
        left_out = ", ".join(f"{n} ({c})" for n, c in training.left_out.items())
        console.print(
            f"{counted(len(pictures), 'picture')}, {len(validation)} for validation; "
            f"classes: {', '.join(training.classes)}",
            markup=False,
        )
        if left_out:
            console.print(f"left out, fewer than {settings.min_objects} objects: {left_out}", markup=False)
        _run_training(training, settings.epochs, console, out, quiet=quiet)
        path = out / f"{NAME}.onnx"
        model = export.export(training.result, path, training.classes, threshold=0.5, input_px=settings.input_px)
        validation_result = _run_evaluation(model, validation, "opencv", console, "validation", quiet=quiet)
        model = export.with_threshold(model, validation_result.threshold_for())
        test_result = _run_evaluation(model, test, "opencv", console, "test", quiet=quiet) if test else None
        if test_result is not None:
            _print_table(test_result, console, f"test, {counted(len(test), 'picture')}")
        record = {
            "settings": asdict(settings),
            "part": data.part,
            "data_sets": [p.name for p in data.data_sets],
            "data_digest": digest(pictures),
            "pictures": len(pictures),
            "weights_digest": training.weights_digest(),
            "onnx_sha256": model.sha256,
            "left_out": training.left_out,
            "validation": validation_result.as_json(),
            "test": test_result.as_json() if test_result is not None else None,
        }
        _write_json(out / "training.json", record)
        return path


def _run_training(training: Training, last_epoch: int, console: Console, out: Path, *, quiet: bool) -> None:
    """Train to the end, with a line on the console and a row of the curves in `out` for each epoch."""
    from hil.apps.detect import curves

    epochs: list[Epoch] = []
    began_s = time.monotonic()
    columns = (
        TextColumn("epoch {task.fields[epoch]}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[loss]}"),
    )
    bar = Progress(*columns, TimeRemainingColumn(), console=console, disable=quiet)
    with bar as progress:
        steps = len(training.batches)
        total = (last_epoch - training.epochs_done) * steps
        task = progress.add_task("", total=total, epoch=training.epochs_done + 1, loss="")

        def step(number: int, _: int, loss: float) -> None:
            progress.update(task, advance=1, epoch=number, loss=f"loss {loss:.3f}")

        def report(epoch: Epoch) -> None:
            epochs.append(epoch)
            curves.write_table(epochs, out / "curves.csv")
            curves.draw(epochs, out / "curves.png")
            text = f"epoch {epoch.number}: loss {epoch.loss_scores:.3f} + {epoch.loss_boxes:.3f}"
            if epoch.evaluation is not None:
                text += f", mAP {epoch.evaluation.mean_average_precision:.3f}"
                people = epoch.evaluation.classes.get("person")
                text += f", person {people.average_precision:.3f}" if people is not None else ""
            progress.console.print(f"{text}  ({time.monotonic() - began_s:.0f} s)", markup=False)

        training.run(on_step=step, on_epoch=report)


def evaluate_detector(
    data: EvaluationData,
    console: Console,
    *,
    weights: Path | None = None,
    backend: str = "opencv",
    threshold: float | None = None,
    json_file: Path | None = None,
    quiet: bool = False,
) -> Evaluation:
    """Evaluate a model on data sets, print and return the result.

    Raises ConfigError for an unusable model or data set, RecordingError if `json_file` cannot be written.
    """
    make_client_importable()
    from hil_companion.detect.model_file import ModelFile
    from hil_companion.errors import OptionError

    try:
        model = ModelFile.load(weights)
    except OptionError as error:
        raise ConfigError.at("--weights", str(error)) from None
    if threshold is not None:
        model = replace(model, score_threshold=threshold)
    pictures = data.read()
    result = _run_evaluation(model, pictures, backend, console, data.part, quiet=quiet)
    _print_table(result, console, f"{data.part}, {counted(len(pictures), 'picture')}")
    if json_file is not None:
        _write_json(json_file, {"model": model.sha256, "backend": backend, **result.as_json()})
    return result


def _run_evaluation(
    model: ModelFile, pictures: Sequence[Any], backend: str, console: Console, title: str, *, quiet: bool
) -> Evaluation:
    from hil_companion.detect.detector import Detector
    from hil_companion.errors import CompanionError

    from hil.apps.detect.evaluate import LOWEST_SCORE, evaluate

    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        detector = Detector(model, backend, threshold=LOWEST_SCORE)
        with Progress(*columns, console=console, disable=quiet) as progress:
            task = progress.add_task("", total=len(pictures))
            return evaluate(detector, pictures, on_done=lambda n: progress.update(task, completed=n))
    except CompanionError as error:
        raise ConfigError.at("detector", str(error)) from None


def _print_table(result: Evaluation, console: Console, title: str) -> None:
    table = Table(title=title)
    for name in ("class", "objects", "AP@0.5", f"recall at {result.threshold:g}", "precision"):
        table.add_column(name, justify="left" if name == "class" else "right")
    rows = result.as_json()["classes"]
    for name, row in sorted(rows.items(), key=lambda r: (-(r[1]["average_precision"] or -1.0), r[0])):
        cells = [row["average_precision"], row["recall"], row["precision"]]
        table.add_row(name, str(row["objects"]), *("-" if c is None else f"{c:.3f}" for c in cells))
    console.print(table)
    if result.others:
        others = ", ".join(f"{name} ({count})" for name, count in result.others.items())
        console.print(f"not evaluated, classes that the model does not have: {others}", markup=False)
    false_boxes = f"false boxes per picture at {result.threshold:g}: {result.false_boxes():.3f}"
    if math.isnan(result.mean_average_precision):
        console.print(
            f"warning: no picture has an object of the model's classes: only false boxes count; {false_boxes}"
        )
    else:
        console.print(f"mAP@0.5 of the model's classes {result.mean_average_precision:.3f}; {false_boxes}")


def _write_json(path: Path, data: dict[str, Any]) -> None:
    with file_errors(path):
        path.write_text(json.dumps(data, indent=1) + "\n")
