"""`hil view`: pictures of a scene as cameras, a LiDAR and a radar sense it.

Writes `contact_sheet.png` (every channel from the first view point, colour from the others, a LiDAR sweep and a radar
frame), and for each view point a sheet of its channels, `POINT.png`, a radar frame, `POINT_radar.png`, and each channel
pixel for pixel, `POINT_CHANNEL.png`; from the first one also a revolution of a spinning radar,
`POINT_spinning_radar.png`. With `--variants N` it writes `variants.png` instead: the first view point under N seeds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from hil.apps.view.appearance import ViewAppearance, read_appearance
from hil.apps.view.points import default_points, extent_of, looking_at, pose_of
from hil.config.files import available, find, is_bare
from hil.run.report.run_folder import run_folder
from signals.classes import Classes
from signals.documents.validate import nearest
from signals.errors import ConfigError, file_errors
from signals.samples import CHANNEL_UNITS, PointCloudSample, RadarSample
from sim.frame.camera_model import MAX_PIXELS_ACROSS, CameraModel
from sim.frame.mount import Mount
from sim.frame.source import SharedFrames, channel_array
from sim.scene.scene import Scene
from sim.scene.view_point import ViewPoint
from sim.sensors.catalog import make_sensor
from sim.sensors.radar import Radar
from sim.sensors.sensor import Installation
from sim.sensors.spinning_radar import SpinningRadar

SHEET_NAME = "contact_sheet.png"
FOV_DEG = 90.0
DEFAULT_SIZE = (640, 480)
_TICK_NS = 4_000_000
_LIDAR, _RADAR, _SPINNING_RADAR = "vlp16", "bgt60tr13c", "navtech_cts350x"  # presets of the sensors shown
_FAR_M = 1000.0

Pictures = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class ViewCamera:
    """The camera's options as text. None stands for the view points of the scene, and for 640 x 480 pixels."""

    at: str | None = None  # 'X,Y,Z' [m]
    look: str | None = None  # 'YAW,PITCH' [deg], from east to north and downwards
    size: str | None = None  # 'WxH' [px]


def view_scene(
    name: str,
    out: Path | None = None,
    camera: ViewCamera = ViewCamera(),
    *,
    seed: int | None = None,
    variants: int = 0,
    settings: Sequence[str] = (),
    load: Callable[[str, int | None], tuple[Scene, Any, SharedFrames]] | None = None,
) -> list[Path]:
    """Render the scene into `out` (default runs/view-SCENE) and return the files, the contact sheet first.

    `name` is a scene's name or file; `settings` are `KEY=VALUE` texts for quality, colour, weather and randomize.
    Raises ConfigError for wrong options, RecordingError if the pictures cannot be written, ColourBackendError if the
    renderer of the colour is missing.
    """
    appearance = read_appearance(settings)
    size, rendering = appearance.rendering(_size(camera.size), fixed_size=camera.size is not None)
    model = CameraModel.from_fov(*size, FOV_DEG)
    position, direction = _numbers("--at", camera.at, 3), _numbers("--look", camera.look, 2)
    scene, world, frames = (load or partial(load_frames, appearance=None if variants else appearance))(name, seed)
    points = _points(scene, world, frames, position, direction)
    folder = out if out is not None else Path("runs") / f"view-{scene.name}"
    with file_errors(folder, "the pictures cannot be written"), run_folder(folder):
        if variants:
            from hil.apps.view.variants import draw_variants  # matplotlib

            return draw_variants(folder, scene, appearance, variants, points[0], model)
        try:
            return _write_pictures(folder, scene, frames, points, model, rendering)
        finally:
            frames.close()


def load_frames(
    name: str, seed: int | None, *, appearance: ViewAppearance | None = None
) -> tuple[Scene, Any, SharedFrames]:
    """Load a scene by name or path, with an appearance, and return it with its World and its geometry.

    `seed` replaces the seed of a generated map. Raises ConfigError.
    """
    path = find("scene", name, ())
    if path is None:
        hint = nearest(name, available("scene", ())) if is_bare("scene", name) else "check the path"
        raise ConfigError.at("SCENE", f"is unknown: {name!r}", hint)
    from hil.config.scenes import read_scene
    from sim.world_loader import load_world

    scene, problems = read_scene(path)
    if problems or scene is None:
        raise ConfigError(problems)
    world = load_world(scene if appearance is None else appearance.applied_to(scene), map_seed=seed)
    return world.scene, world, SharedFrames(world)


def _points(
    scene: Scene, world: Any, frames: SharedFrames, at: Sequence[float] | None, look: Sequence[float] | None
) -> Sequence[ViewPoint]:
    """Return the view point given by the options, else those of the scene's file, else the default ones."""
    if at is None and look is None:
        return scene.view or default_points(frames, extent_of(world))
    if at is None:
        raise ConfigError.at("--look", "needs --at X,Y,Z too")
    x, y, z = at
    if look is None:
        middle = extent_of(world).middle
        return (looking_at("here", (x, y, z), (middle[0], middle[1], 0.0)),)
    yaw, pitch = look
    if not (abs(yaw) <= 360.0 and abs(pitch) <= 90.0):
        raise ConfigError.at("--look", f"must be a yaw within 360 and a pitch within 90 degrees, not {yaw:g},{pitch:g}")
    return (ViewPoint(name="here", at_m=(x, y, z), look_deg=(yaw, pitch)),)


def _write_pictures(
    folder: Path,
    scene: Scene,
    frames: SharedFrames,
    points: Sequence[ViewPoint],
    camera: CameraModel,
    rendering: Mapping[str, Any],
) -> list[Path]:
    from hil.run.report import (  # imported late: matplotlib takes half a second
        figures,
        frame_pictures,
        radar_pictures,
    )

    fits = rendering["supersample"] * max(camera.width, camera.height) <= MAX_PIXELS_ACROSS
    rendering = rendering if fits else {**rendering, "supersample": 1}
    renderer = frames.renderer(camera, near_m=0.05, far_m=_FAR_M, **rendering)
    mount = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    files: list[Path] = []
    rendered: dict[str, Pictures] = {}
    radar_samples: list[RadarSample] = []
    with figures.style():
        for point in points:
            frames.expect(0)
            pictures = {name: channel_array(name, camera) for name in CHANNEL_UNITS}
            renderer.render(mount.pose(pose_of(point)), pictures)
            rendered[point.name] = pictures
            files += _single_pictures(folder, point.name, pictures, frames.classes)
            figure = frame_pictures.channels_figure(_title(scene, point), pictures, frames.classes)
            files.append(figures.save(figure, folder / f"{point.name}.png"))
            radar, sample = _radar_frame(scene, frames, point)
            radar_samples.append(sample)
            figure = radar_pictures.radar_figure(_title(scene, point), sample.channels, radar.seen)
            files.append(figures.save(figure, folder / f"{point.name}_radar.png"))
        figure = _revolution(scene, frames, points[0])
        files.append(figures.save(figure, folder / f"{points[0].name}_spinning_radar.png"))
        cloud = _sweep(scene, frames, points[0])

        def radar_panel(panel: Any) -> None:
            name = f"radar at {points[0].name}, range-Doppler"
            range_doppler = radar_samples[0].channels["range_doppler"]
            radar_pictures.draw_map(panel, range_doppler, radar.seen, name, plain_axes=True)

        figure = frame_pictures.sheet_figure(
            [(point, _title(scene, point), rendered[point.name]) for point in points],
            cloud,
            frames.classes,
            more=(radar_panel,),
        )
        return [figures.save(figure, folder / SHEET_NAME), *files]


def _single_pictures(folder: Path, name: str, pictures: Pictures, classes: Classes) -> list[Path]:
    from hil.run.report.channel_images import rgb_png
    from hil.run.report.frame_pictures import coloured

    files = []
    for channel, picture in pictures.items():
        path = folder / f"{name}_{channel}.png"
        path.write_bytes(rgb_png(coloured(channel, picture, classes)))
        files.append(path)
    return files


def _sweep(scene: Scene, frames: SharedFrames, point: ViewPoint) -> PointCloudSample:
    """Take one sweep of a level LiDAR at a view point."""
    lidar = make_sensor(
        Installation("lidar", rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, frames=frames), preset=_LIDAR
    )
    level = ViewPoint(name=point.name, at_m=point.at_m, look_deg=(point.look_deg[0], 0.0))
    sample = lidar.sample(pose_of(level), 0)
    assert isinstance(sample, PointCloudSample)
    return sample


def _revolution(scene: Scene, frames: SharedFrames, point: ViewPoint) -> Any:
    """Draw one revolution of a level spinning radar at a view point."""
    from hil.run.report import radar_pictures

    radar = make_sensor(
        Installation("spinning", rate_hz=4.0, seed=1, scene=scene, step_ns=_TICK_NS, frames=frames),
        preset=_SPINNING_RADAR,
        overrides={"rolling": False},
    )
    assert isinstance(radar, SpinningRadar)
    level = ViewPoint(name=point.name, at_m=point.at_m, look_deg=(point.look_deg[0], 0.0))
    sample = radar.sample(pose_of(level), 0)
    return radar_pictures.revolution_figure(_title(scene, level), radar.polar, radar.beam, sample.points_L)


def _radar_frame(scene: Scene, frames: SharedFrames, point: ViewPoint) -> tuple[Radar, RadarSample]:
    """Take one frame of a radar that faces along the view, without clutter removal."""
    radar = make_sensor(
        Installation("radar", rate_hz=10.0, seed=1, scene=scene, step_ns=_TICK_NS, frames=frames),
        preset=_RADAR,
        overrides={"processing": {"clutter": "none"}, "outputs": ["range_doppler", "points"]},
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
        raise ConfigError.at(
            "--size", f"must be WIDTHxHEIGHT, 1 to {MAX_PIXELS_ACROSS} pixels each, not {text!r}", "320x240"
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
        raise ConfigError.at(option, f"must be {count} numbers from -50000 to 50000 with commas between, not {text!r}")
    return values
