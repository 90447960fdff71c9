"""Make a data set from start to end, or resume one that was interrupted."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from hil.apps.dataset.batch_maker import BatchMakerFactory
from hil.apps.dataset.enclosed_sensors import EnclosedSensors
from hil.apps.dataset.engines.jobs import Workers
from hil.apps.dataset.engines.local import LocalWorkers
from hil.apps.dataset.finish import finish, silent_sensors
from hil.apps.dataset.flight import FlightData, fly_for_frames
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.moments import Batch
from hil.apps.dataset.pipeline import Pipeline
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.layout import sensor_files
from hil.apps.dataset.storage.manifest import (
    check_resumable,
    initial_manifest,
    provenance,
    require_empty,
    saved_bench,
    write_manifest,
)
from hil.apps.dataset.storage.store import DatasetStore, MakeCheckpoints
from hil.apps.dataset.storage.tables import Checkpoints
from hil.apps.dataset.storage.tree import TreeWriter, Written, locked, make_folder
from hil.run.runs.progress import CountProgress, minutes
from hil.run_files import BENCH_NAME
from signals.classes import Classes
from signals.errors import Problem
from signals.processors import usable_processors
from signals.words import counted


class FrameProgress(CountProgress):
    """Display of frames, rate and time left."""

    def __init__(
        self, total: int, *, quiet: bool, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__("dataset", total, quiet=quiet, stream=stream, clock=clock)
        self._first: tuple[float, int] | None = None  # time and frames at which the measurement of the rate began

    def text(self, done: int, now_s: float) -> str:
        """Return frames, rate and time left. The rate is measured from the first batch on, so it excludes take-off."""
        if self._first is None:
            self._first = (now_s, done)
            return f"{done} of {counted(self._total, 'frame')}"
        first_s, first_done = self._first
        rate = (done - first_done) / max(now_s - first_s, 1e-6)
        if rate <= 0.0:
            return f"{done} of {counted(self._total, 'frame')}"
        left_s = (self._total - done) / rate
        return f"{done} of {counted(self._total, 'frame')}, {rate:.1f} frames/s, {minutes(left_s)} left"


@dataclass(frozen=True)
class DatasetResult:
    """Outcome of `make_dataset`. `steady_frames_per_s` is measured from the first finished batch to the last.

    `warnings` and `problems` tell of sensors whose samples show nothing, some or all of them; `warnings` also of
    sensors without a sample, and of faults and gusts that no flight met.
    """

    out: Path
    frames: int
    kept_batches: int  # left complete by an earlier attempt
    steady_frames_per_s: float
    wall_s: float
    objects: int | None  # labelled in its pictures; None: it has no labelled pictures
    warnings: Sequence[str] = ()
    problems: Sequence[Problem] = ()


@dataclass(frozen=True)
class MakeOptions:
    """Options that do not change the bytes of a data set. Tests replace the two factories."""

    workers: int | None = None  # None: one per core
    resume: bool = False
    quiet: bool = False
    make_workers: Callable[[int, BatchMakerFactory], Workers] = LocalWorkers
    make_checkpoints: MakeCheckpoints = Checkpoints


def make_dataset(plan: DatasetPlan, root: Path, options: MakeOptions = MakeOptions()) -> DatasetResult:
    """Make the data set of `plan` in the folder `root`.

    Raises ConfigError if `root` cannot be used, RecordingError if it cannot be written, and HilError of the flight.
    After any error the files written so far are readable, and `resume` continues from them.
    """
    began_s = time.monotonic()
    bench_files = saved_bench(plan)
    made_from = provenance(plan, bench_files)
    if not options.resume:
        require_empty(root)
    make_folder(root)
    if options.resume:
        check_resumable(root, made_from, bench_files)
    with locked(root):
        return _DatasetMaker(plan, root, options, bench_files, made_from, began_s).make()


@dataclass
class _DatasetMaker:
    """Makes a data set in a folder that is checked and locked."""

    plan: DatasetPlan
    root: Path
    options: MakeOptions
    bench_files: Mapping[str, bytes]
    made_from: Mapping[str, Any]
    began_s: float

    def make(self) -> DatasetResult:
        """Write the files that workers need, start the workers and record."""
        plan, root, options = self.plan, self.root, self.options
        tree = TreeWriter(root)
        write_manifest(tree, initial_manifest(self.made_from))  # first: it makes the folder one that can be resumed
        # Written before the workers start, because a spawned worker reads them.
        files = [tree.write(name, data) for name, data in sorted(self.bench_files.items())]
        factory = BatchMakerFactory(plan, plan.frames, plan.quality, tree, vehicle=plan.vehicle)
        _ = plan.world  # made before the workers are forked, which then share it
        with (
            closing(options.make_workers(options.workers or usable_processors(), factory)) as workers,
            FrameProgress(plan.frames, quiet=options.quiet) as progress,
        ):
            return self._record(workers, files, progress)

    def _record(self, workers: Workers, files: list[Written], progress: FrameProgress) -> DatasetResult:
        plan, root, world = self.plan, self.root, self.plan.world
        classes = Classes(world.class_names, world.class_colours)
        tree = TreeWriter(root)
        files += [tree.write(name, text.encode()) for name, text in sorted(sensor_files(plan, classes).items())]
        bench = self.bench_files[f"{plan.vehicle}/{BENCH_NAME}" if plan.vehicle else BENCH_NAME]
        enclosed = EnclosedSensors(plan)
        store = DatasetStore.open(root, plan, bench, self.options.make_checkpoints)
        times: list[tuple[float, int]] = []

        def on_done(frames: int) -> None:
            times.append((time.monotonic(), frames))
            progress.show(frames)

        pipeline = Pipeline(store, workers, on_done=on_done)

        def on_batch(batch: Batch, data: FlightData) -> None:
            enclosed.add(batch)
            pipeline.add(batch, data)

        try:
            flights = fly_for_frames(plan, on_batch)
            pipeline.finish()
            catalogue = Catalogue.of_geoms(classes, np.asarray(world.geom_instance), np.asarray(world.geom_class))
            counts = finish(plan, store, pipeline.records, catalogue=catalogue, files=files, made_from=self.made_from)
            store.checkpoints.finish()
        except BaseException:
            pipeline.abandon()
            raise
        finally:
            store.close()
        (first_s, first_frames), (last_s, last_frames) = times[0], times[-1]
        rate = (last_frames - first_frames) / (last_s - first_s) if last_s > first_s else 0.0
        labelled = sum(sum(counts.values()) for record in pipeline.records for counts in record.objects)
        objects = None if plan.labelled is None else labelled
        wall_s = time.monotonic() - self.began_s
        warnings = [f"not in the data set: {one.text}" for one in flights.unmet or ()]
        warnings += silent_sensors(plan, counts, store.tables, pipeline.records) + enclosed.warnings()
        told = warnings, enclosed.problems()
        return DatasetResult(root, pipeline.frames, pipeline.kept_batches, rate, wall_s, objects, *told)
