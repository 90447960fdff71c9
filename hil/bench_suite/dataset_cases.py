"""Parts of `hil bench dataset`: data sets with and without radar and storage, the floor, and what can be wrong."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np

from hil.bench_suite.radar_cases import synthesizer
from hil.config.radar_checks import view_of
from hil.dataset.drawing import BatchDrawer, StoringWork
from hil.dataset.flight import FlightPart, fly_for_frames
from hil.dataset.make import DrawerFactory, cores
from hil.dataset.manifest import saved_bench
from hil.dataset.moments import Batch
from hil.dataset.plan import DatasetPlan, make_plan
from hil.dataset.tree import JOURNAL, WORK, TreeWriter
from hil.dataset.workers import Job, Made, Workers
from hil.frame_stages import make_frames
from hil.signals.errors import RecordingError
from sim.frame.mount import Mount
from sim.frame.source import channel_array
from sim.radar.scatterers import Scatterers

RADAR = "radar"  # the radar of the default bench


@dataclass(frozen=True)
class Rate:
    """How fast a data set was made."""

    frames: int
    wall_s: float  # from the beginning of the command, or, without storage, of the flight, to the end
    steady_frames_per_s: float  # from the first batch that came back on


@contextmanager
def plan_of(quality: str, *, frames: int, radar: bool) -> Iterator[DatasetPlan]:
    """The default bench, or that without its radar."""
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        settings = () if radar else (f"sensors.{RADAR}=null",)
        yield make_plan(None, frames=frames, quality=quality, seed=None, settings=settings, work=lambda: Path(folder))


def stored(root: Path, quality: str, *, frames: int, radar: bool) -> Rate:
    """With everything written: the command as a user gives it, in a process of its own. RecordingError."""
    arguments = ["--quality", quality, "--frames", str(frames), "--out", str(root), "--quiet"]
    arguments += [] if radar else ["--set", f"sensors.{RADAR}=null"]
    began_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "hil.cli", "dataset", *arguments], capture_output=True, text=True, check=False
    )
    wall_s = time.monotonic() - began_s
    steady = re.search(r"([0-9.]+) a second once under way", done.stdout)
    if done.returncode != 0 or steady is None:
        raise RecordingError(f"hil dataset {' '.join(arguments)}: status {done.returncode}\n{done.stderr}")
    return Rate(frames, wall_s, float(steady[1]))


class SampleOnly(BatchDrawer):
    """Draws, sweeps and computes all samples of a batch, and drops them."""

    def __call__(self, job: Job) -> Made:
        for moment in job.batch.moments:
            for look in moment.looks:
                self.sample(moment.truth, look)
        return Made(job.batch.index, found=False)


def not_stored(plan: DatasetPlan) -> Rate:
    """With nothing encoded and nothing written: flight and samples alone."""
    began_s = time.monotonic()
    times: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        tree = TreeWriter(Path(folder))
        for name, data in saved_bench(plan).items():
            tree.write(name, data)
        with Workers(cores(), DrawerFactory(plan, plan.frames, plan.quality, Path(folder), SampleOnly)) as pool:

            def collect(*, block: bool) -> None:
                for _ in pool.collect(block=block):
                    times.append((time.monotonic(), len(times) + 1))

            def add(batch: Batch, part: FlightPart) -> None:  # noqa: ARG001
                while not pool.room:
                    collect(block=True)
                pool.submit(Job(batch, None, 0))
                collect(block=False)

            fly_for_frames(plan, add)
            while pool.busy:
                collect(block=True)
    (first_s, before), (last_s, after) = times[0], times[-1]
    steady = (after - before) * plan.frames / len(times) / (last_s - first_s) if last_s > first_s else 0.0
    return Rate(plan.frames, time.monotonic() - began_s, steady)


def floor_s(plan: DatasetPlan) -> float:
    """Seconds a frame to encode and write the arrays of a few batches that are there already, by one process."""
    batches: list[Batch] = []
    fly_for_frames(plan, lambda batch, _part: batches.append(batch))
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        (Path(folder) / WORK).mkdir()
        drawer = BatchDrawer(plan, Path(folder))
        best = []
        for batch in batches:
            pairs = [(moment, look) for moment in batch.moments for look in moment.looks]
            samples = [(look, drawer.sample(moment.truth, look), moment.frame) for moment, look in pairs]
            work = StoringWork(drawer, batch)
            began = time.perf_counter()
            for look, sample, frame in samples:
                work.store(look.sensor, sample, frame)
            work.finish()
            best.append((time.perf_counter() - began) / batch.frames)
    return float(np.median(best))


def digest(root: Path) -> int:
    """Over every file's name and content, but the journal's; a picture's content is its pixels."""
    crc = 0
    for folder, folders, names in sorted(os.walk(root)):
        folders.sort()
        for name in sorted(set(names) - {JOURNAL}):
            path = Path(folder) / name
            crc = crc32(_content(path), crc32(str(path.relative_to(root)).encode(), crc))
    return crc


def _content(path: Path) -> bytes:
    if path.suffix != ".png":
        return path.read_bytes()
    pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    return f"{pixels.dtype} {pixels.shape}".encode() + pixels.tobytes()


def box_errors(root: Path) -> tuple[int, int]:
    """Boxes in the annotations, and pixels by which their edges miss the instance pictures' extents."""
    boxes = wrong = 0
    for path in sorted((root / "Annotations").iterdir()):
        tree = ET.parse(path).getroot()  # noqa: S314 (our own file)
        picture = np.asarray(cv2.imread(str(root / f"mav0/instance0/data/{path.stem}.png"), cv2.IMREAD_UNCHANGED))
        extents = []
        for instance in np.unique(picture)[1:]:
            rows, columns = np.nonzero(picture == instance)
            extents.append((columns.min() + 1, rows.min() + 1, columns.max() + 1, rows.max() + 1))
        known = np.array(extents).reshape(-1, 4)
        for box in tree.iter("bndbox"):
            edges = [int(box.findtext(key) or 0) for key in ("xmin", "ymin", "xmax", "ymax")]
            boxes += 1
            wrong += int(np.abs(known - edges).sum(axis=1).min())
    return boxes, wrong


def radar_error(plan: DatasetPlan) -> tuple[float, float]:
    """Relative error of a frame's synthesis against the exact sum over the same echoes, and the tolerance."""
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
    found, exact = np.empty(shape), np.empty(shape)
    synthesizer(p, p.method, p.tolerance).synthesize(echoes, found)
    synthesizer(p, "direct", p.tolerance).synthesize(echoes, exact)
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact)), p.tolerance
