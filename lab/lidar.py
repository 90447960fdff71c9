"""`hil bench lidar`: time and error of the native ray caster, compared with `mj_multiRay` in one process on one core.

Scenes are city_park, 21 vehicles above it, and 100, 1000, 5000 and 20,000 shapes within 80 x 80 m; patterns are 16 x
900, 32 x 1024 and 64 x 2048 rays, without a range limit. The methods run in turn; a time is the best of several runs,
averaged over three positions. The error is the greatest difference in range from `mj_multiRay`, and from `mj_ray` on
every 37th ray; the row of `mj_multiRay` holds its difference from `mj_ray`. Rays on a silhouette (a neighbouring ray
hits another geom) for which the methods hit different geoms are excluded. A ray that hits something in one method only
has an infinite error. Every ray for which the methods hit different geoms, on a silhouette or not, counts as a
disagreement.

The cost of geometry out of range is measured too: 200 shapes within a range of 100 m, alone and with 19,800 more
beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.mujoco_rays import GROUPS, go_on
from hil.apps.bench_suite.sensors.raster_cases import random_geoms, vehicle_case, world_with
from hil.apps.bench_suite.timing import best_times
from signals._kernel import det_cos, det_sin
from signals.samples import Vec3
from sim._kernels import RayCaster, coherent_order
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.scene.scene import load_scene
from sim.scene.world import World
from sim.world_loader import load_world

TITLE = "LiDAR: range error against time per sweep"
Float64 = NDArray[np.float64]
Hits = tuple[Float64, NDArray[np.int32]]  # range [m], +inf for none; geom, -1 for none

OWN, MUJOCO = "this project", "mj_multiRay"
_NO_LIMIT_M = 1e9
_RANGE_M = 100.0
_SAMPLE = 37  # every 37th ray is also cast by mj_ray; 37 divides no pattern
PATTERNS = {"16x900": (16, 900, 15.0), "32x1024": (32, 1024, 20.0), "64x2048": (64, 2048, 22.5)}


class LidarScene:
    """A scene at t = 0, prepared for both methods, and the positions to cast rays from."""

    def __init__(self, name: str, world: World, origins_W: tuple[Vec3, ...]) -> None:
        self.name, self.origins_W = name, origins_W
        self.model, self.geoms = world.model, int(world.model.ngeom)
        self.geometry = FrameGeometry(world)
        self.caster = RayCaster(self.geometry.native)
        self.data = WorldPose(world).at(0)
        mujoco.mj_forward(self.model, self.data)  # mj_multiRay needs the bounding volumes of the bodies


@dataclass(frozen=True)
class Rays:
    """Ray directions of a level pattern, the order in which they are cast, and output buffers."""

    directions_W: Float64  # (n, 3)
    order: NDArray[np.int32]  # (n,)
    range_m: Float64  # (n,)
    geom: NDArray[np.int32]  # (n,)


def pattern_rays(name: str) -> Rays:
    """Return the rays of one of PATTERNS: channels evenly from -edge to +edge, columns over the full circle."""
    channels, columns, edge_deg = PATTERNS[name]
    elevations = np.linspace(-edge_deg, edge_deg, channels) * (np.pi / 180.0)
    azimuths = np.arange(columns) * (2.0 * np.pi / columns)
    c, s = (np.array([f(x) for x in azimuths.tolist()]) for f in (det_cos, det_sin))
    level, z = (np.array([f(x) for x in elevations.tolist()]) for f in (det_cos, det_sin))
    grid = np.broadcast_arrays(c[:, None] * level, s[:, None] * level, z)
    directions = np.ascontiguousarray(np.stack(grid, axis=-1).reshape(-1, 3))
    order = np.empty(len(directions), np.int32)
    coherent_order(directions, order)
    return Rays(directions, order, np.empty(len(directions)), np.empty(len(directions), np.int32))


def measure(*, quick: bool, status: ShowStatus, errors_only: bool = False) -> BenchmarkResult:
    """Cast every pattern in every scene with both methods; `errors_only`: once."""
    result = BenchmarkResult(time_label="time of one sweep [s]")
    counts = (100, 1000) if quick else (100, 1000, 5000, 20_000)
    if quick:
        result.left_out.append("scenes of 5000 and 20,000 geoms against mj_multiRay (it takes minutes)")
    makers: list[Callable[[], LidarScene]] = [park, vehicles, *(lambda n=n: shapes(n) for n in counts)]
    rows: dict[tuple[str, str], tuple[Row, Row]] = {}
    disagreements = 0
    for make in makers:
        scene = make()
        for pattern in PATTERNS:
            # In large scenes mj_multiRay takes a minute per sweep, and the small pattern gives its time per ray.
            if scene.geoms >= 5000 and pattern != "16x900":
                continue
            status(f"{scene.name}: {pattern}")
            own_row, mujoco_row, differing = _compare(scene, pattern, rounds=1 if errors_only else 3 if quick else 7)
            result.rows += [own_row, mujoco_row]
            rows[scene.name, pattern] = own_row, mujoco_row
            disagreements += differing
    result.checks += _checks(rows, disagreements)
    status("200 geoms in range, alone and among 20,000")
    slowdown = _out_of_range(result, rounds=1 if errors_only else 5 if quick else 15)
    name = "time with 20,000 geoms, 200 in range, over time with those 200 alone"
    result.checks.append(Check(name, slowdown, "<=", 2.0, "x", "speed"))
    return result


def _compare(scene: LidarScene, pattern: str, *, rounds: int) -> tuple[Row, Row, int]:
    rays = pattern_rays(pattern)
    times: dict[str, list[float]] = {OWN: [], MUJOCO: []}
    differing, missed, own_error, mujoco_error = 0, 0, 0.0, 0.0
    for origin in scene.origins_W:
        runs = {OWN: partial(_cast, scene, origin, rays), MUJOCO: partial(_multi_ray, scene, origin, rays)}
        for name, took in best_times(runs, rounds=rounds, once_above_s=0.5).items():
            times[name].append(took)
        own_hits, mujoco_hits = (_copied(run()) for run in runs.values())
        _go_on(scene, origin, rays, mujoco_hits)
        missed += _settle(scene, origin, rays, own_hits, mujoco_hits)
        away = _away_from_silhouettes(mujoco_hits[1], pattern)
        differing += int((own_hits[1] != mujoco_hits[1]).sum())
        sample = slice(None, None, _SAMPLE)
        exact = _mj_ray(scene, origin, rays.directions_W[sample])
        sampled = [(hits[0][sample], hits[1][sample]) for hits in (own_hits, mujoco_hits)]
        own_difference_m = difference_m(own_hits, mujoco_hits, away), difference_m(sampled[0], exact, away[sample])
        own_error = max(own_error, *own_difference_m)
        mujoco_error = max(mujoco_error, difference_m(sampled[1], exact, away[sample]))
    case = f"{scene.name}, {pattern}"
    details = {
        "geoms": scene.geoms,
        "rays": len(rays.directions_W),
        "disagreements": differing,
        "missed by mj_multiRay": missed,
    }
    return (
        Row(case, OWN, own_error, "m", float(np.mean(times[OWN])), details),
        Row(case, MUJOCO, mujoco_error, "m", float(np.mean(times[MUJOCO])), details),
        differing,
    )


def _cast(scene: LidarScene, origin: Vec3, rays: Rays, max_range_m: float = _NO_LIMIT_M) -> Hits:
    scene.caster.cast(
        np.array([origin]), rays.directions_W, 0.0, max_range_m, rays.range_m, rays.geom, order=rays.order
    )
    return rays.range_m, rays.geom


def _multi_ray(scene: LidarScene, origin: Vec3, rays: Rays) -> Hits:
    model, data, n, flat = scene.model, scene.data, len(rays.geom), rays.directions_W.reshape(-1)
    mujoco.mj_multiRay(
        model, data, np.array(origin), flat, GROUPS, True, -1, rays.geom, rays.range_m, None, n, _NO_LIMIT_M
    )
    return rays.range_m, rays.geom


def _go_on(scene: LidarScene, origin: Vec3, rays: Rays, hits: Hits) -> None:
    """Continue MuJoCo's rays through holes, in place."""
    range_m, geom = hits
    go_on(scene.model, scene.data, (np.array(origin), rays.directions_W), (geom, range_m, np.zeros((len(geom), 3))))
    range_m[geom < 0] = np.inf


def _settle(scene: LidarScene, origin: Vec3, rays: Rays, own: Hits, mujoco_hits: Hits) -> int:
    """Let mj_ray decide, in place, where mj_multiRay found another geom; return how often mj_multiRay was wrong.

    mj_multiRay passes by a mesh in about one of 10,000 rays, where mj_ray and exact arithmetic meet it.
    """
    differ = np.flatnonzero(own[1] != mujoco_hits[1])
    range_m, geom = _mj_ray(scene, origin, rays.directions_W[differ])
    wrong = int((geom != mujoco_hits[1][differ]).sum())
    mujoco_hits[0][differ], mujoco_hits[1][differ] = range_m, geom
    return wrong


def _copied(hits: Hits) -> Hits:
    """Return a copy of the hits with infinite range for rays that hit nothing."""
    return np.where(hits[1] >= 0, hits[0], np.inf), hits[1].copy()


def _mj_ray(scene: LidarScene, origin: Vec3, directions_W: Float64) -> Hits:
    origin_W, hit, normal = np.array(origin), np.zeros(1, np.int32), np.zeros((len(directions_W), 3))
    range_m, geom = np.empty(len(directions_W)), np.empty(len(directions_W), np.int32)
    for i, direction in enumerate(directions_W):
        t = mujoco.mj_ray(scene.model, scene.data, origin_W, direction, GROUPS, True, -1, hit)
        range_m[i], geom[i] = (t, hit[0]) if hit[0] >= 0 else (np.inf, -1)
    go_on(scene.model, scene.data, (origin_W, directions_W), (geom, range_m, normal))
    return np.where(geom >= 0, range_m, np.inf), geom


def _away_from_silhouettes(geom: NDArray[np.int32], pattern: str) -> NDArray[np.bool_]:
    """Return True for rays whose neighbours in channel and column all hit the same geom."""
    channels, columns, _ = PATTERNS[pattern]
    grid = geom.reshape(columns, channels)
    away = (grid == np.roll(grid, 1, axis=0)) & (grid == np.roll(grid, -1, axis=0))
    same = grid[:, 1:] == grid[:, :-1]
    away[:, 1:] &= same
    away[:, :-1] &= same
    return away.reshape(-1)


def difference_m(a: Hits, b: Hits, away: NDArray[np.bool_]) -> float:
    """Return the greatest range difference over rays that hit the same geom or are `away` from silhouettes.

    It is infinite if such a ray hits something in only one of `a` and `b`.
    """
    counted = (away | (a[1] == b[1])) & ((a[1] >= 0) | (b[1] >= 0))
    return float(np.abs(a[0][counted] - b[0][counted]).max(initial=0.0))


def _checks(rows: dict[tuple[str, str], tuple[Row, Row]], disagreements: int) -> list[Check]:
    checks = []
    for (scene_name, pattern), (own_row, mujoco_row) in rows.items():
        # Not checked with 100 shapes, where the fixed cost of a ray dominates (8.4 to 10.9 times faster).
        if pattern == "16x900" and own_row.details["geoms"] > 100:
            name = f"{scene_name}, 16 x 900: times faster than mj_multiRay"
            checks.append(Check(name, mujoco_row.time_s / own_row.time_s, ">=", 15.0, "x", "speed"))
    worst = max(own_row.error for own_row, _ in rows.values())
    checks.append(
        Check("range difference from mj_multiRay and mj_ray, all scenes and patterns", worst, "<=", 1e-5, "m")
    )
    total = sum(own_row.details["rays"] * 3 for own_row, _ in rows.values())
    checks.append(
        Check("share of rays that hit another geom than in mj_multiRay", disagreements / total, "<=", 1e-4, "1")
    )
    return checks


def _out_of_range(result: BenchmarkResult, *, rounds: int) -> float:
    """Return the factor by which 19,800 shapes out of range slow down a sweep of 200 others with 16 x 900 rays."""
    rays = pattern_rays("16x900")
    scenes = [shapes(200, beyond=beyond) for beyond in (0, 19_800)]
    times: dict[str, list[float]] = {scene.name: [] for scene in scenes}
    difference, changed = 0.0, 0
    for origin in scenes[0].origins_W:
        runs = {scene.name: partial(_cast, scene, origin, rays, _RANGE_M) for scene in scenes}
        for name, took in best_times(runs, rounds=rounds).items():
            times[name].append(took)
        alone, crowded = (_copied(run()) for run in runs.values())  # equal bit for bit, if all is well
        changed += int((alone[1] != crowded[1]).sum())
        difference = max(difference, difference_m(alone, crowded, np.ones(len(alone[0]), bool)))
    means = [float(np.mean(took)) for took in times.values()]
    for scene, took in zip(scenes, means, strict=True):
        details = {"geoms": scene.geoms, "rays": len(rays.directions_W), "disagreements": changed}
        result.rows.append(Row("range of 100 m, 16x900", f"{OWN}, {scene.name}", difference, "m", took, details))
    return means[1] / means[0]


def park() -> LidarScene:
    """Return city_park with its people at t = 0."""
    world = load_world(load_scene("city_park"))
    return LidarScene("city_park", world, ((0.3, 0.2, 1.5), (10.0, 5.0, 8.0), (-20.0, 13.0, 3.0)))


def vehicles() -> LidarScene:
    """Return the swarm of `vehicle_case` in its first view, seen from within and from two sides."""
    case = vehicle_case(views=1, seed=1)
    x, y, z = case.views[0].pose.p_WC
    a, b, c = np.mean([actor.bound(0)[0] for actor in case.world.map.actors[-21:]], axis=0).tolist()
    return LidarScene(case.name, case.world, ((x, y, z), (2 * a - x, 2 * b - y, 2 * c - z), (a, b, c)))


def shapes(count: int, *, beyond: int = 0) -> LidarScene:
    """Return `count` geoms, one a plane, within 80 x 80 x 9 m, and `beyond` more out of range."""
    rng = np.random.Generator(np.random.Philox(count))
    geoms = random_geoms(rng, count - 1, (-40, -40, 0.5), (40, 40, 8.5), largest_m=1.2)
    geoms += random_geoms(rng, beyond, (1.5 * _RANGE_M, -1000, 0.5), (15.0 * _RANGE_M, 1000, 8.5), largest_m=1.2)
    name = f"{count} geoms" + (f", {beyond} more out of range" if beyond else "")
    return LidarScene(name, world_with(geoms), ((0.3, 0.2, 2.0), (15.0, -12.0, 6.0), (-25.0, 20.0, 1.0)))
