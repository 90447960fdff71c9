"""Labelled pictures of recorded data sets.

They are read from a folder of `hil dataset`, or any folder of the same layout: `annotations/instances_all.json` (COCO)
or, if that is missing, `Annotations/*.xml` (Pascal VOC), with `split.csv` or `ImageSets/Main` for the three sets.
Difficult objects are marked: VOC's `difficult`, COCO's crowds, and objects with fewer visible pixels than
`DIFFICULT_BELOW_PX`. In training and evaluation, detecting or missing them has no effect.
"""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hil.data_set_files import ANNOTATIONS, DIFFICULT_BELOW_PX, IMAGE_SETS, IMAGES
from signals.errors import ConfigError, Problem

PARTS = ("train", "validation", "test", "all")
_COCO = "annotations/instances_all.json"
_SPLIT = "split.csv"
_VOC_PARTS = {"train": "train", "validation": "val", "test": "test"}
_MAX_PROBLEMS = 20  # reported in one error


@dataclass(frozen=True)
class Picture:
    """One picture's file, size and objects; boxes are x0, y0, x1, y1 in pixels, so x1 - x0 is the width."""

    path: Path
    width: int
    height: int
    boxes_px: NDArray[np.float32]  # (n, 4)
    labels: tuple[str, ...]
    difficult: NDArray[np.bool_]  # (n,)
    # (n,) Visible area. In training it is scaled with the picture, and a small one makes the object difficult. A crowd
    # has 0, so that it is difficult at any scale.
    area_px: NDArray[np.float32]


def read_data_sets(folders: Sequence[Path], part: str = "all", *, classes: Sequence[str] = ()) -> list[Picture]:
    """Return the pictures of one of `PARTS`, in the order of folders and frames.

    `classes` are the allowed class names; none given allows any. Raises ConfigError with all problems found, or if
    there is no picture.
    """
    if part not in PARTS:
        raise ConfigError.at(part, "is not a set of pictures", f"there are {', '.join(PARTS)}")
    problems: list[Problem] = []
    pictures: list[Picture] = []
    for folder in folders:
        try:
            pictures += _read(folder, part, problems)
        except OSError as error:
            problems.append(Problem(str(error.filename or folder), f"cannot be read ({error.strerror or error})"))
    if classes:
        unknown = sorted({n for p in pictures for n in p.labels} - set(classes))
        if unknown:
            known = ", ".join(classes)
            problems.append(
                Problem(_folders_text(folders), f"has classes unknown here: {', '.join(unknown)}", f"known: {known}")
            )
    if not problems and not pictures:
        problems.append(Problem(_folders_text(folders), f"no pictures in the set '{part}'", "record more frames"))
    if problems:
        more = len(problems) - _MAX_PROBLEMS
        shown = problems[:_MAX_PROBLEMS]
        raise ConfigError([*shown, Problem("labels", f"{more} more problems of this kind")] if more > 0 else shown)
    return pictures


def with_smallest(pictures: Iterable[Picture], smallest_px: float) -> list[Picture]:
    """Return the pictures with objects of fewer than `smallest_px` visible pixels marked as difficult, too."""
    return [replace(p, difficult=p.difficult | (p.area_px < smallest_px)) for p in pictures]


def class_counts(pictures: Iterable[Picture]) -> Counter[str]:
    """Return the number of objects of each class, without difficult ones."""
    objects = (pair for p in pictures for pair in zip(p.labels, p.difficult, strict=True))
    return Counter(name for name, difficult in objects if not difficult)


def _folders_text(folders: Sequence[Path]) -> str:
    return f"{folders[0]}{' ...' if len(folders) > 1 else ''}" if folders else "data sets"


def _read(folder: Path, part: str, problems: list[Problem]) -> list[Picture]:
    if not folder.is_dir():
        problems.append(Problem(str(folder), "there is no such folder", "give folders that `hil dataset` has written"))
        return []
    problems_before = len(problems)
    coco = folder / _COCO
    if coco.is_file():
        pictures = _read_coco(coco, folder, problems)
    elif (folder / ANNOTATIONS).is_dir():
        pictures = _read_voc(folder, problems)
    else:
        hint = "give folders that `hil dataset` has written with a camera of rgb, segmentation and instance"
        problems.append(Problem(str(folder), f"holds neither {_COCO} nor {ANNOTATIONS}/", hint))
        return []
    if not pictures:
        if len(problems) == problems_before:
            problems.append(Problem(str(folder), "holds no pictures", "record more frames, or leave it out"))
        return []
    if part == "all":
        return pictures
    numbers = _frame_numbers(folder, part, [p.path.stem for p in pictures], problems)
    return [p for i, p in enumerate(pictures) if i in numbers]


def _frame_numbers(folder: Path, part: str, stems: Sequence[str], problems: list[Problem]) -> set[int]:
    """Return the numbers of the frames in a set, by split.csv or else by VOC's lists of names."""
    split, names = folder / _SPLIT, folder / IMAGE_SETS / f"{_VOC_PARTS[part]}.txt"
    if split.is_file():
        try:
            rows = [row for row in csv.reader(split.read_text().splitlines()) if row and not row[0].startswith("#")]
            return {int(frame) for frame, set_name in rows if set_name == part}
        except ValueError:
            problems.append(Problem(str(split), "is not a table of frames and sets", "frame,set on each line"))
            return set()
    if names.is_file():
        stems_in_set = set(names.read_text().split())
        return {i for i, stem in enumerate(stems) if stem in stems_in_set}
    hint = "record it with `hil dataset`, or take all of it with --part all"
    problems.append(Problem(str(folder), f"assigns no pictures to sets: it has no {_SPLIT} and no {IMAGE_SETS}", hint))
    return set()


def _read_coco(file: Path, folder: Path, problems: list[Problem]) -> list[Picture]:
    try:
        data = json.loads(file.read_text())
        names = {c["id"]: str(c["name"]) for c in data["categories"]}
        by_image: dict[Any, list[dict[str, Any]]] = {image["id"]: [] for image in data["images"]}
        for a in data["annotations"]:
            if a["image_id"] not in by_image:
                problems.append(Problem(str(file), f"annotation {a['id']}: there is no image {a['image_id']}"))
            elif a["category_id"] not in names:
                problems.append(Problem(str(file), f"annotation {a['id']}: there is no category {a['category_id']}"))
            else:
                by_image[a["image_id"]].append(a)
        pictures = []
        for image in data["images"]:
            objects = []
            for a in by_image[image["id"]]:
                x, y, w, h = (float(v) for v in a["bbox"])
                area = 0.0 if a.get("iscrowd", 0) else float(a.get("area", w * h))
                objects.append((names[a["category_id"]], (x, y, x + w, y + h), area))
            where = f"{file}: image {image['id']}"
            size = (int(image["width"]), int(image["height"]))
            pictures += _checked_picture(folder / str(image["file_name"]), size, objects, where, problems)
        return pictures
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        problems.append(Problem(str(file), f"is not a COCO file of objects ({type(error).__name__}: {error})"))
        return []


def _read_voc(folder: Path, problems: list[Problem]) -> list[Picture]:
    pictures = []
    for file in sorted((folder / ANNOTATIONS).glob("*.xml")):
        try:
            root = ElementTree.fromstring(file.read_bytes())  # noqa: S314  the user's own files; expat refuses bombs
            size = (int(_text(root, "size/width")), int(_text(root, "size/height")))
            objects = []
            for o in root.iter("object"):
                x0, y0, x1, y1 = (float(_text(o, f"bndbox/{k}")) for k in ("xmin", "ymin", "xmax", "ymax"))
                # VOC has no areas, only `difficult`; an object fills about half of its box.
                area = 0.5 * (x1 - x0 + 1.0) * (y1 - y0 + 1.0)
                difficult = (o.findtext("difficult") or "0").strip() == "1"
                area = min(area, DIFFICULT_BELOW_PX - 1.0) if difficult else max(area, float(DIFFICULT_BELOW_PX))
                objects.append((_text(o, "name"), (x0 - 1.0, y0 - 1.0, x1, y1), area))
            pictures += _checked_picture(folder / IMAGES / _text(root, "filename"), size, objects, str(file), problems)
        except (ElementTree.ParseError, ValueError) as error:
            problems.append(Problem(str(file), f"is not a VOC annotation ({error})"))
    return pictures


def _text(element: ElementTree.Element, path: str) -> str:
    text = element.findtext(path)
    if text is None or not text.strip():
        raise ValueError(f"no {path}")
    return text.strip()


def _checked_picture(
    path: Path,
    size: tuple[int, int],
    objects: Sequence[tuple[str, tuple[float, float, float, float], float]],
    where: str,
    problems: list[Problem],
) -> list[Picture]:
    """Return a list with the picture, or an empty list if problems were found and added to `problems`."""
    problems_before = len(problems)
    if not path.is_file():
        problems.append(Problem(where, f"its picture {path} is not there"))
    if min(size) < 1:
        problems.append(Problem(where, f"declares an empty picture of {size[0]} x {size[1]} pixels"))
    for name, box, _ in objects:
        x0, y0, x1, y1 = box
        inside = 0.0 <= x0 < x1 <= size[0] and 0.0 <= y0 < y1 <= size[1]
        if not (all(math.isfinite(v) for v in box) and inside):
            text = ", ".join(f"{v:g}" for v in box)
            problems.append(
                Problem(where, f"{name}: the box ({text}) is empty or not in the picture of {size[0]} x {size[1]}")
            )
    if len(problems) > problems_before:
        return []
    boxes = np.array([box for _, box, _ in objects], np.float32).reshape(-1, 4)
    areas = np.array([area for _, _, area in objects], np.float32)
    names = tuple(name for name, _, _ in objects)
    return [Picture(path, size[0], size[1], boxes, names, areas < DIFFICULT_BELOW_PX, areas)]
