"""Making a data set from beginning to end, or going on with one that was interrupted."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from hil.config import load_bench
from hil.dataset.drawing import BatchDrawer
from hil.dataset.finish import finish
from hil.dataset.flight import fly_for_frames
from hil.dataset.formats.labels import Catalogue
from hil.dataset.journal import Journal
from hil.dataset.layout import headers, sensor_files
from hil.dataset.manifest import (
    BENCH_NAME,
    check_resumable,
    first_manifest,
    made_from,
    refuse_full,
    saved_bench,
    write_manifest,
)
from hil.dataset.pipeline import Pipeline
from hil.dataset.plan import DatasetPlan
from hil.dataset.recording import DatasetRecording
from hil.dataset.tables import Checkpoints, Tables
from hil.dataset.tree import JOURNAL, TreeWriter, Written, locked, make_folder
from hil.dataset.workers import Maker, Workers
from hil.progress import Shown
from hil.signals.classes import Classes

_BAR_S, _LINE_S = 0.1, 5.0


class FrameProgress(Shown):
    """Frames done, rate, time left: a bar on a terminal, elsewhere a line every few seconds."""

    def __init__(
        self, total: int, *, quiet: bool, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__("dataset", quiet=quiet, stream=stream, clock=clock)
        self._total = total
        self._next_s = 0.0
        self._first: tuple[float, int] | None = None  # when and at how many frames the measured part began

    def text(self, done: int, now_s: float) -> str:
        """Frames, rate and time left. The rate is that since the first batch came back: take-off does not count."""
        if self._first is None:
            self._first = (now_s, done)
            return f"{done} of {self._total} frames"
        since_s, before = self._first
        rate = (done - before) / max(now_s - since_s, 1e-6)
        if rate <= 0.0:
            return f"{done} of {self._total} frames"
        left_s = (self._total - done) / rate
        return f"{done} of {self._total} frames, {rate:.1f} frames/s, {_minutes(left_s)} left"

    def show(self, done: int) -> None:
        """So many frames are done."""
        now_s = self._clock()
        if self._quiet or (now_s < self._next_s and self._first is not None):
            return
        text = self.text(done, now_s)
        with contextlib.suppress(OSError, ValueError):  # whoever read this is gone
            if self._bar is not None:
                self._next_s = now_s + _BAR_S
                self._bar.update(self._task, total=self._total, completed=done, text=text, refresh=True)
            else:
                self._next_s = now_s + _LINE_S
                print(text, file=self._stream, flush=True)


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"


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
    make_checkpoints: Callable[[Path, Tables], Checkpoints] = Checkpoints


@dataclass
class DrawerFactory:
    """Makes what a worker works with. A process that was not forked loads the bench saved in the data set."""

    plan: DatasetPlan | None
    frames: int
    quality: str
    root: Path
    kind: type[BatchDrawer] = BatchDrawer

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "plan": None}

    def __call__(self) -> BatchDrawer:
        plan = self.plan or DatasetPlan(load_bench(self.root / BENCH_NAME), self.frames, self.quality)
        return self.kind(plan, self.root)


def make_dataset(plan: DatasetPlan, root: Path, means: Means = Means()) -> DatasetResult:
    """Raises ConfigError where `root` cannot be used, RecordingError where it cannot be written, HilError of the
    flight; whatever it raises, what was written until then is readable and can be gone on with."""
    began_s = time.monotonic()
    bench_files = saved_bench(plan)
    made = made_from(plan, bench_files)
    if not means.resume:
        refuse_full(root)
    make_folder(root)
    if means.resume:
        check_resumable(root, made, bench_files)
    with locked(root):
        return _Making(plan, root, means, bench_files, made, began_s).result()


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
    began_s: float

    def result(self) -> DatasetResult:
        plan, root, means = self.plan, self.root, self.means
        count = means.workers or cores()
        tree = TreeWriter(root)
        # Before the workers: one that was not forked reads it.
        early = [tree.write(name, data) for name, data in sorted(self.bench_files.items())]
        factory = DrawerFactory(plan, plan.frames, plan.quality, root)
        with means.make_workers(count, factory) as pool, FrameProgress(plan.frames, quiet=means.quiet) as progress:
            write_manifest(tree, first_manifest(self.made))
            return self._work(pool, count, early, progress)

    def _work(self, pool: Workers, count: int, early: list[Written], progress: FrameProgress) -> DatasetResult:
        plan, root, world = self.plan, self.root, self.plan.bench.world
        classes = Classes(world.class_names, world.class_colours)
        tree = TreeWriter(root)
        early += [tree.write(name, text.encode()) for name, text in sorted(sensor_files(plan, classes).items())]
        tables = Tables(root, headers(plan), {name: plan.folder(name) for name in plan.flight_sensors})
        journal = Journal(root / JOURNAL)
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

        checkpoints = self.means.make_checkpoints(root, tables)
        pipeline = Pipeline(
            root,
            pool,
            recording=recording,
            journal=journal,
            tables=tables,
            checkpoints=checkpoints,
            expected=list(journal.entries()),
            on_done=on_done,
            workers_count=count,
        )
        try:
            fly_for_frames(plan, pipeline.add)
            pipeline.finish()
            finish(
                plan,
                root,
                catalogue=Catalogue.of_geoms(classes, np.asarray(world.geom_instance), np.asarray(world.geom_class)),
                records=pipeline.records,
                pictures=pipeline.pictures,
                early=early,
                tables=tables,
                recording=recording,
                made=self.made,
            )
            checkpoints.finish()
        except BaseException:
            pipeline.abandon()
            raise
        finally:
            checkpoints.close()
            recording.close()
            journal.close()
        (first_s, before), (last_s, after) = times[0], times[-1]
        rate = (after - before) / (last_s - first_s) if last_s > first_s else 0.0
        return DatasetResult(root, pipeline.frames, pipeline.found, rate, time.monotonic() - self.began_s)
