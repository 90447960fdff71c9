"""Making a data set from beginning to end, or going on with one that was interrupted."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil.config import load_bench
from hil.dataset.checkpoint import Checkpoints
from hil.dataset.chunk_places import ChunkPlaces
from hil.dataset.drawing import BatchDrawer
from hil.dataset.finish import finish
from hil.dataset.flight import fly_for_frames
from hil.dataset.folder_lock import locked
from hil.dataset.folder_spread import make_apart
from hil.dataset.formats.labels import Catalogue
from hil.dataset.journal import BatchRecord, JournalWriter, read_journal
from hil.dataset.layout import big_folders, headers, sensor_files
from hil.dataset.manifest import (
    BENCH_NAME,
    check_resumable,
    first_manifest,
    made_from,
    refuse_full,
    saved_bench,
    write_manifest,
)
from hil.dataset.pipeline import AHEAD, Pipeline
from hil.dataset.plan import DatasetPlan
from hil.dataset.progress import FrameProgress
from hil.dataset.recording import DatasetRecording, part_path
from hil.dataset.tables import Tables
from hil.dataset.tree import JOURNAL, NURSERY, WORK, TreeWriter, Written, make_folder
from hil.dataset.workers import Job, Made, Maker, Workers
from hil.signals.classes import Classes


@dataclass(frozen=True)
class DatasetResult:
    """What came of it."""

    out: Path
    frames: int
    found_batches: int  # that were there already
    steady_frames_per_s: float  # from the first batch that came back to the last
    wall_s: float


@dataclass(frozen=True)
class Means:
    """How it is made; nothing of it changes what is made."""

    workers: int = 0  # 0: one a core
    resume: bool = False
    quiet: bool = False
    make_workers: Callable[[int, Callable[[], Maker]], Workers] = Workers
    make_checkpoints: Callable[[Path], Checkpoints] = Checkpoints


@dataclass
class DrawerFactory:
    """Makes what a worker works with. A process that was not forked loads the bench saved in the data set."""

    plan: DatasetPlan | None
    frames: int
    quality: str
    root: Path
    places: ChunkPlaces | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "plan": None, "places": None}

    def __call__(self) -> Maker:
        return BatchWork(self.drawer(), self.root, self.places)

    def drawer(self) -> BatchDrawer:
        plan = self.plan or DatasetPlan(load_bench(self.root / BENCH_NAME), self.frames, self.quality)
        return BatchDrawer(plan, self.root)


class BatchWork:
    """Does jobs: what is there and whole is left, the rest is made."""

    def __init__(self, drawer: BatchDrawer, root: Path, places: ChunkPlaces | None) -> None:
        self._drawer, self._root, self._places = drawer, root, places

    def __call__(self, job: Job) -> Made:
        before = job.expected
        if before is not None and self._drawer.is_whole(before, part_path(self._root), job.offset):
            return Made(before, found=True)
        work = self._drawer.make(job.batch)
        if self._places is not None and self._places.put(job.place, work.chunk):
            return Made(work.record, found=False, in_memory=True)
        work.leave_chunk()
        return Made(work.record, found=False)


def make_dataset(plan: DatasetPlan, root: Path, means: Means = Means()) -> DatasetResult:
    """Raises ConfigError where `root` cannot be used, RecordingError where it cannot be written, HilError of the
    flight; whatever it raises, what was written until then is readable and can be gone on with."""
    began_s = time.monotonic()
    bench_files = saved_bench(plan)
    made = made_from(plan, bench_files)
    if not means.resume:
        refuse_full(root)
    make_folder(root)
    old: list[tuple[BatchRecord, int]] = []
    if means.resume and check_resumable(root, made, bench_files):
        old = read_journal(root / JOURNAL)
    make_folder(root / WORK)
    with locked(root / WORK):
        return _Making(plan, root, means, bench_files, made, old, began_s).result()


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else (os.cpu_count() or 1)


@dataclass
class _Making:
    """The part after it is known that it may be made."""

    plan: DatasetPlan
    root: Path
    means: Means
    bench_files: Mapping[str, bytes]
    made: Mapping[str, Any]
    old: Sequence[tuple[BatchRecord, int]]
    began_s: float

    def result(self) -> DatasetResult:
        plan, root, means = self.plan, self.root, self.means
        world = plan.bench.world
        classes = Classes(world.class_names, world.class_colours)
        catalogue = Catalogue.of_geoms(classes, np.asarray(world.geom_instance), np.asarray(world.geom_class))
        count = means.workers or cores()
        places = ChunkPlaces(AHEAD * count)
        factory = DrawerFactory(plan, plan.frames, plan.quality, root, places)
        tree = TreeWriter(root)
        # Before the workers: one that was not forked reads it.
        early = [tree.write(name, data) for name, data in sorted(self.bench_files.items())]
        with means.make_workers(count, factory) as pool, FrameProgress(plan.frames, quiet=means.quiet) as progress:
            write_manifest(tree, first_manifest(self.made))
            make_apart((root / name for name in big_folders(plan)), root / NURSERY)
            early += [tree.write(name, text.encode()) for name, text in sorted(sensor_files(plan, classes).items())]
            return self._work(pool, count, places, catalogue, early, progress)

    def _work(
        self,
        pool: Workers,
        count: int,
        places: ChunkPlaces,
        catalogue: Catalogue,
        early: Sequence[Written],
        progress: FrameProgress,
    ) -> DatasetResult:
        plan, root = self.plan, self.root
        tables = Tables(root, headers(plan), {name: plan.folder(name) for name in plan.flight_sensors})
        journal = JournalWriter(root / JOURNAL, self.old)
        recording = DatasetRecording(
            root,
            tick_ns=plan.config.tick_ns,
            metadata={"scene": plan.bench.scene.name, "seed": str(plan.config.seed), "quality": plan.quality},
            attachments={BENCH_NAME: self.bench_files[BENCH_NAME]},
        )
        times: list[tuple[float, int]] = []

        def on_done(frames: int) -> None:
            times.append((time.monotonic(), frames))
            progress.show(frames)

        checkpoints = self.means.make_checkpoints(root)
        pipeline = Pipeline(
            root,
            pool,
            recording=recording,
            journal=journal,
            tables=tables,
            checkpoints=checkpoints,
            expected=[record for record, _ in self.old],
            offsets=[offset for _, offset in self.old],
            on_done=on_done,
            workers_count=count,
            places=places,
        )
        try:
            fly_for_frames(plan, pipeline.add)
            pipeline.finish()
            journal.finish()
            finish(
                plan,
                root,
                catalogue=catalogue,
                records=pipeline.records,
                pictures=pipeline.pictures,
                early=early,
                tables=tables,
                recording=recording,
                journal=Written(JOURNAL, journal.size, journal.crc32),
                made=self.made,
            )
            checkpoints.finish(lambda: lambda: None)
        except BaseException:
            pipeline.abandon()
            raise
        finally:
            recording.close()
            journal.close()
        (first_s, before), (last_s, after) = times[0], times[-1]
        rate = (after - before) / (last_s - first_s) if last_s > first_s else 0.0
        return DatasetResult(root, pipeline.frames, pipeline.found, rate, time.monotonic() - self.began_s)
