"""`hil view --variants`: one view of a scene under several seeds of `randomize`, on one sheet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.apps.view.appearance import ViewAppearance
from hil.apps.view.points import pose_of
from hil.run.report import figures
from hil.run.report.channel_images import rgb_png
from sim.frame.camera_model import CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames, channel_array
from sim.scene.scene import Scene
from sim.scene.view_point import ViewPoint
from sim.world_loader import load_world

SHEET_NAME = "variants.png"
_COLUMNS = 4
_WIDTH_IN, _TITLE_IN = 13.5, 0.24
_FAR_M = 1000.0


def draw_variants(
    folder: Path, scene: Scene, appearance: ViewAppearance, count: int, point: ViewPoint, camera: CameraModel
) -> list[Path]:
    """Render `count` variants and return the files: the sheet, then each picture as `variant_SEED.png`.

    Raises OSError if a file cannot be written.
    """
    pictures, titles, files = [], [], []
    for number in range(count):
        variant = appearance.variant(number)
        picture, title = _picture(variant.applied_to(scene), variant, point, camera)
        path = folder / f"variant_{variant.randomize.seed}.png"
        path.write_bytes(rgb_png(picture))
        pictures.append(picture)
        titles.append(f"seed {variant.randomize.seed}: {title}")
        files.append(path)
    with figures.style():
        return [figures.save(_sheet(pictures, titles), folder / SHEET_NAME), *files]


def _picture(
    scene: Scene, appearance: ViewAppearance, point: ViewPoint, camera: CameraModel
) -> tuple[NDArray[np.uint8], str]:
    world = load_world(scene)
    frames = SharedFrames(world)
    _, rendering = appearance.rendering((camera.width, camera.height), fixed_size=True)
    frames.expect(0)
    picture: NDArray[np.uint8] = channel_array("rgb", camera)
    pose = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose(pose_of(point))
    try:
        frames.renderer(camera, near_m=0.05, far_m=_FAR_M, **rendering).render(pose, {"rgb": picture})
    finally:
        frames.close()
    visibility_m = scene.weather.visibility_m
    visibility = "clear" if visibility_m is None else f"{visibility_m / 1000.0:.2g} km"
    sun = f"sun {scene.light.sun_elevation_deg:.0f}\N{DEGREE SIGN}"
    return picture, f"{visibility}, {sun}, {len(world.added_people)} people, {len(world.added_objects)} objects"


def _sheet(pictures: list[NDArray[np.uint8]], titles: list[str]) -> Figure:
    columns = min(_COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    height, width = pictures[0].shape[:2]
    tile_in = _WIDTH_IN / columns
    figure = Figure(figsize=(_WIDTH_IN, rows * (tile_in * height / width + _TITLE_IN)), layout="constrained")
    for i, (picture, title) in enumerate(zip(pictures, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, i + 1)
        axes.imshow(picture)
        axes.set_title(title, fontsize=8.5, loc="left")
        axes.set_axis_off()
    return figure
