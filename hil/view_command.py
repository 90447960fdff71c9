"""`hil view`: what sensors would see of a scene, as pictures.

Writes `contact_sheet.png` (every channel from the first place, colour from the others, a LiDAR's sweep, a radar's
frame), one sheet for each place, `PLACE.png`, what a radar makes of it, `PLACE_radar.png`, and every channel alone,
`PLACE_CHANNEL.png`, pixel for pixel. With `--variants N`: `variants.png`, the first place as N seeds make it look.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config.files import available, find, is_bare
from hil.signals.classes import Classes
from hil.signals.documents.validate import nearest
from hil.signals.errors import ConfigError, Problem, RecordingError
from hil.signals.samples import CHANNEL_UNITS, PointCloudSample, RadarSample
from hil.view_looks import ViewLooks, read_looks
from hil.view_points import default_points, extent_of, looking_at, pose_of
from sim.frame.camera_model import MAX_PIXELS_ACROSS, CameraModel
from sim.frame.mount import Mount
from sim.frame.source import FrameSource, SharedFrames, channel_array
from sim.scene.scene import Scene
from sim.scene.view_point import ViewPoint
from sim.sensors.catalog import make_sensor
from sim.sensors.radar import Radar

SHEET_NAME = "contact_sheet.png"
FOV_DEG = 90.0
DEFAULT_SIZE = (640, 480)
_TICK_NS = 4_000_000
_LIDAR, _RADAR = "vlp16", "bgt60tr13c"  # those shown
_FAR_M = 1000.0

Pictures = Mapping[str, NDArray[Any]]


def view_scene(
    name: str,
    out: Path | None = None,
    *,
    seed: int | None = None,
    at: str | None = None,
    look: str | None = None,
    size: str | None = None,
    variants: int = 0,
    settings: Sequence[str] = (),
    load: Callable[[str, int | None], tuple[Scene, Any, FrameSource]] | None = None,
) -> list[Path]:
    """Draw the scene and return the files, the contact sheet first. ConfigError, RecordingError.

    `settings`: of quality, weather and randomize, as a bench takes them.
    """
    looks = read_looks(settings)
    pixels, told = looks.drawing(_size(size), said=size is not None)
    camera = CameraModel.from_fov(*pixels, FOV_DEG)
    place, direction = _numbers("--at", at, 3), _numbers("--look", look, 2)
    scene, world, frames = (load or partial(load_frames, looks=None if variants else looks))(name, seed)
    points = _points(scene, world, frames, place, direction)
    folder = out if out is not None else Path("runs") / f"view-{scene.name}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if variants:
            from hil.view_variants import draw_variants  # matplotlib

            return draw_variants(folder, scene, looks, variants, points[0], camera)
        return _draw(folder, scene, frames, points, camera, told)
    except OSError as error:
        raise RecordingError(f"{folder}: the pictures cannot be written ({error.strerror or error})") from error


def load_frames(name: str, seed: int | None, *, looks: ViewLooks | None = None) -> tuple[Scene, Any, FrameSource]:
    """A scene by name or path, made to look so, its World and its geometry. Raises ConfigError."""
    path = find("scene", name, ())
    if path is None:
        hint = nearest(name, available("scene", ())) if is_bare("scene", name) else "check the path"
        raise ConfigError([Problem("SCENE", f"is unknown: {name!r}", hint)])
    from hil.config.scenes import read_scene
    from sim.scene.world import load_world

    scene, problems = read_scene(path)
    if problems or scene is None:
        raise ConfigError(problems)
    world = load_world(scene if looks is None else looks.of(scene), map_seed=seed)
    return world.scene, world, SharedFrames(world)


def _points(
    scene: Scene, world: Any, frames: FrameSource, at: Sequence[float] | None, look: Sequence[float] | None
) -> Sequence[ViewPoint]:
    """The one asked for, those of the scene's file, or those found."""
    if at is None and look is None:
        return scene.view or default_points(frames, extent_of(world))
    if at is None:
        raise ConfigError([Problem("--look", "needs --at X,Y,Z too")])
    x, y, z = at
    if look is None:
        middle = extent_of(world).middle
        return (looking_at("here", (x, y, z), (middle[0], middle[1], 0.0)),)
    yaw, pitch = look
    if not (abs(yaw) <= 360.0 and abs(pitch) <= 90.0):
        raise ConfigError(
            [Problem("--look", f"must be a yaw within 360 and a pitch within 90 degrees, not {yaw:g},{pitch:g}")]
        )
    return (ViewPoint(name="here", at_m=(x, y, z), look_deg=(yaw, pitch)),)


def _draw(
    folder: Path,
    scene: Scene,
    frames: FrameSource,
    points: Sequence[ViewPoint],
    camera: CameraModel,
    told: Mapping[str, Any],
) -> list[Path]:
    from hil.report import figures, frame_pictures, radar_pictures  # half a second of matplotlib, paid after all checks

    fits = told["supersample"] * max(camera.width, camera.height) <= MAX_PIXELS_ACROSS
    renderer = frames.renderer(camera, near_m=0.05, far_m=_FAR_M, **(told if fits else {**told, "supersample": 1}))
    mount = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    files: list[Path] = []
    seen: dict[str, Pictures] = {}
    heard: list[RadarSample] = []
    with figures.style():
        for point in points:
            frames.expect(0)
            pictures = {name: channel_array(name, camera) for name in CHANNEL_UNITS}
            renderer.render(mount.pose(pose_of(point)), pictures)
            seen[point.name] = pictures
            files += _single_pictures(folder, point.name, pictures, frames.classes)
            path = folder / f"{point.name}.png"
            figures.save(frame_pictures.channels_figure(_title(scene, point), pictures, frames.classes), path)
            files.append(path)
            radar, echoes = _radar_frame(scene, frames, point)
            heard.append(echoes)
            path = folder / f"{point.name}_radar.png"
            figures.save(radar_pictures.radar_figure(_title(scene, point), echoes.channels, radar.chirp), path)
            files.append(path)
        cloud = _sweep(scene, frames, points[0])

        def radar_panel(panel: Any) -> None:
            name = f"radar at {points[0].name}, range-Doppler"
            radar_pictures.draw_map(panel, heard[0].channels["range_doppler"], radar.chirp, name, plain_axes=True)

        sheet = folder / SHEET_NAME
        figure = frame_pictures.sheet_figure(
            [(point, _title(scene, point), seen[point.name]) for point in points],
            cloud,
            frames.classes,
            more=(radar_panel,),
        )
        figures.save(figure, sheet)
    return [sheet, *files]


def _single_pictures(folder: Path, name: str, pictures: Pictures, classes: Classes) -> list[Path]:
    import cv2

    from hil.report.frame_pictures import coloured

    files = []
    for channel, picture in pictures.items():
        path = folder / f"{name}_{channel}.png"
        rgb = coloured(channel, picture, classes)
        done, data = cv2.imencode(".png", np.ascontiguousarray(rgb[:, :, ::-1]))
        assert done
        path.write_bytes(data.tobytes())
        files.append(path)
    return files


def _sweep(scene: Scene, frames: FrameSource, point: ViewPoint) -> PointCloudSample:
    """One sweep of a LiDAR that stands level there."""
    lidar = make_sensor("lidar", preset=_LIDAR, rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, frames=frames)
    level = ViewPoint(name=point.name, at_m=point.at_m, look_deg=(point.look_deg[0], 0.0))
    sample = lidar.sample(pose_of(level), 0)
    assert isinstance(sample, PointCloudSample)
    return sample


def _radar_frame(scene: Scene, frames: FrameSource, point: ViewPoint) -> tuple[Radar, RadarSample]:
    """One frame of a radar that looks along the view, with what stands still left in."""
    radar = make_sensor(
        "radar",
        preset=_RADAR,
        rate_hz=10.0,
        seed=1,
        scene=scene,
        step_ns=_TICK_NS,
        overrides={"processing": {"clutter": "none"}, "outputs": ["range_doppler", "points"]},
        frames=frames,
    )
    assert isinstance(radar, Radar)
    return radar, radar.sample(pose_of(point), 0)


def _title(scene: Scene, point: ViewPoint) -> str:
    x, y, z = point.at_m
    yaw, pitch = point.look_deg
    return f"{scene.name}, {point.name}: at ({x:.1f}, {y:.1f}, {z:.1f}) m, yaw {yaw:.0f}, pitch {pitch:.0f} degrees"


def _size(text: str | None) -> tuple[int, int]:
    if text is None:
        return DEFAULT_SIZE
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX]\s*(\d{1,6})\s*", text)
    sides = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(1 <= side <= MAX_PIXELS_ACROSS for side in sides):
        raise ConfigError(
            [Problem("--size", f"must be WIDTHxHEIGHT, 1 to {MAX_PIXELS_ACROSS} pixels each, not {text!r}", "320x240")]
        )
    return sides


def _numbers(option: str, text: str | None, count: int) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(v) and abs(v) <= 50_000.0 for v in values):
        message = f"must be {count} numbers from -50000 to 50000 with commas between, not {text!r}"
        raise ConfigError([Problem(option, message)])
    return values
