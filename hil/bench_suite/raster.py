"""`hil bench raster`: time and error of the raster beside MuJoCo's own renderer, in the same process at the same poses.

    scenes        city_park, urban_delivery, training_village, radar_range, each from random flight-like viewpoints
    channels      depth | depth + segmentation | colour + depth + segmentation | all | the third with shadows
    resolutions   160 x 120 to 1280 x 720, 90 degrees across
    geoms         fields of 100 to 20,000; 20,000 of which 200 are seen, beside those 200 alone

Time is that of a picture alone, of a scene already posed, on one core with one thread: per viewpoint the best of some
turns, then the mean over viewpoints. The methods take turns, and every picture follows one of another viewpoint and
time, so that nothing of it can be left over from the one before. The posing of actors is a row of its own.

The error of a row is the 99th percentile of the depth error against mj_ray, away from silhouettes and within 60 m
(hil.bench_suite.raster_errors); the figures of all channels are in the checks and in the rows' details.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.bench_suite import raster_rivals as rivals
from hil.bench_suite.raster_cases import SCENES, Case, View, field_case, hidden_case, scene_case
from hil.bench_suite.raster_errors import Errors, errors, truth
from hil.bench_suite.result import BenchmarkResult, Check, Row, save_figure
from sim.frame.camera_model import CameraModel
from sim.frame.channels import CHANNELS
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.frame.renderer import FrameRenderer

Say = Callable[[str], None]
_FOV_DEG = 90.0
_SIZES = ((160, 120), (320, 240), (640, 480), (1280, 720))
_MAIN = (320, 240)
_COUNTS = (100, 300, 1000, 3000, 10_000, 20_000)
_OURS = "this project"
_RIVAL = "MuJoCo, a pass a channel"
_COLOUR = ("rgb", "depth", "segmentation")
_SETS: dict[str, tuple[str, ...]] = {
    "depth": ("depth",),
    "depth + segmentation": ("depth", "segmentation"),
    "colour + depth + segmentation": _COLOUR,
    "all channels": tuple(CHANNELS),
}
_PIXELS = 20_000  # away from silhouettes, compared with mj_ray in each scene


def buffers(camera: CameraModel, channels: Sequence[str]) -> dict[str, NDArray]:
    """Empty pictures for a FrameRenderer to fill."""
    return {name: CHANNELS[name].empty(camera.height, camera.width) for name in channels}


@dataclass
class _Painter:
    """One method on one case, ready to draw: `pose` is not timed, `draw` is."""

    name: str
    pose: Callable[[View], None]
    draw: Callable[[View], Mapping[str, NDArray]]
    close: Callable[[], None] = lambda: None
    warm_up: bool = True  # draw another view first, untimed


class _Stopwatch:
    """Turns of several painters over the views of a case."""

    def __init__(self, painters: Sequence[_Painter], views: Sequence[View]) -> None:
        self._painters, self._views = painters, views
        self._best = {painter.name: np.full(len(views), np.inf) for painter in painters}

    def run(self, *, turns: int, seconds: float) -> dict[str, float]:
        """Seconds a picture; ends after `turns` or, once every view was drawn, after `seconds`."""
        end = time.perf_counter() + seconds
        for turn in range(turns):
            for i, view in enumerate(self._views):
                if turn > 0 and time.perf_counter() > end:
                    break
                for painter in self._painters:
                    if painter.warm_up:
                        before = self._views[i - 1]
                        painter.pose(before)
                        painter.draw(before)
                    painter.pose(view)
                    began = time.perf_counter()
                    painter.draw(view)
                    took = time.perf_counter() - began
                    self._best[painter.name][i] = min(self._best[painter.name][i], took)
        return {name: float(best.mean()) for name, best in self._best.items()}


class _Bench:
    """One run: the result as it grows, and what all parts of it need."""

    def __init__(self, result: BenchmarkResult, say: Say, *, quick: bool, seed: int) -> None:
        self.result, self.say, self.quick, self.seed = result, say, quick, seed
        self.no_rival = rivals.missing()
        self.driver = ""
        self.times: dict[tuple[str, str, str, tuple[int, int]], float] = {}  # case, method, channels, size
        self.errors: dict[str, Errors] = {}  # ours, by scene, at 320 x 240

    def scene(self, name: str) -> None:
        """Errors and times in one scene."""
        self.say(f"{name}: map and viewpoints")
        case = scene_case(name, views=6 if self.quick else 12, seed=self.seed)
        sizes = (_MAIN,) if self.quick else _SIZES
        for size in sizes:
            camera = CameraModel.from_fov(*size, _FOV_DEG)
            self.say(f"{name}: errors at {size[0]} x {size[1]}")
            pixels = _PIXELS if size == _MAIN else 4000
            found = self._errors(case, camera, pixels // 4 if self.quick else pixels)
            if size == _MAIN:
                self.errors[name] = found[_OURS]
            main = name == SCENES[0]
            for label, channels in _SETS.items():
                if self.quick and not main and channels != _COLOUR:
                    continue
                self._times(case, camera, label, channels, found, shadows=False)
            if main or not self.quick:
                self._times(case, camera, "colour + depth + segmentation, shadows", _COLOUR, found, shadows=True)
        self._posing(case)

    def fields(self) -> None:
        """Time against the number of geoms."""
        for count in (100, 1000, 20_000) if self.quick else _COUNTS:
            self.say(f"field of {count} geoms")
            case = field_case(count, seed=self.seed, views=2 if self.quick else 4)
            camera = CameraModel.from_fov(*_MAIN, _FOV_DEG)
            found = self._errors(case, camera, 500 if self.quick else 2000)
            label = "colour + depth + segmentation"
            self._times(case, camera, label, _COLOUR, found, shadows=False, geoms=count, seconds=3.0)

    def growth(self) -> float:
        """Times the cost of 200 geoms that 19,800 unseen ones add up to, the worse of two ways to be unseen."""
        camera = CameraModel.from_fov(*_MAIN, _FOV_DEG)
        label = "colour + depth + segmentation"
        worst = 0.0
        alone = hidden_case(200, 0, where="out of view", seed=self.seed)
        for where in ("out of view", "behind a wall"):
            self.say(f"200 geoms, and 19,800 {where}")
            crowd = hidden_case(200, 19_800, where=where, seed=self.seed)
            painters = []
            for case in (alone, crowd):
                painter = self._ours(case, camera, _COLOUR, shadows=False)
                painter.name = case.name
                painters.append(painter)
            took = _Stopwatch(painters, alone.views).run(turns=60, seconds=4.0)
            for case in (alone, crowd):
                found = self._errors(case, camera, 500)[_OURS]
                details = {"channels": label, "geoms": case.world.model.ngeom}
                error = _p99(found.depth_m)
                self.result.rows.append(
                    Row("geoms unseen", f"{_OURS} @ {case.name}", error, "m", took[case.name], details)
                )
            worst = max(worst, took[crowd.name] / took[alone.name])
        return worst

    def _ours(self, case: Case, camera: CameraModel, channels: Sequence[str], *, shadows: bool) -> _Painter:
        geometry = FrameGeometry(case.world)
        renderer = FrameRenderer(geometry, camera, shadows=shadows)
        out = buffers(camera, channels)

        def draw(view: View) -> Mapping[str, NDArray]:
            renderer.render(view.pose, out)
            return out

        return _Painter(_OURS, lambda view: geometry.pose(view.t_ns), draw)

    def _rivals(self, case: Case, camera: CameraModel, channels: Sequence[str], *, shadows: bool) -> list[_Painter]:
        crowded = self.quick and case.world.model.ngeom > 2000  # seconds for each picture
        if self.no_rival or crowded or not set(channels) <= set(rivals.CHANNELS):
            return []
        kinds: list[dict[str, bool]] = [{}]
        if not self.quick and channels == _COLOUR and (camera.width, camera.height) == _MAIN:
            kinds += [{"two_passes": True}, {"antialiased": True}]
        made = [rivals.MujocoRenderer(case, camera, shadows=shadows, **kind) for kind in kinds]
        return [
            # It keeps nothing between pictures, and takes too long for its caches to matter.
            _Painter(one.name, one.pose, partial(_drawn_by, one, tuple(channels)), one.close, warm_up=False)
            for one in made
        ]

    def _times(
        self,
        case: Case,
        camera: CameraModel,
        label: str,
        channels: Sequence[str],
        found: Mapping[str, Errors],
        *,
        shadows: bool,
        geoms: int | None = None,
        seconds: float = 8.0,
    ) -> None:
        size = (camera.width, camera.height)
        self.say(f"{case.name}: {label}, {size[0]} x {size[1]}")
        painters = [self._ours(case, camera, channels, shadows=shadows)]
        painters += self._rivals(case, camera, channels, shadows=shadows)
        views = case.views[:4] if size[0] > 640 else case.views
        if len(painters) > 1:
            self.driver = rivals.driver()  # of the context made last
        took = _Stopwatch(painters, views).run(turns=4 if self.quick else 10, seconds=seconds)
        for painter in painters:
            painter.close()
            error = found.get(painter.name, found.get(_RIVAL, Errors()))
            seconds_each = took[painter.name]
            self.times[case.name, painter.name, label, size] = seconds_each
            details: dict[str, Any] = {"channels": label, "resolution": list(size)}
            details["geoms"] = case.world.model.ngeom
            if geoms is not None:
                details["field"] = geoms
            if painter.name != _OURS:
                details["times_slower"] = seconds_each / took[_OURS]
                details["driver"] = self.driver
            if error.id_agrees.size:
                details["ids_agree"] = float(error.id_agrees.mean())
            where = f"field of geoms, {label}" if geoms is not None else f"{case.name}, {label}"
            at = f"{geoms} geoms" if geoms is not None else f"{size[0]}x{size[1]}"
            row = Row(where, f"{painter.name} @ {at}", _p99(error.depth_m), "m", seconds_each, details)
            self.result.rows.append(row)

    def _errors(self, case: Case, camera: CameraModel, pixels: int) -> dict[str, Errors]:
        """Of this project (all channels) and of MuJoCo's renderer (depth and ids), over all views."""
        posed = WorldPose(case.world)
        ours = self._ours(case, camera, [name for name in CHANNELS if name != "rgb"], shadows=False)
        painters = [ours, *self._rivals(case, camera, ("depth", "segmentation"), shadows=False)]
        parts: dict[str, list[Errors]] = {painter.name: [] for painter in painters}
        each = max(50, -(-pixels // len(case.views)))
        for i, view in enumerate(case.views):
            true = truth(case, view, posed, camera, each, self.seed + i)
            for painter in painters:
                painter.pose(view)
                parts[painter.name].append(errors(painter.draw(view), true, case.world.model))
        for painter in painters:
            painter.close()
        return {name: Errors.merged(found) for name, found in parts.items()}

    def _posing(self, case: Case) -> None:
        """What a picture costs before it is drawn: the actors' poses into the geometry."""
        geometry = FrameGeometry(case.world)
        best = np.inf
        for view in case.views * 3:
            began = time.perf_counter()
            geometry.pose(view.t_ns)
            best = min(best, time.perf_counter() - began)
        actors = len(case.world.map.actors)
        self.result.rows.append(Row(f"{case.name}, posing", f"{_OURS} @ {actors} actors", 0.0, "m", best))


def measure(*, quick: bool, say: Say, seed: int = 1) -> BenchmarkResult:
    """Draw every scene with every method. `seed` chooses the viewpoints, the random fields and the pixels compared."""
    result = BenchmarkResult(time_label="wall time per picture [s]")
    with rivals.one_core():
        bench = _Bench(result, say, quick=quick, seed=seed)
        if bench.no_rival:
            result.left_out.append(f"MuJoCo's renderer: {bench.no_rival}")
        if quick:
            result.left_out.append(
                f"resolutions but {_MAIN[0]} x {_MAIN[1]}; rivals with two passes or multisampling; fields of 300, 3000"
                f" and 10,000 geoms; half of the viewpoints; {_PIXELS * 3 // 4} of the {_PIXELS} pixels of each scene; "
                "channels other than colour + depth + segmentation in all scenes but the first"
            )
        for name in SCENES:
            bench.scene(name)
        bench.fields()
        growth = bench.growth()
    result.checks += _speed_checks(bench)
    result.checks += _error_checks(bench.errors)
    result.checks.append(Check("20,000 geoms of which 200 are seen, over those 200 alone", growth, "<=", 2.0, "x"))
    return result


def _speed_checks(bench: _Bench) -> list[Check]:
    park = SCENES[0]
    checks = []
    for label, what in (("", "shadows off"), (", shadows", "shadows on")):
        channels = f"colour + depth + segmentation{label}"
        name = f"{park}, colour + depth + segmentation, {what}: times faster than MuJoCo's renderer"
        rival = bench.times.get((park, _RIVAL, channels, _MAIN))
        if rival is None:
            bench.result.left_out.append(name)
        else:
            checks.append(Check(name, rival / bench.times[park, _OURS, channels, _MAIN], ">=", 40.0, "x"))
    took = bench.times[park, _OURS, "all channels", _MAIN]
    return [*checks, Check(f"{park}, all channels, no shadows", 1e3 * took, "<=", 2.0, "ms")]


def _error_checks(found: Mapping[str, Errors]) -> list[Check]:
    """Of the worst scene in each; a scene in which nothing was compared meets none."""
    scenes = list(found.values())

    def worst(of: Callable[[Errors], float]) -> float:
        return float(np.max([of(scene) for scene in scenes]))  # NaN if any is, unlike Python's max

    def least(agrees: Callable[[Errors], NDArray[np.bool_]]) -> float:
        return float(np.min([_percent(agrees(scene)) for scene in scenes]))

    return [
        Check("depth error, p99", worst(lambda e: _p99(e.depth_m)), "<=", 1e-4, "m"),
        Check("depth error, max", worst(lambda e: _max(e.depth_m)), "<=", 1e-3, "m"),
        Check("instance id agrees, away from silhouettes", least(lambda e: e.id_agrees), ">=", 99.9, "%"),
        Check("instance id agrees, all pixels", least(lambda e: e.id_agrees_anywhere), ">=", 99.5, "%"),
        Check("normals of primitives, max", worst(lambda e: _max(e.normal_deg)), "<=", 0.1, "deg"),
        Check("radial velocity, max", worst(lambda e: _max(e.velocity_mps)), "<=", 1e-4, "m/s"),
    ]


def _drawn_by(rival: rivals.MujocoRenderer, channels: Sequence[str], _: View) -> Mapping[str, NDArray]:
    return rival.render(channels)


def _p99(values: NDArray) -> float:
    return float(np.quantile(values, 0.99)) if values.size else float("nan")


def _max(values: NDArray) -> float:
    return float(values.max()) if values.size else float("nan")


def _percent(agrees: NDArray[np.bool_]) -> float:
    return 100.0 * float(agrees.mean()) if agrees.size else float("nan")


def plot(result: BenchmarkResult, title: str, path: Path) -> None:
    """Time against error in each scene; time against resolution, and against the number of geoms."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    figure = Figure(figsize=(13.8, 4.4), layout="constrained")
    by_error, by_size, by_count = figure.subplots(1, 3)
    label = "colour + depth + segmentation"
    methods = list(dict.fromkeys(row.method.split(" @ ")[0] for row in result.rows))
    for method in methods:
        rows = [row for row in result.rows if row.method.split(" @ ")[0] == method]
        drawn = [row for row in rows if row.details.get("channels") == label]
        at_main = [r for r in drawn if r.details.get("resolution") == list(_MAIN) and "field" not in r.details]
        if at_main:
            floor = [max(row.error, 1e-9) for row in at_main]
            by_error.plot([1e3 * row.time_s for row in at_main], floor, "o", label=method)
        park = [r for r in drawn if r.case.startswith(SCENES[0]) and "resolution" in r.details]
        if park:
            pixels = [r.details["resolution"][0] * r.details["resolution"][1] for r in park]
            by_size.plot(pixels, [1e3 * row.time_s for row in park], "o-", label=method)
        counted = [row for row in drawn if "field" in row.details]
        if counted:
            by_count.plot([r.details["field"] for r in counted], [1e3 * r.time_s for r in counted], "o-", label=method)
    _axes(by_error, f"{label}, {_MAIN[0]} x {_MAIN[1]}, each scene", "time per picture [ms]", "depth error, p99 [m]")
    _axes(by_size, f"{label}, {SCENES[0]}", "pixels", "time per picture [ms]")
    _axes(by_count, f"{label}, random fields", "geoms in the scene", "time per picture [ms]")
    figure.suptitle(title)
    save_figure(figure, path)


def _axes(ax: Any, title: str, x: str, y: str) -> None:
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_title(title, loc="left", fontsize=10, fontweight="bold")
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.grid(True, which="both", color="#e6e9ed", linewidth=0.7)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, frameon=False)
