"""Error of the raster's colour against the path tracer, by setting, beside its cost; a part of `hil bench photo`.

Both draw the same geometry with the same textures, from the same poses. The path tracer's codes are turned back into
light by its own curve; the raster's light is its picture with the linear curve. One factor for all pictures of a
setting, the ratio of the means of both lights, matches the exposure. Sky and clipped pixels do not count, nor do views
from inside a closed house, which only the path tracer shows dark.

    light    mean absolute difference of the light of red, green and blue, in % of its mean
    codes    mean absolute difference after both went through the path tracer's curve, 0 to 255
    ssim     structural similarity of the luma codes (Wang et al., IEEE Trans. Image Process. 13, 2004) in windows of
             7 x 7 pixels: edges, texture and shadows

Rows of the tone curve compare the codes of that curve with those of the path tracer's, at the exposure that gives both
pictures the same mean. The first row is the difference between path-traced pictures with different numbers of paths.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import Row, ShowStatus, TextTable
from hil.apps.bench_suite.sensors.raster_cases import Case, View, scene_case
from hil.apps.bench_suite.timing import one_core
from signals.errors import RecordingError
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced import tone
from sim.frame.path_traced.renderer import PathTracedRenderer, PathTracer, tracer_of
from sim.frame.renderer import FrameRenderer
from sim.frame.shading import FULL, MEAN_COLOURS, OCCLUDED, PLAIN, Shading

SCENES = ("city_park", "urban_delivery")
_SIZE, _FOV_DEG = (320, 240), 90.0
_PATHS, _OTHER_PATHS = 64, 32
_ROUNDS = 7
_WINDOW_PX = 7
_DARKER_EV = -1.0  # of the raster's pictures, so that hardly a pixel is clipped
_CLIPPED, _MIN_LIGHT = 250, 0.01
LEVELS = ("low", "medium", "high", "epic")

Float = NDArray[np.float64]
Curve = Callable[[Float], Float]  # from linear light to the linear value of the code


def _linear(light: Float) -> Float:
    return np.minimum(light, 1.0)


def _filmic(light: Float) -> Float:
    """Return the raster's filmic curve (sim/native/frame/resolve.hpp)."""
    x = 0.723 * light
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


@dataclass(frozen=True)
class Setting:
    """Settings of the raster whose error is measured. `curve`: of its codes; without, they are of the path tracer's."""

    shading: Shading
    shadows: bool = True
    supersample: int = 1
    curve: Curve | None = None


SETTINGS: dict[str, Setting] = {
    "low": Setting(MEAN_COLOURS, shadows=False),
    "medium": Setting(PLAIN, shadows=False),
    "medium, shadows": Setting(PLAIN),
    "high": Setting(FULL),
    "high without shadows": Setting(FULL, shadows=False),
    "high without filtering": Setting(replace(FULL, filtering=False)),
    "high without highlights": Setting(replace(FULL, highlights=False)),
    "high without relief": Setting(replace(FULL, relief=False)),
    "high, ambient occlusion": Setting(OCCLUDED),
    "high, 4 samples": Setting(FULL, supersample=2),
    "epic": Setting(OCCLUDED, supersample=2),
    "high, tone linear": Setting(replace(FULL, tone="linear"), curve=_linear),
    "high, tone filmic": Setting(FULL, curve=_filmic),
}


@dataclass(frozen=True)
class Reference:
    """Path-traced pictures of a scene as light, and the pixels that count."""

    light: list[Float]  # (height, width, 3), 1 is white
    other: list[Float]  # with another number of paths
    counted: list[NDArray[np.bool_]]


@dataclass(frozen=True)
class Errors:
    """Errors of one setting in one scene; the units are those of the module's text."""

    light: float
    codes: float
    ssim: float


def measure_colour(*, quick: bool, status: ShowStatus, seed: int) -> tuple[list[Row], TextTable]:
    """Return a row per scene and setting, and their table.

    Raises PathTracerError without the extra, RecordingError if no pixel counts.
    """
    rows: list[Row] = []
    table = TextTable(
        ("raster against path tracer", "light [%]", "codes", "ssim", "time [ms]"),
        [],
        f"colour at {_SIZE[0]} x {_SIZE[1]}; light, codes: mean absolute difference at matched exposure; time: of "
        "one core",
    )
    for name in SCENES[:1] if quick else SCENES:
        status(f"{name}: colour of the path tracer")
        case = scene_case(name, views=3 if quick else 6, seed=seed)
        geometry = FrameGeometry(case.world)
        camera = CameraModel.from_fov(*_SIZE, _FOV_DEG)
        tracer = tracer_of(geometry)
        try:
            views, reference = _reference(case, geometry, camera, tracer)
        finally:
            tracer.close()
        status(f"{name}: colour of the raster")
        case = replace(case, views=tuple(views))
        times_s = _times(case, geometry, camera)
        found = {f"path tracer, {_OTHER_PATHS} paths": _errors(reference.other, reference)}
        found |= {
            text: _errors(_raster_light(case, geometry, camera, setting), reference, setting.curve)
            for text, setting in SETTINGS.items()
        }
        for text, errors in found.items():
            time_s = times_s.get(text, math.nan)
            details = {"codes": errors.codes, "ssim": errors.ssim}
            rows.append(Row(f"{name}, colour", text, errors.light, "% of the mean light", time_s, details))
            cells = (
                f"{errors.light:.1f}",
                f"{errors.codes:.1f}",
                f"{errors.ssim:.3f}",
                "-" if math.isnan(time_s) else f"{1e3 * time_s:.2f}",
            )
            table.rows.append((f"{name}, {text}", *cells))
    return rows, table


def _reference(
    case: Case, geometry: FrameGeometry, camera: CameraModel, tracer: PathTracer
) -> tuple[list[View], Reference]:
    """Return the views that count and their pictures. Raises RecordingError if no pixel counts."""
    native = FrameRenderer(geometry, camera)
    few, many = (PathTracedRenderer(native, tracer, samples=paths) for paths in (_OTHER_PATHS, _PATHS))
    out = native.buffers("rgb", "geom")
    views: list[View] = []
    reference = Reference([], [], [])
    for view in case.views:
        geometry.expect(view.t_ns)
        few.render(view.pose, out)
        other = _light_of(out["rgb"])
        if other.mean() < _MIN_LIGHT:
            continue
        many.render(view.pose, out)
        views.append(view)
        reference.other.append(other)
        reference.light.append(_light_of(out["rgb"]))
        reference.counted.append((out["geom"] >= 0) & (out["rgb"] < _CLIPPED).all(axis=2))
    if not any(counted.any() for counted in reference.counted):
        raise RecordingError(
            f"{case.name}: no pixel of the path tracer's pictures from {len(case.views)} viewpoints counts: all are "
            "dark, clipped or of the sky; choose other viewpoints (another seed)"
        )
    return views, reference


def _light_of(rgb: NDArray[np.uint8]) -> Float:
    """Return the light of a path-traced picture, by the inverse of its curve."""
    light = np.linspace(0.0, 1.0, 8192) ** 3 * 7.0
    return np.interp(_decoded(rgb), tone.curve(light), light)


def _raster_light(case: Case, geometry: FrameGeometry, camera: CameraModel, setting: Setting) -> list[Float]:
    shading = replace(setting.shading, tone="linear", exposure_ev=_DARKER_EV)
    renderer = _renderer(geometry, camera, replace(setting, shading=shading))
    out = renderer.buffers("rgb")
    pictures = []
    for view in case.views:
        _draw(geometry, renderer, view, out)
        pictures.append(_decoded(out["rgb"]) / 2.0**_DARKER_EV)
    return pictures


def _errors(light: list[Float], reference: Reference, curve: Curve | None = None) -> Errors:
    """Return the errors of pictures in linear light, as codes of `curve` or of the path tracer's."""
    own = np.concatenate([one[counted] for one, counted in zip(light, reference.counted, strict=True)])
    right = np.concatenate([one[counted] for one, counted in zip(reference.light, reference.counted, strict=True)])
    factor = right.mean() / own.mean()
    shown = factor if curve is None else _factor_for(curve, own, tone.curve(right).mean())
    codes, similar = [], []
    for one, other, counted in zip(light, reference.light, reference.counted, strict=True):
        a, b = _encoded((curve or tone.curve)(shown * one)), _encoded(tone.curve(other))
        codes.append(np.abs(a - b)[counted])
        similar.append(_ssim(_luma(a), _luma(b))[counted])
    return Errors(
        100.0 * float(np.abs(factor * own - right).mean() / right.mean()),
        float(np.concatenate(codes).mean()),
        float(np.concatenate(similar).mean()),
    )


def _factor_for(curve: Curve, light: Float, mean: float) -> float:
    """Return the exposure at which the mean of a rising curve of the light is `mean`, by bisection."""
    low, high = -6.0, 6.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if curve(2.0**middle * light).mean() > mean else (middle, high)
    return float(2.0**low)


def _ssim(a: Float, b: Float) -> Float:
    c1, c2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2

    def mean(x: Float) -> Float:
        return np.asarray(cv2.blur(x, (_WINDOW_PX, _WINDOW_PX)), np.float64)

    mean_a, mean_b = mean(a), mean(b)
    var_a, var_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
    both = mean(a * b) - mean_a * mean_b
    top = (2.0 * mean_a * mean_b + c1) * (2.0 * both + c2)
    return np.asarray(top / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)), np.float64)


def _luma(codes: Float) -> Float:
    return codes @ np.array([0.2126, 0.7152, 0.0722])


def _decoded(rgb: NDArray[np.uint8]) -> Float:
    code = rgb / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def _encoded(y: Float) -> Float:
    y = np.clip(y, 0.0, 1.0)
    return 255.0 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1.0 / 2.4) - 0.055)


def _times(case: Case, geometry: FrameGeometry, camera: CameraModel) -> Mapping[str, float]:
    """Return the processor time of a picture of each setting [s]: the best of several rounds, as mean over the views.

    The settings take turns, and before each timed picture one of another view is drawn.
    """
    renderers = {text: _renderer(geometry, camera, setting) for text, setting in SETTINGS.items()}
    times_s = {text: np.full((_ROUNDS, len(case.views)), np.inf) for text in SETTINGS}
    with one_core():
        for turn in np.ndindex(_ROUNDS, len(case.views)):
            view, before = case.views[turn[1]], case.views[turn[1] - 1]
            for text, renderer in renderers.items():
                out = renderer.buffers("rgb")
                _draw(geometry, renderer, before, out)
                began_s = time.thread_time()
                _draw(geometry, renderer, view, out)
                times_s[text][turn] = time.thread_time() - began_s
    return {text: float(values.min(axis=0).mean()) for text, values in times_s.items()}


def _renderer(geometry: FrameGeometry, camera: CameraModel, setting: Setting) -> FrameRenderer:
    return FrameRenderer(
        geometry, camera, shadows=setting.shadows, supersample=setting.supersample, shading=setting.shading
    )


def _draw(geometry: FrameGeometry, renderer: FrameRenderer, view: View, out: dict[str, NDArray]) -> None:
    geometry.expect(view.t_ns)
    renderer.render(view.pose, out)
