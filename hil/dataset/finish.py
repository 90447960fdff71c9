"""What is written once all frames are there: splits, COCO, the datasheet, checksums, the manifest."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.dataset.formats import voc
from hil.dataset.formats.coco import CocoPicture, coco_parts
from hil.dataset.formats.datasheet import LICENCE, LIMITS, PAGE_NAME, datasheet_html
from hil.dataset.formats.euroc import ROOT
from hil.dataset.formats.labels import Catalogue
from hil.dataset.formats.split import GUARD, SETS, Split, equal_segments, split_frames, split_text
from hil.dataset.journal import BatchRecord
from hil.dataset.manifest import write_manifest
from hil.dataset.plan import DatasetPlan
from hil.dataset.recording import DatasetRecording
from hil.dataset.tables import TABLE, Tables
from hil.dataset.tree import (
    ANNOTATIONS,
    CHECKSUMS,
    JOURNAL,
    MANIFEST,
    PREVIEW,
    RECORDING,
    WORK,
    TreeWriter,
    Written,
    unwritable,
)
from hil.signals.time import NS_PER_S
from sim.sensors.catalog import PRESETS

SPLIT_NAME = "split.csv"
_COCO_NAMES = {"train": "train", "validation": "val", "test": "test"}
_PIECE = 1 << 20  # characters of a COCO file in memory
_WITH_GUARDS = 30  # frames; of fewer the sets are neighbours without any between them
_TITLES = {
    "rgb": "colour",
    "boxes": "colour with boxes",
    "depth": "depth, near is bright",
    "segmentation": "classes",
    "instance": "instances",
    "normal": "normals",
    "cloud": "LiDAR from above, 40 m each way",
    "map": "radar, range and speed",
}


@dataclass(frozen=True)
class Counted:
    """What all batches together hold."""

    frame_t_ns: list[int]
    objects: list[dict[int, int]]  # by frame
    pixels: list[int]  # by class
    samples: dict[str, int]  # by sensor

    @classmethod
    def of(cls, records: Sequence[BatchRecord]) -> Counted:
        pixels = [0] * 256
        samples: dict[str, int] = {}
        for record in records:
            for class_id, count in record.class_pixels.items():
                pixels[class_id] += count
            for name, count in record.samples.items():
                samples[name] = samples.get(name, 0) + count
        return cls(
            [t for record in records for t in record.frame_t_ns],
            [counts for record in records for counts in record.objects],
            pixels,
            samples,
        )


def split_of(frames: int, guard_frames: int) -> Split:
    """60/20/20 by equal pieces of the trajectory. With few frames there are none to spare between the sets."""
    guard = guard_frames if frames >= _WITH_GUARDS else 0
    if guard and len(equal_segments(frames, guard_frames=guard)) < len(SETS):
        guard = 0
    return split_frames(frames, guard_frames=guard)


def finish(
    plan: DatasetPlan,
    root: Path,
    *,
    catalogue: Catalogue,
    records: Sequence[BatchRecord],
    pictures: Callable[[], Iterable[CocoPicture]],
    early: Iterable[Written],
    tables: Tables,
    recording: DatasetRecording,
    made: Mapping[str, Any],
) -> None:
    """Write the rest and take away what was only for the work. `early`: files written before the first frame."""
    tree = TreeWriter(root)
    counted = Counted.of(records)
    split = split_of(len(counted.frame_t_ns), plan.config.dataset.guard_frames)
    files = [*early, *(file for record in records for file in record.files), *tables.written()]
    late: list[Written] = []
    if plan.labelled is not None:
        names = [str(t_ns) for t_ns in counted.frame_t_ns]
        late += [tree.write(f"{voc.IMAGE_SETS}/{n}", t.encode()) for n, t in voc.image_sets(names, split).items()]
        late += _coco_files(plan, tree, split, catalogue, pictures)
    late.append(tree.write(SPLIT_NAME, split_text(split).encode()))
    if plan.labelled is not None:
        _link(root / voc.IMAGES, f"{ROOT}/{plan.folder(plan.labelled, 'rgb')}/data")
    previews = [file.path for record in records[:1] for file in record.files if file.path.startswith(PREVIEW)]
    page = _page(plan, root, counted, split, catalogue, tables, made, previews)
    late.append(tree.write(PAGE_NAME, page.encode()))
    recording.finish({"frames": str(plan.frames), "batches": str(len(records))})
    listed = sorted([*files, *late], key=lambda file: file.path)
    rows = "".join(f"{file.path},{file.size},{file.crc32:08x}\n" for file in listed)
    sums = ("#path,bytes,crc32\n" + rows).encode()
    tree.write(CHECKSUMS, sums)
    counts = split.counts
    write_manifest(
        tree,
        {
            "complete": True,
            "made_from": dict(made),
            "randomize": plan.bench.drawn(),
            "licence": LICENCE,
            "frames": len(counted.frame_t_ns),
            "first_t_ns": counted.frame_t_ns[0],
            "last_t_ns": counted.frame_t_ns[-1],
            "split": {name: counts[name] for name in (*SETS, GUARD)},
            "samples": {**counted.samples, **{f: n for f, n in tables.rows.items() if f not in counted.samples}},
            "objects": sum(sum(frame.values()) for frame in counted.objects),
            "files": len(listed),
            "bytes": sum(file.size for file in listed),
            "recording_bytes": recording.size,
            "checksums_sha256": hashlib.sha256(sums).hexdigest(),
        },
    )
    shutil.rmtree(root / WORK, ignore_errors=True)


def _coco_files(
    plan: DatasetPlan,
    tree: TreeWriter,
    split: Split,
    catalogue: Catalogue,
    pictures: Callable[[], Iterable[CocoPicture]],
) -> Iterator[Written]:
    """A file for each set, and one of all. A set without frames has its file too, of no images."""
    about = f"{plan.bench.scene.name}, seed {plan.config.seed}"
    for name, short in {**_COCO_NAMES, "": "all"}.items():
        ids = {frame + 1 for frame in (split.frames(name) if name else range(len(split.of_frame)))}

        def chosen(ids: set[int] = ids) -> Iterator[CocoPicture]:
            return (picture for picture in pictures() if picture.image_id in ids)

        parts = coco_parts(chosen, catalogue, description=about, licence=LICENCE)
        yield tree.write_parts(f"{ANNOTATIONS}/instances_{short}.json", _pieces(parts))


def _pieces(parts: Iterable[str]) -> Iterator[bytes]:
    """The same in fewer, larger pieces."""
    held: list[str] = []
    size = 0
    for part in parts:
        held.append(part)
        size += len(part)
        if size > _PIECE:
            yield "".join(held).encode()
            held.clear()
            size = 0
    yield "".join(held).encode()


def _link(link: Path, target: str) -> None:
    """VOC's folder of pictures is the camera's own."""
    try:
        if not link.is_symlink():
            os.symlink(target, link, target_is_directory=True)
    except OSError as error:
        raise unwritable(link, error) from error


def _page(
    plan: DatasetPlan,
    root: Path,
    counted: Counted,
    split: Split,
    catalogue: Catalogue,
    tables: Tables,
    made: Mapping[str, Any],
    previews: Sequence[str],
) -> str:
    config = plan.config
    by_class: dict[int, list[int]] = {}
    columns = {name: i for i, name in enumerate((*SETS, GUARD))}
    for of, counts in zip(split.of_frame, counted.objects, strict=False):
        for class_id, n in counts.items():
            by_class.setdefault(class_id, [0] * len(columns))[columns[of]] += n
    limits = list(LIMITS)
    if len(counted.frame_t_ns) < _WITH_GUARDS:
        limits.append(
            f"So few frames ({len(counted.frame_t_ns)}) leave none between the sets: neighbours in time are in "
            "different sets, and a set can be empty. Good to try tools with, not to judge a detector by."
        )
    frames = len(counted.frame_t_ns)
    trajectory = config.dataset.trajectory
    course = config.mission or "none"
    if trajectory is not None:
        course = (
            f"{trajectory.preset}, {trajectory.side_m:g} m, at {trajectory.height_m:g} m, {trajectory.speed_mps:g} m/s"
        )
    return datasheet_html(
        title=f"{plan.bench.scene.name}, {frames} frames",
        about=[
            f"Labelled data of several sensors on a simulated {config.vehicle}, flown by a {config.autopilot.kind} "
            f"flight controller over {plan.bench.scene.name}.",
            "All sensors share one clock: times are simulated nanoseconds after "
            f"{made['epoch_ns']} ns, and samples of one time are of one moment.",
            f"{frames} frames over {(counted.frame_t_ns[-1] - counted.frame_t_ns[0]) / NS_PER_S:.2f} s.",
        ],
        made={
            "scene": plan.bench.scene.name,
            "trajectory": course,
            "seed": str(config.seed),
            "quality": plan.quality,
            "bench": f"bench.yaml, sha256 {made['config_sha256']}",
            "again": f"hil dataset bench.yaml --frames {frames}",
        },
        sensors=_sensor_rows(plan, counted, tables),
        classes=catalogue.classes,
        class_pixels=counted.pixels,
        class_objects=by_class,
        split=split,
        formats=_formats(plan),
        pictures=[_sample(root, path) for path in previews],
        limits=limits,
    )


def _sample(root: Path, path: str) -> tuple[str, str, bytes]:
    name, _, kind = Path(path).name.rpartition(".")
    sensor, _, key = name.rpartition("-")
    return f"{sensor}: {_TITLES[key]}", kind, (root / path).read_bytes()


def _sensor_rows(plan: DatasetPlan, counted: Counted, tables: Tables) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, sensor in plan.config.sensors.items():
        p = sensor.parameters
        holds = ", ".join(getattr(p, "channels", None) or getattr(p, "outputs", None) or (sensor.kind,))
        preset = PRESETS.get(sensor.preset) if sensor.preset is not None else None
        part = f" ({preset.part})" if preset is not None else ""
        parts = getattr(p, "channels", None) or getattr(p, "outputs", None) or ("",)
        folders = ", ".join(dict.fromkeys(f"{ROOT}/{plan.folder(name, part)}" for part in parts))
        samples = counted.samples.get(name, tables.rows.get(plan.folder(name), 0))
        rows.append((name + part, folders, holds, f"{sensor.rate_hz:g}", str(samples)))
    return rows


def _formats(plan: DatasetPlan) -> dict[str, str]:
    step_m = plan.config.dataset.depth_step_m
    found = {
        f"{ROOT}/*/{TABLE}": "ASL (EuRoC): a table of times and values, or of times and files",
        f"{ROOT}/*/sensor.yaml": "intrinsics, place on the vehicle (T_BS), rate, noise",
        f"{ROOT}/depth*/data": f"16-bit PNG, steps of {step_m:g} m; 0: nothing, 65535: beyond {65534 * step_m:g} m",
        f"{ROOT}/lidar*/data": "float32 x, y, z [m], intensity; classes in labels/, as SemanticKITTI has them",
        f"{ROOT}/radar*/data": "numpy uint16 (receivers, chirps, samples); chirp: radar.json",
        f"{ROOT}/range_doppler*/data": "numpy float32 (chirps, range bins), power in ADC counts squared",
        "Annotations, ImageSets, JPEGImages, SegmentationClass": "Pascal VOC; the pictures are PNGs",
        f"{ANNOTATIONS}/instances_*.json": "COCO with masks: train, val, test, all",
        SPLIT_NAME: "the set of each frame",
        RECORDING: "the whole run as MCAP, ROS 2 messages; pictures are the PNG files' own bytes",
        CHECKSUMS: "bytes and CRC-32 of every file but the recording and the journal",
        MANIFEST: "what it was made from, and counts",
        JOURNAL: "what `--resume` goes by",
    }
    if plan.labelled is None:
        found = {k: v for k, v in found.items() if "VOC" not in v and "COCO" not in v}
    return found
