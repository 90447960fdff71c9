"""`hil bench photo`: time and geometric errors of path-traced colour (extra `photo`).

Pictures of the four scenes from random viewpoints, each at another time, so that the moving geoms are placed anew. The
errors compare the path tracer's own rays through the pixels' centres with the raster:

    ids      share of pixels whose geom the raster does not show within 0.1 px: the raster is drawn again with its
             optical axis shifted by 0.1 px in eight directions
    depth    99th percentile of the difference along the axis, within 60 m, where the geoms agree

A second table compares colours: lab.photo_colour.

Times are those of one picture with all cores, in wall time: poses, paths, denoising, and the way to the child process
and back. `cpu_s` is the time of all cores in the child.
"""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus, TextTable
from hil.apps.bench_suite.sensors.raster_cases import SCENES, Case, View, scene_case
from lab.photo_colour import LEVELS, measure_colour
from signals.processors import usable_processors
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.path_traced.errors import PathTracerError
from sim.frame.path_traced.renderer import DEFAULT_SAMPLES, PathTracedRenderer, PathTracer, tracer_of
from sim.frame.renderer import FrameRenderer
from sim.scene.scene import load_scene
from sim.world_loader import load_world

TITLE = "Path-traced colour: time of a picture and errors of its geometry"
_FOV_DEG = 90.0
_SIZES = ((320, 240), (640, 480))
_TIME_LIMITS_S = {320: 3.0, 640: 7.0}
_SHIFT_PX, _NEAR_M = 0.1, 60.0


def missing() -> str:
    """Return why this machine cannot run the benchmark, "" if it can."""
    try:
        tracer_of(FrameGeometry(load_world(load_scene("airfield")))).close()
    except PathTracerError as error:
        return str(error)
    return ""


def measure(*, quick: bool, status: ShowStatus, seed: int = 1) -> BenchmarkResult:
    """Measure time and errors; `seed` selects the viewpoints. Raises PathTracerError without the extra."""
    result = BenchmarkResult()
    scenes = SCENES[:1] if quick else SCENES
    times_s: dict[int, list[float]] = {width: [] for width, _ in _SIZES}
    off = 0.0
    depths_m: list[float] = []
    for name in scenes:
        status(f"{name}: map and viewpoints")
        case = scene_case(name, views=2 if quick else 4, seed=seed)
        geometry = FrameGeometry(case.world)
        tracer = tracer_of(geometry)
        try:
            for width, height in _SIZES:
                camera = CameraModel.from_fov(width, height, _FOV_DEG)
                status(f"{name}: {width} x {height}")
                took_s, cpu_s = _times(case, geometry, tracer, camera)
                share, depth_m = _errors(case, geometry, tracer, camera)
                times_s[width].append(cpu_s / usable_processors())
                off = max(off, share)
                depths_m.append(depth_m)
                details = {"cpu_s": cpu_s, "depth_p99_m": depth_m, "samples": DEFAULT_SAMPLES}
                method = f"path_traced @ {width} x {height}"
                result.rows.append(Row(name, method, 100.0 * share, "% of ids off by over 0.1 px", took_s, details))
        finally:
            tracer.close()
    geometry_table = TextTable(("scene", "picture", "ids off by over 0.1 px [%]", "time [s]"), [])
    for row in result.rows:
        geometry_table.rows.append((row.case, row.method, f"{row.error:.3g}", f"{row.time_s:.3g}"))
    colour_rows, table = measure_colour(quick=quick, status=status, seed=seed)
    result.rows += colour_rows
    result.tables += [geometry_table, table]
    for width, height in _SIZES:
        what = f"processor time of a picture of {width} x {height} over the number of cores, worst scene"
        result.checks.append(Check(what, max(times_s[width]), "<=", _TIME_LIMITS_S[width], "s", "speed"))
    result.checks.append(Check("ids within 0.1 px of the raster's, worst scene", 100.0 - 100.0 * off, ">=", 99.99, "%"))
    result.checks.append(Check("depth error, 99th percentile, worst scene", max(depths_m), "<=", 1e-3, "m"))
    errors = {(row.case, row.method): row.error for row in colour_rows}
    rises = [errors[case, b] - errors[case, a] for case in {c for c, _ in errors} for a, b in pairwise(LEVELS)]
    what = "colour error against the path tracer, greatest rise from one level of quality to the next"
    result.checks.append(Check(what, max(rises), "<=", 0.0, "% of the mean light"))
    if quick:
        result.left_out.append(f"the scenes {', '.join(SCENES[1:])}; half of the viewpoints")
    return result


def _times(case: Case, geometry: FrameGeometry, tracer: PathTracer, camera: CameraModel) -> tuple[float, float]:
    """Return the median wall time of a picture, and of the child's processor time, in seconds."""
    renderer = PathTracedRenderer(FrameRenderer(geometry, camera), tracer)
    rgb = np.empty((camera.height, camera.width, 3), np.uint8)
    wall_s, cpu_s = [], []
    for view in (case.views[-1], *case.views):  # the first picture compiles the kernel, and does not count
        geometry.expect(view.t_ns)
        began_s, began_cpu_s = time.perf_counter(), tracer.cpu_s
        renderer.render(view.pose, {"rgb": rgb})
        wall_s.append(time.perf_counter() - began_s)
        cpu_s.append(tracer.cpu_s - began_cpu_s)
    return float(np.median(wall_s[1:])), float(np.median(cpu_s[1:]))


def _errors(case: Case, geometry: FrameGeometry, tracer: PathTracer, camera: CameraModel) -> tuple[float, float]:
    """Return the share of pixels whose geom is off by more than 0.1 px, and the 99th percentile of the depth error."""
    lens = tracer.add_camera(camera, (0.05, 10_000.0))
    shifts = [(x, y) for x in (-_SHIFT_PX, 0.0, _SHIFT_PX) for y in (-_SHIFT_PX, 0.0, _SHIFT_PX)]
    off, errors_m = [], []
    for view in case.views:
        geom, range_m = tracer.surfaces(lens, view.pose, view.t_ns)
        near = np.zeros(geom.shape, bool)
        for x, y in shifts:
            near |= geom == _raster(geometry, view, replace(camera, cx=camera.cx + x, cy=camera.cy + y))["geom"]
        off.append(1.0 - near.mean())
        own = _raster(geometry, view, camera)
        same = (own["geom"] == geom) & (geom >= 0) & (own["depth"] < _NEAR_M)
        depth_m = range_m * camera.rays()[:, :, 2]
        errors_m.append(np.abs(depth_m[same] - own["depth"][same]))
    return float(np.mean(off)), float(np.quantile(np.concatenate(errors_m), 0.99))


def _raster(geometry: FrameGeometry, view: View, camera: CameraModel) -> dict[str, NDArray]:
    renderer = FrameRenderer(geometry, camera)
    out = renderer.buffers("geom", "depth")
    geometry.expect(view.t_ns)
    renderer.render(view.pose, out)
    return out
