"""`hil bench raster`: time and error of the raster, compared with MuJoCo's renderer in the same process and poses.

    scenes        city_park, urban_delivery, training_village, radar_range, each from random flight-like viewpoints
    vehicles      21 vehicles of three kinds, with random states in each view
    channels      depth | depth + segmentation | colour + depth + segmentation | the same with shadows, and at quality
                  high with sharp and with smooth outlines | all
    resolutions   160 x 120 to 1280 x 720, 90 degrees across
    geoms         fields of 100 to 20,000; 20,000 with 200 visible, compared with those 200 alone

The time is that of one picture of a posed scene, on one core with one thread: the best of several rounds per viewpoint,
averaged over viewpoints. The methods run in turn. Before each timed picture, one of another viewpoint and time is
rendered, so that no cached result can be reused.

MuJoCo's renderer (software OpenGL through EGL if there is no GPU) is used in the usual way: one `update_scene`, then
one `render()` per channel, because colour, depth and segmentation are separate passes. Multisampling is off, because
the raster takes one sample per pixel. The thread is pinned before the OpenGL context is made; the driver's threads
inherit this.

The error of a row is the 99th percentile of the depth error against mj_ray, away from silhouettes and within 60 m
(hil.apps.bench_suite.sensors.raster_errors). The checks cover all channels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.raster_cases import (
    SCENES,
    VEHICLES,
    Case,
    View,
    field_case,
    hidden_case,
    scene_case,
)
from hil.apps.bench_suite.sensors.raster_errors import Errors, errors, truth
from hil.apps.bench_suite.timing import best_times, one_core
from signals.channels import CHANNELS
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose, aim, egl_context, egl_problem, with_buffers_for
from sim.frame.renderer import FrameRenderer
from sim.frame.shading import FULL, PLAIN, Shading

TITLE = "Raster: time and error, compared with MuJoCo's renderer"
Pictures = dict[str, NDArray]
_FOV_DEG = 90.0
_RESOLUTIONS = ((160, 120), (320, 240), (640, 480), (1280, 720))
_MAIN_RESOLUTION = (320, 240)
_GEOM_COUNTS = (100, 300, 1000, 3000, 10_000, 20_000)
_COLOUR = ("rgb", "depth", "segmentation")
# Thermal pictures need a balance of heat at each pixel, some 7 ms at 320 x 240 beside 1.4 ms for all others.
_SEEN = tuple(name for name in CHANNELS if name not in ("temperature", "infrared"))
_CHANNEL_SETS: dict[str, tuple[tuple[str, ...], bool, Shading]] = {  # channels, shadows, shading
    "depth": (("depth",), False, PLAIN),
    "depth + segmentation": (("depth", "segmentation"), False, PLAIN),
    "colour + depth + segmentation": (_COLOUR, False, PLAIN),
    "colour + depth + segmentation, shadows": (_COLOUR, True, PLAIN),
    "colour + depth + segmentation, quality high, sharp outlines": (_COLOUR, True, replace(FULL, smooth_edges=False)),
    "colour + depth + segmentation, quality high": (_COLOUR, True, FULL),
    "all channels": (_SEEN, False, PLAIN),
}
_LONG_PICTURE_S = 1.0
_PIXELS = 20_000  # compared with mj_ray in each scene, away from silhouettes


def buffers(camera: CameraModel, channels: Sequence[str]) -> Pictures:
    """Return empty pictures for a FrameRenderer to fill, by channel."""
    return {name: CHANNELS[name].empty(camera.height, camera.width) for name in channels}


class ThisRaster:
    """This project's raster on one case."""

    name = "this project"

    def __init__(
        self, case: Case, camera: CameraModel, channels: Sequence[str], *, shadows: bool, shading: Shading = PLAIN
    ) -> None:
        self._geometry = FrameGeometry(case.world)
        self._renderer = FrameRenderer(self._geometry, camera, shadows=shadows, shading=shading)
        self._out = buffers(camera, channels)

    def pose(self, view: View) -> None:
        """Pose the actors; not timed."""
        self._geometry.pose(view.t_ns)

    def draw(self, view: View) -> Pictures:
        """Render the pictures of a posed view."""
        self._renderer.render(view.pose, self._out)
        return self._out

    def close(self) -> None:
        """Do nothing: the raster holds no external resources."""


class MujocoRenderer:
    """mujoco.Renderer on one case, with the channels colour, depth and segmentation (as geom ids)."""

    name = "MuJoCo, one pass per channel"

    def __init__(self, case: Case, camera: CameraModel, channels: Sequence[str] = _COLOUR, *, shadows: bool) -> None:
        model = with_buffers_for(case.world.model, camera)
        model.vis.quality.offsamples = 0
        self._camera, self._channels = camera, channels
        self._posed = WorldPose(case.world)
        with egl_context():
            self._renderer = mujoco.Renderer(model, camera.height, camera.width, max_geom=model.ngeom + 100)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        shape = (camera.height, camera.width)
        self._rgb, self._depth = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)
        self._ids = np.zeros((*shape, 2), np.int32)

    def pose(self, view: View) -> None:
        """Pose the actors and update MuJoCo's render scene; not timed."""
        scene = self._renderer.scene
        self._renderer.update_scene(self._posed.at(view.t_ns))
        extent, planes = self._renderer.model.stat.extent, self._renderer.model.vis.map
        for eye in scene.camera:
            aim(eye, self._camera, view.pose, (planes.znear * extent, planes.zfar * extent))

    def draw(self, _view: View) -> Pictures:
        """Render the pictures of the posed view."""
        frame: Pictures = {}
        renderer = self._renderer
        if "rgb" in self._channels:
            frame["rgb"] = renderer.render(out=self._rgb)
        if "depth" in self._channels:
            renderer.enable_depth_rendering()
            frame["depth"] = renderer.render(out=self._depth)
            renderer.disable_depth_rendering()
        if "segmentation" in self._channels:
            renderer.enable_segmentation_rendering()
            frame["geom"] = renderer.render(out=self._ids)[..., 0]
            renderer.disable_segmentation_rendering()
        return frame

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()


Method = ThisRaster | MujocoRenderer


def measure(*, quick: bool, status: ShowStatus, errors_only: bool = False, seed: int = 1) -> BenchmarkResult:
    """Render every scene with every method; `seed` selects viewpoints, random fields and compared pixels.

    `errors_only`: the scenes' errors, and each kind of time once, so that a step that breaks is found.
    """
    result = BenchmarkResult(time_label="processor time per picture [s]")
    problem = egl_problem()
    if problem:
        result.left_out.append(f"MuJoCo's renderer: {problem}")
    if quick:
        result.left_out.append(
            f"resolutions other than {_MAIN_RESOLUTION[0]} x {_MAIN_RESOLUTION[1]}; fields of 300, 3000 and 10,000 "
            f"geoms; half of the viewpoints; {_PIXELS * 3 // 4} of the {_PIXELS} compared pixels of each scene; "
            "channels other than colour + depth + segmentation in all scenes but the first"
        )
    measurement = _Measurement(result, status, quick=quick, seed=seed, with_mujoco=not problem)
    if errors_only:
        result.checks += _error_checks({name: measurement.errors(name) for name in (*SCENES, VEHICLES)})
        unread = BenchmarkResult(time_label=result.time_label)
        smallest = _Measurement(unread, status, quick=True, seed=seed, with_mujoco=not problem, rounds=1)
        smallest.times_of_scene(scene_case(SCENES[0], views=1, seed=seed), {})
        smallest.field(100)
        smallest.hidden_geoms()
        smallest.speed_checks()
        return result
    with one_core():
        scene_errors = {name: measurement.scene(name) for name in (*SCENES, VEHICLES)}
        for count in (100, 1000, 20_000) if quick else _GEOM_COUNTS:
            measurement.field(count)
        slowdown = measurement.hidden_geoms()
    result.checks += measurement.speed_checks()
    result.checks += _error_checks(scene_errors)
    result.checks.append(
        Check("time with 20,000 geoms, 200 visible, over time with those 200 alone", slowdown, "<=", 2.0, "x", "speed")
    )
    return result


class _Measurement:
    """One run of the benchmark: options, result so far, and the times that the checks need."""

    def __init__(
        self,
        result: BenchmarkResult,
        status: ShowStatus,
        *,
        quick: bool,
        seed: int,
        with_mujoco: bool,
        rounds: int | None = None,
    ) -> None:
        """`rounds`: pictures of which the fastest counts; None: as many as `quick` says."""
        self.result, self.status, self.quick, self.seed, self.with_mujoco = result, status, quick, seed, with_mujoco
        self.rounds = rounds
        self.times: dict[tuple[str, str], dict[str, float]] = {}  # (case, channels) -> method -> s, at 320 x 240

    def scene(self, name: str) -> Errors:
        """Measure errors and times in one scene; return this project's errors at 320 x 240."""
        case = scene_case(name, views=6 if self.quick else 12, seed=self.seed)
        size_errors: dict[tuple[int, int], dict[str, Errors]] = {}
        for size in (_MAIN_RESOLUTION,) if self.quick else _RESOLUTIONS:
            camera = CameraModel.from_fov(*size, _FOV_DEG)
            pixels = _PIXELS if size == _MAIN_RESOLUTION else 4000
            size_errors[size] = self._errors(case, camera, pixels // 4 if self.quick else pixels)
            self.times_of_scene(case, size_errors[size], size)
        return size_errors[_MAIN_RESOLUTION][ThisRaster.name]

    def times_of_scene(
        self, case: Case, errors_by_method: Mapping[str, Errors], size: tuple[int, int] = _MAIN_RESOLUTION
    ) -> None:
        """Measure the times of the sets of channels in one scene, and add their rows beside these errors."""
        camera, is_first = CameraModel.from_fov(*size, _FOV_DEG), case.name == SCENES[0]
        for label, (channels, shadows, shading) in _CHANNEL_SETS.items():
            if not self.quick or is_first or (channels == _COLOUR and not shadows):
                times_s = self._times(case, camera, channels, shadows=shadows, shading=shading)
                if size == _MAIN_RESOLUTION:
                    self.times[case.name, label] = times_s
                self._rows(f"{case.name}, {label}", f"{size[0]}x{size[1]}", times_s, errors_by_method)

    def errors(self, name: str) -> Errors:
        """Return this project's errors at 320 x 240 in one scene; rows have no times."""
        case = scene_case(name, views=6 if self.quick else 12, seed=self.seed)
        camera = CameraModel.from_fov(*_MAIN_RESOLUTION, _FOV_DEG)
        errors_by_method = self._errors(case, camera, _PIXELS // 4 if self.quick else _PIXELS)
        self._rows(name, "errors", dict.fromkeys(errors_by_method, float("nan")), errors_by_method)
        return errors_by_method[ThisRaster.name]

    def field(self, count: int) -> None:
        """Measure errors and times in a field of random geoms."""
        case = field_case(count, seed=self.seed, views=2 if self.quick else 4)
        camera = CameraModel.from_fov(*_MAIN_RESOLUTION, _FOV_DEG)
        errors_by_method = self._errors(case, camera, 500 if self.quick else 2000)
        times_s = self._times(case, camera, _COLOUR, shadows=False)
        self._rows("field of geoms, colour + depth + segmentation", f"{count} geoms", times_s, errors_by_method)

    def hidden_geoms(self) -> float:
        """Return the factor by which 19,800 geoms out of view or behind a wall slow down the picture of 200 others."""
        camera = CameraModel.from_fov(*_MAIN_RESOLUTION, _FOV_DEG)
        worst = 0.0
        alone = hidden_case(200, 0, where="out of view", seed=self.seed)
        for where in ("out of view", "behind a wall"):
            self.status(f"200 geoms, and 19,800 {where}")
            crowded = hidden_case(200, 19_800, where=where, seed=self.seed)
            methods = {case.name: ThisRaster(case, camera, _COLOUR, shadows=False) for case in (alone, crowded)}
            times_s = _mean_times(methods, alone.views, rounds=self.rounds or 40)
            for case in (alone, crowded):
                errors_by_method = self._errors(case, camera, 500)
                self._rows("hidden geoms", case.name, {ThisRaster.name: times_s[case.name]}, errors_by_method)
            worst = max(worst, times_s[crowded.name] / times_s[alone.name])
        return worst

    def speed_checks(self) -> list[Check]:
        """Return the checks of speed, for the first scene."""
        park, checks = SCENES[0], []
        for label, shadows, limit in (("", "shadows off", 40.0), (", shadows", "shadows on", 70.0)):
            times_s = self.times[park, f"colour + depth + segmentation{label}"]
            name = f"{park}, colour + depth + segmentation, {shadows}: times faster than MuJoCo's renderer"
            if self.with_mujoco:
                checks.append(
                    Check(name, times_s[MujocoRenderer.name] / times_s[ThisRaster.name], ">=", limit, "x", "speed")
                )
            else:
                self.result.left_out.append(name)
        took_ms = 1e3 * self.times[park, "all channels"][ThisRaster.name]
        return [*checks, Check(f"{park}, all channels but thermal ones, no shadows", took_ms, "<=", 2.0, "ms", "speed")]

    def _methods(
        self, case: Case, camera: CameraModel, channels: Sequence[str], *, shadows: bool, shading: Shading = PLAIN
    ) -> list[Method]:
        methods: list[Method] = [ThisRaster(case, camera, channels, shadows=shadows, shading=shading)]
        too_slow = self.quick and case.world.model.ngeom > 2000  # a picture takes seconds
        comparable = set(channels) <= set(_COLOUR) and shading == PLAIN
        if self.with_mujoco and not too_slow and comparable:
            methods.append(MujocoRenderer(case, camera, channels, shadows=shadows))
        return methods

    def _times(
        self, case: Case, camera: CameraModel, channels: Sequence[str], *, shadows: bool, shading: Shading = PLAIN
    ) -> dict[str, float]:
        self.status(f"{case.name}: {', '.join(channels)}, {camera.width} x {camera.height}")
        methods = {
            method.name: method for method in self._methods(case, camera, channels, shadows=shadows, shading=shading)
        }
        views = case.views[:4] if camera.width > 640 else case.views
        times_s = _mean_times(methods, views, rounds=self.rounds or (4 if self.quick else 10))
        for method in methods.values():
            method.close()
        return times_s

    def _rows(
        self, case: str, variant: str, times_s: Mapping[str, float], errors_by_method: Mapping[str, Errors]
    ) -> None:
        for name, seconds in times_s.items():
            error = _p99(errors_by_method[name].depth_m) if name in errors_by_method else float("nan")
            details = {"times_slower": seconds / times_s.get(ThisRaster.name, seconds)}
            self.result.rows.append(Row(case, f"{name} @ {variant}", error, "m", seconds, details))

    def _errors(self, case: Case, camera: CameraModel, pixels: int) -> dict[str, Errors]:
        """Return the errors over all views, of this project (without colour) and MuJoCo's renderer (depth, ids)."""
        self.status(f"{case.name}: errors at {camera.width} x {camera.height}")
        posed = WorldPose(case.world)
        own = ThisRaster(case, camera, [name for name in _SEEN if name != "rgb"], shadows=False)
        methods = [own, *self._methods(case, camera, ("depth", "segmentation"), shadows=False)[1:]]
        parts: dict[str, list[Errors]] = {method.name: [] for method in methods}
        pixels_per_view = max(50, -(-pixels // len(case.views)))
        for i, view in enumerate(case.views):
            true = truth(case, view, posed, camera, pixels_per_view, self.seed + i)
            for method in methods:
                method.pose(view)
                parts[method.name].append(errors(method.draw(view), true, case.world.model))
        for method in methods:
            method.close()
        return {name: Errors.merged(view_errors) for name, view_errors in parts.items()}


def _mean_times(methods: Mapping[str, Method], views: Sequence[View], *, rounds: int) -> dict[str, float]:
    """Return seconds per picture by method: the best of `rounds` per view, averaged over the views.

    A picture that takes longer than a second is rendered in the first round only.
    """
    best = {name: np.full(len(views), np.inf) for name in methods}

    def draw_other_view_first(name: str, i: int) -> None:
        method, other = methods[name], views[i - 1]
        if isinstance(method, ThisRaster):  # MuJoCo's renderer is too slow for cached data to matter
            method.pose(other)
            method.draw(other)
        method.pose(views[i])

    for k in range(rounds):
        for i, view in enumerate(views):
            runs = {
                name: partial(method.draw, view)
                for name, method in methods.items()
                if k == 0 or best[name][i] < _LONG_PICTURE_S
            }
            for name, seconds in best_times(runs, prepare=partial(draw_other_view_first, i=i)).items():
                best[name][i] = min(best[name][i], seconds)
    return {name: float(times_s.mean()) for name, times_s in best.items()}


def _error_checks(scene_errors: Mapping[str, Errors]) -> list[Check]:
    """Return the checks of errors, each for the worst scene. A scene without compared pixels fails."""
    scenes = list(scene_errors.values())

    def worst(value: Callable[[Errors], float]) -> float:
        return float(np.max([value(scene) for scene in scenes]))  # NaN if any is NaN, unlike Python's max

    def least_percent(agrees: Callable[[Errors], NDArray[np.bool_]]) -> float:
        return float(np.min([_percent(agrees(scene)) for scene in scenes]))

    return [
        Check("depth error, p99", worst(lambda e: _p99(e.depth_m)), "<=", 1e-4, "m"),
        Check("depth error, max", worst(lambda e: _max(e.depth_m)), "<=", 1e-3, "m"),
        Check("instance id agrees, away from silhouettes", least_percent(lambda e: e.id_agrees), ">=", 99.9, "%"),
        Check("instance id agrees, all pixels", least_percent(lambda e: e.id_agrees_anywhere), ">=", 99.5, "%"),
        Check("normals of primitives, max", worst(lambda e: _max(e.normal_deg)), "<=", 0.1, "deg"),
        Check("radial velocity, max", worst(lambda e: _max(e.velocity_mps)), "<=", 1e-4, "m/s"),
    ]


def _p99(values: NDArray) -> float:
    return float(np.quantile(values, 0.99)) if values.size else float("nan")


def _max(values: NDArray) -> float:
    return float(values.max()) if values.size else float("nan")


def _percent(agrees: NDArray[np.bool_]) -> float:
    return 100.0 * float(agrees.mean()) if agrees.size else float("nan")
