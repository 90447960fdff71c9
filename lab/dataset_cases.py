"""Cases of `hil bench dataset`: data sets with and without radar and storage, their lower bound, and their errors."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np

from hil.apps.bench_suite.sensors.radar_cases import synthesizer
from hil.apps.dataset.batch_maker import BatchMaker, BatchMakerFactory, BatchWriter
from hil.apps.dataset.engines.jobs import Job, JobResult
from hil.apps.dataset.engines.local import LocalWorkers
from hil.apps.dataset.flight import FlightData, fly_for_frames
from hil.apps.dataset.moments import Batch
from hil.apps.dataset.plan import DatasetPlan, make_plan
from hil.apps.dataset.storage.manifest import saved_bench
from hil.apps.dataset.storage.tree import JOURNAL, TreeWriter
from hil.config.sensors.radar_checks import view_of
from hil.run.sensors.frame_stages import make_frames
from signals.errors import RecordingError
from signals.processors import usable_processors
from sim.frame.mount import Mount
from sim.frame.source import channel_array
from sim.radar.scatterers import Scatterers

RADAR = "radar"  # the radar of the default bench


@dataclass(frozen=True)
class Rate:
    """Speed at which a data set was made.

    `wall_s`: time from the start of the command (without storage, of the flight) to its end. The steady rate counts
    from the first finished batch on. `processor_s`: of the command and its workers.
    """

    frames: int
    wall_s: float
    steady_frames_per_s: float
    processor_s: float = float("nan")

    def per_processor_s(self, shorter: Rate) -> float:
        """Return the frames a second of undisturbed processors, for the frames that a shorter set does not have.

        NaN if those took no measurable time.
        """
        spent_s = self.processor_s - shorter.processor_s
        return usable_processors() * (self.frames - shorter.frames) / spent_s if spent_s > 0.0 else float("nan")


@contextmanager
def plan_of(quality: str, *, frames: int, radar: bool) -> Iterator[DatasetPlan]:
    """Plan a data set of the default bench, with or without its radar."""
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        settings = () if radar else (f"sensors.{RADAR}=null",)
        yield make_plan(None, frames=frames, quality=quality, seed=None, settings=settings, work=lambda: Path(folder))


def measure_stored(root: Path, quality: str, *, frames: int, radar: bool) -> Rate:
    """Measure `hil dataset` itself, in its own process and with everything written. Raises RecordingError."""
    arguments = ["--quality", quality, "--frames", str(frames), "--out", str(root), "--quiet"]
    arguments += [] if radar else ["--set", f"sensors.{RADAR}=null"]
    began_s, began_processor_s = time.monotonic(), _processor_s_of_children()
    process = subprocess.run(
        [sys.executable, "-P", "-m", "hil.cli", "dataset", *arguments], capture_output=True, text=True, check=False
    )
    wall_s = time.monotonic() - began_s
    steady = re.search(r"([0-9.]+) frames/s after the first batch", process.stdout)
    if process.returncode != 0 or steady is None:
        raise RecordingError(f"hil dataset {' '.join(arguments)}: status {process.returncode}\n{process.stderr}")
    return Rate(frames, wall_s, float(steady[1]), _processor_s_of_children() - began_processor_s)


def _processor_s_of_children() -> float:
    times = os.times()
    return times.children_user + times.children_system


class SampleOnly(BatchMaker):
    """Takes all samples of a batch and discards them."""

    def __call__(self, job: Job) -> JobResult:
        for moment in job.batch.moments:
            for due in moment.due:
                self.sample(moment.truth, due)
        return JobResult(job.batch.index, was_complete=False)


def measure_unstored(plan: DatasetPlan) -> Rate:
    """Measure flight and sampling alone, without encoding and writing."""
    began_s = time.monotonic()
    times: list[tuple[float, int]] = []  # end of each batch [s], batches so far
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        tree = TreeWriter(Path(folder))
        for name, data in saved_bench(plan).items():
            tree.write(name, data)
        factory = BatchMakerFactory(plan, plan.frames, plan.quality, tree, SampleOnly)
        with closing(LocalWorkers(usable_processors(), factory)) as pool:

            def collect(*, block: bool) -> None:
                for _ in pool.collect(block=block):
                    times.append((time.monotonic(), len(times) + 1))

            def add(batch: Batch, part: FlightData) -> None:  # noqa: ARG001
                while pool.busy >= pool.capacity:
                    collect(block=True)
                pool.submit(Job(batch, None, 0))
                collect(block=False)

            fly_for_frames(plan, add)
            while pool.busy:
                collect(block=True)
    (first_s, first_count), (last_s, last_count) = times[0], times[-1]
    steady = (last_count - first_count) * plan.frames / len(times) / (last_s - first_s) if last_s > first_s else 0.0
    return Rate(plan.frames, time.monotonic() - began_s, steady)


def lower_bound_s(plan: DatasetPlan, root: Path) -> float:
    """Return the seconds per frame that one process takes to encode and write the samples of a few batches to `root`.

    Delete what it has written after all rates have been measured: for minutes after the deletion of many files, ext4
    makes each new one more slowly, since it passes over their inodes.
    """
    batches: list[Batch] = []
    fly_for_frames(plan, lambda batch, _part: batches.append(batch))
    maker = BatchMaker(plan, TreeWriter(root))
    frame_s = []
    for batch in batches:
        writer = BatchWriter(maker, batch)
        spent_s = 0.0
        for moment in batch.moments:
            for due in moment.due:
                sample = maker.sample(moment.truth, due)  # valid until the sensor's next one
                began_s = time.perf_counter()
                writer.store(due.sensor, sample, moment.frame)
                spent_s += time.perf_counter() - began_s
        began_s = time.perf_counter()
        writer.finish()
        frame_s.append((spent_s + time.perf_counter() - began_s) / batch.frames)
    return float(np.median(frame_s))


def differing_files(one: Path, other: Path) -> list[str]:
    """Return the files, by name, that only one tree has or whose contents differ: all but the journal's.

    Pictures are compared decoded.
    """
    first, second = (_checksums(root) for root in (one, other))
    return sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))


def _checksums(root: Path) -> dict[str, int]:
    files = (path for path in root.rglob("*") if path.is_file() and path.name != JOURNAL)
    return {str(path.relative_to(root)): crc32(_content(path)) for path in files}


def _content(path: Path) -> bytes:
    if path.suffix != ".png":
        return path.read_bytes()
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    return f"{pixels.dtype} {pixels.shape}".encode() + pixels.tobytes()


def box_errors(root: Path) -> tuple[int, int]:
    """Return the number of annotated boxes and the sum of pixels by which their edges miss the instance pictures."""
    boxes = miss_px = 0
    for path in sorted((root / "Annotations").iterdir()):
        tree = ET.parse(path).getroot()  # noqa: S314 (our own file)
        picture = np.asarray(cv2.imread(str(root / f"mav0/instance0/data/{path.stem}.png"), cv2.IMREAD_UNCHANGED))
        extents = []
        for instance in np.unique(picture)[1:]:
            rows, columns = np.nonzero(picture == instance)
            extents.append((columns.min() + 1, rows.min() + 1, columns.max() + 1, rows.max() + 1))
        mask_edges = np.array(extents).reshape(-1, 4)
        for box in tree.iter("bndbox"):
            edges = [int(box.findtext(key) or 0) for key in ("xmin", "ymin", "xmax", "ymax")]
            boxes += 1
            miss_px += int(np.abs(mask_edges - edges).sum(axis=1).min())
    return boxes, miss_px


def radar_error(plan: DatasetPlan) -> tuple[float, float]:
    """Return the relative error of a radar frame against the exact sum over the same echoes, and the tolerance."""
    truths = []
    fly_for_frames(plan, lambda batch, _part: truths.append(batch.moments[0].truth))
    p = plan.config.sensors[RADAR].parameters
    view = view_of(plan.config.sensors[p.frame])
    frames = make_frames(plan.bench)
    scatterers = Scatterers(view.camera, frames.geometry.world, p.chirp, p.antenna, p.receiver, p.mask)
    renderer = frames.renderer(view.camera, shadows=False, supersample=1, near_m=view.near_m, far_m=view.far_m)
    picture = {name: channel_array(name, view.camera) for name in scatterers.channels}
    truth = truths[-1]
    pose = Mount(view.mount_m, view.mount_rpy_deg).pose(truth)
    frames.expect(truth.t_ns)
    renderer.render(pose, picture)
    echoes = scatterers.collect(picture, pose)
    shape = (len(p.antenna.rx_positions_m), p.chirp.chirps, p.chirp.samples)
    measured, exact = np.empty(shape), np.empty(shape)
    synthesizer(p, p.method, p.tolerance).synthesize(echoes, measured)
    synthesizer(p, "direct", p.tolerance).synthesize(echoes, exact)
    return float(np.linalg.norm(measured - exact) / np.linalg.norm(exact)), p.tolerance
