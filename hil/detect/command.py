"""What `hil detect train`, `evaluate` and `data` do once the command line is read. PyTorch is only loaded to train."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from hil.companion.started import use_client
from hil.signals.errors import ConfigError, Problem, RecordingError

if TYPE_CHECKING:
    from hil_companion.detect.model_file import ModelFile

    from hil.detect.evaluate import Evaluation
    from hil.detect.train import Epoch

NAME = "hil_ssdlite"  # of the files that a training writes


def train_detector(
    data_sets: Sequence[Path],
    console: Console,
    *,
    out: Path,
    options: dict[str, Any],
    part: str = "train",
    validation: Sequence[Path] = (),
    test: Sequence[Path] = (),
    weights: Path | None = None,
    resume: bool = False,
    quiet: bool = False,
) -> Path:
    """Train, judge and export; returns the .onnx. `options`: fields of `train.Settings`.

    Without `validation` and `test` folders these are the data sets' own parts. ConfigError, RecordingError.
    """
    use_client()
    try:
        from hil.detect import export
        from hil.detect.train import Settings, Training
    except ImportError as error:
        hint = "pip install 'hil-bench[train]', or torch alone; flying and evaluating need none of it"
        raise ConfigError([Problem("hil detect train", f"needs PyTorch ({error})", hint)]) from None
    from hil.detect import curves
    from hil.detect.picture_store import digest
    from hil.detect.pictures import read_data_sets

    settings = Settings(**options)
    pictures = read_data_sets(data_sets, part)
    if part == "all" and not validation:
        hint = "give data sets to choose by with --validation"
        raise ConfigError([Problem("--part all", "leaves no pictures of these data sets to judge by", hint)])
    judged = read_data_sets(validation, "all") if validation else read_data_sets(data_sets, "validation")
    tested = read_data_sets(test, "all") if test else [] if part == "all" else read_data_sets(data_sets, "test")
    training = Training(pictures, judged, settings, out=out)
    if weights is not None:
        taken, of = training.take_over(weights)
        console.print(f"{taken} of {of} tensors taken over from {weights}", markup=False)
    if resume and not training.resume():
        console.print(f"nothing to resume in {out}: it begins anew", markup=False)
    _make_folder(out)
    left = ", ".join(f"{n} ({c})" for n, c in training.left_out.items())
    console.print(f"{len(pictures)} pictures, {len(judged)} to judge by; classes: {', '.join(training.classes)}")
    if left:
        console.print(f"left out, fewer than {settings.least_objects} objects: {left}", markup=False)
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
        total = (settings.epochs - training.epochs_done) * steps
        task = progress.add_task("", total=total, epoch=training.epochs_done + 1, loss="")

        def step(number: int, _: int, loss: float) -> None:
            progress.update(task, advance=1, epoch=number, loss=f"loss {loss:.3f}")

        def told(one: Epoch) -> None:
            epochs.append(one)
            curves.write_table(epochs, out / "curves.csv")
            curves.draw(epochs, out / "curves.png")
            text = f"epoch {one.number}: loss {one.loss_scores:.3f} + {one.loss_boxes:.3f}"
            if one.evaluation is not None:
                text += f", mAP {one.evaluation.mean_average_precision:.3f}"
                people = one.evaluation.judged.get("person")
                text += f", person {people.average_precision:.3f}" if people is not None else ""
            progress.console.print(f"{text}  ({time.monotonic() - began_s:.0f} s)", markup=False)

        training.run(step=step, epoch=told)
    path = out / f"{NAME}.onnx"
    model = export.export(training.averaged, path, training.classes, threshold=0.5)
    on_validation = _evaluated(model, judged, "opencv", console, "validation", quiet=quiet)
    model = export.with_threshold(model, on_validation.threshold_for())
    result = _evaluated(model, tested, "opencv", console, "test", quiet=quiet) if tested else None
    if result is not None:
        _print(result, console, f"test, {len(tested)} pictures")
    record = {
        "settings": options,
        "part": part,
        "data_sets": [p.name for p in data_sets],
        "data_digest": digest(pictures),
        "pictures": len(pictures),
        "weights_digest": training.weights_digest(),
        "onnx_sha256": model.sha256,
        "left_out": training.left_out,
        "validation": on_validation.as_json(),
        "test": result.as_json() if result is not None else None,
    }
    _write(out / "training.json", record)
    return path


def evaluate_detector(
    data_sets: Sequence[Path],
    console: Console,
    *,
    weights: Path | None = None,
    part: str = "test",
    backend: str = "opencv",
    threshold: float | None = None,
    json_file: Path | None = None,
    quiet: bool = False,
) -> Evaluation:
    """Average precision of a model on data sets. ConfigError, RecordingError."""
    use_client()
    from dataclasses import replace

    from hil_companion.detect.model_file import ModelFile
    from hil_companion.errors import OptionError

    from hil.detect.pictures import read_data_sets

    try:
        model = ModelFile.load(weights)
    except OptionError as error:
        raise ConfigError([Problem("--weights", str(error))]) from None
    if threshold is not None:
        model = replace(model, score_threshold=threshold)
    pictures = read_data_sets(data_sets, part)
    result = _evaluated(model, pictures, backend, console, part, quiet=quiet)
    _print(result, console, f"{part}, {len(pictures)} pictures")
    if json_file is not None:
        _write(json_file, {"model": model.sha256, "backend": backend, **result.as_json()})
    return result


def _evaluated(
    model: ModelFile, pictures: Sequence[Any], backend: str, console: Console, what: str, *, quiet: bool
) -> Evaluation:
    from hil_companion.detect.detector import Detector
    from hil_companion.errors import CompanionError

    from hil.detect.evaluate import LOWEST_SCORE, evaluate

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        detector = Detector(model, backend, threshold=LOWEST_SCORE)
        with Progress(*columns, console=console, disable=quiet) as progress:
            task = progress.add_task("", total=len(pictures))
            return evaluate(detector, pictures, shown=lambda n: progress.update(task, completed=n))
    except CompanionError as error:
        raise ConfigError([Problem("detector", str(error))]) from None


def _print(result: Evaluation, console: Console, title: str) -> None:
    table = Table(title=title)
    for name in ("class", "objects", "AP@0.5", f"recall at {result.threshold:g}", "precision"):
        table.add_column(name, justify="left" if name == "class" else "right")
    rows = result.as_json()["classes"]
    for name, row in sorted(rows.items(), key=lambda r: (-(r[1]["average_precision"] or -1.0), r[0])):
        cells = [row["average_precision"], row["recall"], row["precision"]]
        table.add_row(name, str(row["objects"]), *("-" if c is None else f"{c:.3f}" for c in cells))
    console.print(table)
    console.print(
        f"mAP@0.5 of all classes {result.mean_average_precision:.3f}; "
        f"false boxes a picture at {result.threshold:g}: {result.false_boxes():.3f}"
    )


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be made ({error.strerror or error})") from error


def _write(path: Path, data: dict[str, Any]) -> None:
    try:
        path.write_text(json.dumps(data, indent=1) + "\n")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error
