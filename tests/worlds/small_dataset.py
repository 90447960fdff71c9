"""A small data set for tests: few pixels, the first second of a flight, workers that need no process."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zlib import crc32

from hil.apps.dataset.engines.jobs import Job, JobHandler, JobResult
from hil.apps.dataset.make import MakeOptions
from hil.apps.dataset.plan import DatasetPlan, make_plan
from hil.apps.dataset.storage.journal import BatchRecord, Journal
from hil.apps.dataset.storage.tree import JOURNAL
from signals.errors import RecordingError

BENCH = """
rig: mock
tick_hz: 100
scene: city_park
seed: 5
duration_s: 60
autopilot: {transport: loopback}
dataset: {record: flight, trajectory: {preset: square, side_m: 6, height_m: 2.5, speed_mps: 2}}  # from the ground on
sensors:
  imu:   {preset: icm20689}
  gps:   {preset: here_plus, rate_hz: 10}
  baro:  {preset: ms5611, rate_hz: 50}
  mag:   {preset: ist8310, rate_hz: 50}
  front: {kind: camera, resolution: [96, 64], fov_deg: 90, rate_hz: 20,
          channels: [rgb, depth, segmentation, instance, normal], mount_m: [0.1, 0, 0.05]}
  lidar: {preset: vlp16, rate_hz: 10, subsweeps: 2}
  radar: {preset: bgt60tr13c, frame: front, rate_hz: 20, outputs: [raw, range_doppler]}
"""


def tiny_plan(folder: Path, *, frames: int, bench: str = BENCH, settings: tuple[str, ...] = ()) -> DatasetPlan:
    """Return a small plan; `folder` holds the bench and the course."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "tiny.yaml"
    path.write_text(bench)
    return make_plan(path, frames=frames, quality=None, seed=None, settings=settings, work=lambda: folder)


class Inline:
    """Workers that do every job in this process, on demand."""

    def __init__(self, count: int, make_handler: Callable[[], JobHandler], *, crash_at: int = -1) -> None:
        """`crash_at`: the batch at which the process ends as if killed."""
        del count
        self._handler = make_handler()
        self._waiting: list[Job] = []
        self._crash_at = crash_at
        self.capacity = 2

    @property
    def busy(self) -> int:
        return len(self._waiting)

    def submit(self, job: Job) -> None:
        if job.batch.index == self._crash_at:
            raise Crash
        self._waiting.append(job)

    def collect(self, *, block: bool) -> list[JobResult]:
        if not block and self.busy < self.capacity:
            return []
        jobs, self._waiting = self._waiting, []
        return [self._handler(job) for job in jobs[::-1]]  # out of order

    def close(self) -> None:
        self._waiting = []


class Crash(BaseException):
    """A kill. Not an Exception, since no clean-up follows a kill."""


def inline(**more: Any) -> MakeOptions:
    return MakeOptions(workers=1, quiet=True, make_workers=Inline, **more)


def journal_of(root: Path) -> list[tuple[BatchRecord, int]]:
    """Return every batch of the journal and the place of its chunk."""
    journal = Journal(root / JOURNAL)
    try:
        return list(journal.entries())
    finally:
        journal.close()


def stored_batches(root: Path) -> int:
    """Return how many batches the journal of a data set holds that another process writes, -1 before there is one."""
    wal = root / f"{JOURNAL}-wal"
    if not wal.is_file():
        return -1
    with tempfile.TemporaryDirectory() as folder:  # the writer has the file locked
        for path in root.glob(f"{JOURNAL}*"):
            shutil.copy(path, folder)
        try:
            return len(journal_of(Path(folder)))
        except RecordingError:
            return -1


def tree_of(root: Path) -> dict[str, tuple[int, int] | str]:
    """Return size and checksum, link target, or journal content of every file below `root`."""
    found: dict[str, tuple[int, int] | str] = {}
    for folder, folders, names in os.walk(root):
        for name in [*names, *folders]:
            path = Path(folder) / name
            key = str(path.relative_to(root))
            if path.is_symlink():
                found[key] = os.readlink(path)
            elif name == JOURNAL:
                found[key] = str(journal_of(root))
            elif path.is_file():
                data = path.read_bytes()
                found[key] = (len(data), crc32(data))
    return found
