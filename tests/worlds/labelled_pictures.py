"""Small labelled pictures, laid out as `hil dataset` lays them out: coloured rectangles on noise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

COLOURS = {"person": (220, 30, 60), "vehicle": (30, 60, 220)}  # RGB
SIZE_PX = (320, 240)
Object = tuple[str, tuple[int, int, int, int]]  # label; x, y, width, height


def picture(rng: np.random.Generator, objects: list[Object], size: tuple[int, int] = SIZE_PX) -> np.ndarray:
    rgb = rng.integers(90, 140, (size[1], size[0], 3)).astype(np.uint8)
    for label, (x, y, w, h) in objects:
        rgb[y : y + h, x : x + w] = COLOURS[label]
    return rgb


def some_objects(rng: np.random.Generator, count: int = 3) -> list[Object]:
    """Return tall people and wide vehicles, each in a column of its own so that none hides another."""
    found: list[Object] = []
    for i in range(count):
        label = ("person", "vehicle")[int(rng.integers(2))]
        w, h = (14, 34) if label == "person" else (44, 22)
        x = 10 + i * (300 // count) + int(rng.integers(0, max(1, 300 // count - w - 6)))
        found.append((label, (x, int(rng.integers(10, 190)), w, h)))
    return found


def write_data_set(folder: Path, frames: list[list[Object]], *, seed: int = 1) -> Path:
    """Write PNGs, COCO and VOC labels, and a split of 3/5, 1/5 and 1/5."""
    rng = np.random.default_rng(seed)
    (folder / "mav0/cam0/data").mkdir(parents=True)
    (folder / "annotations").mkdir()
    (folder / "Annotations").mkdir()
    (folder / "JPEGImages").symlink_to(Path("mav0/cam0/data"))
    names = {name: i + 1 for i, name in enumerate(COLOURS)}
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for i, objects in enumerate(frames):
        stem = f"{1000 + i}"
        rgb = picture(rng, objects)
        cv2.imwrite(str(folder / f"mav0/cam0/data/{stem}.png"), rgb[:, :, ::-1])
        images.append(
            {"id": i + 1, "file_name": f"mav0/cam0/data/{stem}.png", "width": SIZE_PX[0], "height": SIZE_PX[1]}
        )
        size = f"<width>{SIZE_PX[0]}</width><height>{SIZE_PX[1]}</height>"
        xml = f"<annotation><filename>{stem}.png</filename><size>{size}</size>"
        for label, (x, y, w, h) in objects:
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": i + 1,
                    "category_id": names[label],
                    "bbox": [x, y, w, h],
                    "area": w * h,
                    "iscrowd": 0,
                }
            )
            xml += (
                f"<object><name>{label}</name><difficult>{int(w * h < 64)}</difficult><bndbox><xmin>{x + 1}</xmin>"
                f"<ymin>{y + 1}</ymin><xmax>{x + w}</xmax><ymax>{y + h}</ymax></bndbox></object>"
            )
        (folder / "Annotations" / f"{stem}.xml").write_text(xml + "</annotation>")
    categories = [{"id": i, "name": name} for name, i in names.items()]
    write_coco(folder, {"images": images, "annotations": annotations, "categories": categories})
    parts = ["train"] * 3 + ["validation", "test"]
    rows = "".join(f"{i},{parts[i % 5]}\n" for i in range(len(frames)))
    (folder / "split.csv").write_text("#frame,set\n" + rows)
    return folder


def coco(folder: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((folder / "annotations/instances_all.json").read_text())
    return data


def write_coco(folder: Path, data: dict[str, Any]) -> None:
    (folder / "annotations/instances_all.json").write_text(json.dumps(data))
