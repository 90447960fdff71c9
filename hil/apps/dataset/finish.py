"""Files written after the last frame: split, COCO, datasheet, checksums and manifest."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hil.apps.dataset.formats import voc
from hil.apps.dataset.formats.boxes import FOLDER as BOXES
from hil.apps.dataset.formats.coco import coco_parts
from hil.apps.dataset.formats.datasheet import LICENCE, LIMITS, PAGE_NAME, Datasheet, datasheet_html
from hil.apps.dataset.formats.euroc import ROOT
from hil.apps.dataset.formats.labels import Catalogue
from hil.apps.dataset.formats.previews import radar_picture
from hil.apps.dataset.formats.radar_labels import FOLDER as RADAR_LABELS
from hil.apps.dataset.formats.radar_labels import read_radar_labels
from hil.apps.dataset.formats.split import GUARD, SETS, Split, equal_segments, split_frames, split_text
from hil.apps.dataset.label_form import finish_forms, forms_of, link
from hil.apps.dataset.plan import DatasetPlan
from hil.apps.dataset.storage.journal import BatchRecord
from hil.apps.dataset.storage.manifest import write_manifest
from hil.apps.dataset.storage.store import DatasetStore
from hil.apps.dataset.storage.tables import TABLE, Tables
from hil.apps.dataset.storage.tree import (
    ANNOTATIONS,
    CHECKSUMS,
    JOURNAL,
    PREVIEW,
    WORK,
    TreeWriter,
    Written,
)
from hil.data_set_files import IMAGE_SETS, IMAGES, MANIFEST
from hil.run.parts.judges.echoes import no_return
from hil.run_files import MCAP_NAME
from signals.channels import CHANNELS
from signals.errors import RecordingError
from signals.time import NS_PER_S
from sim.frame.source import VEHICLE_CLASS
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters

SPLIT_NAME = "split.csv"
_COCO_NAMES = {"train": "train", "validation": "val", "test": "test"}
_MIN_FRAMES_WITH_GUARDS = 30  # with fewer, there are no guard frames between the sets
_TITLES = {name: channel.title for name, channel in CHANNELS.items()} | {
    "boxes": "colour with boxes",
    "depth": "depth, near is bright",
    "boxes3d": "colour with 3-D boxes; a cross marks the front; in %: hidden, outside the picture",
    "cloud": "LiDAR from above, 40 m each way",
    "above": "LiDAR from above, 40 m each way, with the boxes of objects; lines lead to their fronts",
    "map": "the frame with the most echoes; in the map range is upwards, receding to the right; dB over its median",
}


@dataclass(frozen=True)
class DatasetCounts:
    """Totals over all batches."""

    frame_t_ns: list[int]
    objects: list[dict[int, int]]  # by frame: class to number of objects
    pixels: list[int]  # by class, 256 counts
    samples: dict[str, int]  # by sensor

    @classmethod
    def sum_of(cls, records: Sequence[BatchRecord]) -> DatasetCounts:
        """Sum the records of all batches, which must be in order."""
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
    """Split the frames 60/20/20 by equal segments of the trajectory; with few frames, without guards between sets."""
    guard = guard_frames if frames >= _MIN_FRAMES_WITH_GUARDS else 0
    if guard and len(equal_segments(frames, guard_frames=guard)) < len(SETS):
        guard = 0
    return split_frames(frames, guard_frames=guard)


def finish(
    plan: DatasetPlan,
    store: DatasetStore,
    records: Sequence[BatchRecord],
    *,
    catalogue: Catalogue,
    files: Iterable[Written],
    made_from: Mapping[str, Any],
) -> DatasetCounts:
    """Write the remaining files, complete the recording and delete the work folder. Return the totals.

    `files` were written before the first frame; `made_from` is the result of `storage.manifest.provenance`. Raises
    RecordingError.
    """
    root, tables, recording = store.root, store.tables, store.recording
    tree = TreeWriter(root)
    counts = DatasetCounts.sum_of(records)
    split = split_of(len(counts.frame_t_ns), plan.config.dataset.guard_frames)
    batch_files = (file for record in records for file in record.files)
    written = [*files, *batch_files, *tables.written()]
    if plan.labelled is not None:
        names = [str(t_ns) for t_ns in counts.frame_t_ns]
        written += [tree.write(f"{IMAGE_SETS}/{n}", t.encode()) for n, t in voc.image_sets(names, split).items()]
        written += _coco_files(plan, store, split, catalogue, records)
    written += finish_forms(forms_of(plan, catalogue), tree, split, store.annotated_frames)
    written.append(tree.write(SPLIT_NAME, split_text(split).encode()))
    if plan.labelled is not None:
        link(root / IMAGES, f"{ROOT}/{plan.folder(plan.labelled, 'rgb')}/data")
    previews = [file.path for record in records[:1] for file in record.files if file.path.startswith(PREVIEW)]
    for file in _radar_previews(plan, tree, records):
        written.append(file)
        previews.append(file.path)
    page = datasheet_html(_datasheet(plan, store, counts, split, catalogue, made_from, previews))
    written.append(tree.write(PAGE_NAME, page.encode()))
    recording.finish({"frames": str(plan.frames), "batches": str(len(records))})
    written.sort(key=lambda file: file.path)
    rows = "".join(f"{file.path},{file.size},{file.crc32:08x}\n" for file in written)
    checksums = ("#path,bytes,crc32\n" + rows).encode()
    tree.write(CHECKSUMS, checksums)
    write_manifest(
        tree,
        {
            "complete": True,
            "made_from": dict(made_from),
            "randomize": plan.bench.random_choices(),
            **({"other_vehicles": _instances(plan)} if plan.vehicle else {}),
            "licence": LICENCE,
            "frames": len(counts.frame_t_ns),
            "first_t_ns": counts.frame_t_ns[0],
            "last_t_ns": counts.frame_t_ns[-1],
            "split": {name: split.counts[name] for name in (*SETS, GUARD)},
            # By name for cameras, LiDARs and radars, and by folder in mav0 for every table.
            "samples": {**counts.samples, **{f: n for f, n in tables.rows.items() if f not in counts.samples}},
            "objects": sum(sum(frame.values()) for frame in counts.objects),
            "files": len(written),
            "bytes": sum(file.size for file in written),
            "recording_bytes": recording.size,
            "checksums_sha256": hashlib.sha256(checksums).hexdigest(),
        },
    )
    shutil.rmtree(root / WORK, ignore_errors=True)
    return counts


def _instances(plan: DatasetPlan) -> dict[str, int]:
    """Return the instance of each other vehicle in pictures and labels, by its name."""
    names = plan.world.instance_names
    return {name: names.index(f"{VEHICLE_CLASS}:{name}") for name in plan.other_vehicles}


def _coco_files(
    plan: DatasetPlan, store: DatasetStore, split: Split, catalogue: Catalogue, records: Sequence[BatchRecord]
) -> Iterator[Written]:
    """Write one COCO file per set and one of all frames. A set without frames has a file without images."""
    tree = TreeWriter(store.root)
    description = f"{plan.bench.scene.name}, seed {plan.config.seed}"
    for name, short in {**_COCO_NAMES, "": "all"}.items():
        ids = {frame + 1 for frame in (split.frames(name) if name else range(len(split.set_by_frame)))}
        batches = {
            r.index for r in records if not ids.isdisjoint(range(r.first_frame + 1, r.first_frame + r.frames + 1))
        }
        pictures = (picture for picture in store.coco_pictures(batches) if picture.image_id in ids)
        parts = coco_parts(pictures, catalogue, description=description, licence=LICENCE)
        yield tree.write_texts(f"{ANNOTATIONS}/instances_{short}.json", parts)


def _radar_previews(plan: DatasetPlan, tree: TreeWriter, records: Sequence[BatchRecord]) -> Iterator[Written]:
    """Write, for each radar with maps, a picture of the frame with the most visible objects, marked."""
    for name, sensor in plan.frame_sensors.items():
        ranked = [record.best_radar_frame[name] for record in records if name in record.best_radar_frame]
        if not ranked:
            continue
        t_ns = max(ranked, key=lambda frame: frame[0])[1]
        p: RadarParameters = sensor.parameters
        mav0 = tree.root / ROOT
        labels = mav0 / plan.folder(name, p.outputs[0]) / RADAR_LABELS / f"{t_ns}.csv"
        map_path = mav0 / plan.folder(name, "range_doppler") / "data" / f"{t_ns}.npy"
        rgb = camera = None
        if p.frame is not None:
            png = mav0 / plan.folder(p.frame, "rgb") / "data" / f"{t_ns}.png"
            bgr = cv2.imread(str(png)) if png.is_file() else None
            if bgr is not None:
                rgb, camera = np.asarray(bgr[:, :, ::-1], np.uint8), plan.config.sensors[p.frame].parameters.model()
        try:
            objects, range_doppler = read_radar_labels(labels.read_bytes()), np.load(map_path)
        except (OSError, ValueError) as error:
            raise RecordingError(f"{map_path}: cannot be read ({error}); continue with --resume") from error
        yield tree.write(f"{PREVIEW}/{name}-map.png", radar_picture(range_doppler, objects, p.seen, rgb, camera))


def _datasheet(
    plan: DatasetPlan,
    store: DatasetStore,
    counts: DatasetCounts,
    split: Split,
    catalogue: Catalogue,
    made_from: Mapping[str, Any],
    previews: Sequence[str],
) -> Datasheet:
    config = plan.config
    by_class: dict[int, list[int]] = {}
    columns = {name: i for i, name in enumerate((*SETS, GUARD))}
    for set_name, objects in zip(split.set_by_frame, counts.objects, strict=False):
        for class_id, n in objects.items():
            by_class.setdefault(class_id, [0] * len(columns))[columns[set_name]] += n
    frames = len(counts.frame_t_ns)
    limits = list(LIMITS)
    if frames < _MIN_FRAMES_WITH_GUARDS:
        limits.append(
            f"With only {frames} frames there are no guard frames between the sets: the last frame of one set is "
            "directly followed by the first of the next, and a set can be empty. Use them to try out tools, not to "
            "evaluate a detector."
        )
    trajectory = config.dataset.trajectory
    course = config.mission or "none"
    if trajectory is not None:
        points = trajectory.preset == "points"
        size = f"{len(trajectory.points_m)} points" if points else f"{trajectory.preset}, {trajectory.side_m:g} m"
        course = f"{size}, at {trajectory.height_m:g} m, {trajectory.speed_mps:g} m/s"
    vehicle = f" --vehicle {plan.vehicle}" if plan.vehicle else ""
    return Datasheet(
        title=f"{plan.bench.scene.name}, {frames} frames",
        about=[
            f"Labelled data of several sensors on a simulated {config.vehicle}, flown by a {config.autopilot.kind} "
            f"flight controller over {plan.bench.scene.name}.",
            f"All sensors share one clock. Times are {made_from['epoch_ns']} ns plus the simulated time in "
            "nanoseconds; samples with equal times were taken at the same moment.",
            *_about_vehicles(plan),
            f"{frames} frames over {(counts.frame_t_ns[-1] - counts.frame_t_ns[0]) / NS_PER_S:.2f} s.",
        ],
        provenance={
            "scene": plan.bench.scene.name,
            "trajectory": course,
            "seed": str(config.seed),
            "quality": plan.quality,
            "bench": f"bench.yaml, sha256 {made_from['config_sha256']}",
            "command": f"hil dataset bench.yaml{vehicle} --frames {frames}",
        },
        sensors=_sensor_rows(plan, counts, store.tables),
        classes=catalogue.classes,
        class_pixels=counts.pixels,
        class_objects=by_class,
        split=split,
        formats=_formats(plan, catalogue),
        pictures=[_preview_picture(store.root, path) for path in previews],
        limits=limits,
    )


def _about_vehicles(plan: DatasetPlan) -> list[str]:
    """Return a paragraph that says which vehicle recorded the data and which others it may see."""
    if not plan.vehicle:
        return []
    others = [f"{name} (instance {instance})" for name, instance in _instances(plan).items()]
    return [
        f"Recorded by the vehicle {plan.vehicle}. In the same world fly, as objects of the class {VEHICLE_CLASS}: "
        f"{', '.join(others) or 'none'}."
    ]


def _preview_picture(root: Path, path: str) -> tuple[str, str, bytes]:
    """Return title, kind (png, jpeg) and bytes of a preview."""
    name, _, kind = Path(path).name.rpartition(".")
    sensor, _, key = name.rpartition("-")
    return f"{sensor}: {_TITLES[key]}", kind, (root / path).read_bytes()


def silent_sensors(
    plan: DatasetPlan, counts: DatasetCounts, tables: Tables, records: Sequence[BatchRecord]
) -> list[str]:
    """Describe the sensors of which the data set holds no sample, and the LiDARs without a point in any."""
    silent = (name for name in plan.config.sensors if not _samples_of(name, plan, counts, tables))
    seconds = (counts.frame_t_ns[-1] - counts.frame_t_ns[0]) / NS_PER_S
    told = [
        f"{name} has no sample in the {seconds:.1f} s from the first frame to the last: see its rate_hz "
        f"({plan.config.sensors[name].rate_hz:g}) and its faults, or ask for more frames"
        for name in silent
    ]
    for name in (name for name, sensor in plan.frame_sensors.items() if sensor.kind == "lidar"):
        folder = f"{ROOT}/{plan.folder(name)}/data/"
        sizes = [file.size for record in records for file in record.files if file.path.startswith(folder)]
        if sizes and not any(sizes):
            told.append(f"{name} has {no_return(len(sizes))}")
    return told


def _samples_of(name: str, plan: DatasetPlan, counts: DatasetCounts, tables: Tables) -> int:
    return counts.samples.get(name, tables.rows.get(plan.folder(name), 0))


def _sensor_rows(plan: DatasetPlan, counts: DatasetCounts, tables: Tables) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, sensor in plan.config.sensors.items():
        p = sensor.parameters
        channels = getattr(p, "channels", None) or getattr(p, "outputs", None) or ()
        preset = PRESETS.get(sensor.preset) if sensor.preset is not None else None
        title = f"{name} ({preset.part})" if preset is not None else name
        folders = ", ".join(dict.fromkeys(f"{ROOT}/{plan.folder(name, channel)}" for channel in channels or ("",)))
        samples = _samples_of(name, plan, counts, tables)
        rows.append((title, folders, ", ".join(channels or (sensor.kind,)), f"{sensor.rate_hz:g}", str(samples)))
    return rows


def _formats(plan: DatasetPlan, catalogue: Catalogue) -> dict[str, str]:
    step_m = plan.config.dataset.depth_step_m
    contents = {
        f"{ROOT}/*/{TABLE}": "ASL (EuRoC): a table of times and values, or of times and files",
        f"{ROOT}/*/sensor.yaml": "intrinsics, mounting on the vehicle (T_BS), rate, noise",
        f"{ROOT}/depth*/data": f"16-bit PNG, steps of {step_m:g} m; 0: no surface, 65535: beyond {65534 * step_m:g} m",
        f"{ROOT}/lidar*/data": "float32 x, y, z [m], intensity; classes and instances in labels/, as in SemanticKITTI",
        f"{ROOT}/radar*/data": "numpy uint16 (receivers, chirps, samples); chirp settings in radar.json",
        f"{ROOT}/radar*/labels": "CSV: class, instance, range, radial speed, direction and power of each object",
        f"{ROOT}/range_doppler*/data": "numpy float32 (chirps, range bins), power in ADC counts squared",
        "Annotations, ImageSets, JPEGImages, SegmentationClass": "Pascal VOC; the pictures are PNGs",
        f"{ANNOTATIONS}/instances_*.json": "COCO with masks: train, val, test, all",
        SPLIT_NAME: "the set of each frame",
        MCAP_NAME: "the whole run as MCAP, ROS 2 messages; pictures are the PNG files' own bytes",
        CHECKSUMS: "size and CRC-32 of every file but the recording and the journal",
        MANIFEST: "provenance and counts",
        JOURNAL: "finished batches, read by `--resume`",
    }
    if plan.formats:
        contents[f"{ROOT}/*/{BOXES}"] = "CSV: the 3-D box of each object that a picture or a sweep shows"
    contents |= {name: form.contents for name, form in zip(plan.joint_formats, forms_of(plan, catalogue), strict=True)}
    if plan.labelled is None:
        contents = {k: v for k, v in contents.items() if "VOC" not in v and "COCO" not in v}
    return contents
