"""`hil bench lidar`: time and error of the native rays beside `mj_multiRay` in the same process, one core.

Scenes: city_park, and 100, 1000, 5000 and 20,000 shapes within 80 x 80 m. Patterns: 16 x 900, 32 x 1024, 64 x 2048
rays. Each time is the mean over three places to look from of the best of several runs, the methods taking turns,
without limit of range. Error: greatest difference of a range from that of `mj_multiRay`; and from `mj_ray` over every
37th ray, which stands in the row of `mj_multiRay`. It is taken over all rays but those on a silhouette (a ray beside
them meets another geom) of which the two say that they meet different geoms; where only one meets something, it is
infinite. All rays of which they say different things, on silhouettes or not, count as disagreements.

What is out of reach must cost next to nothing: 200 shapes in reach of 100 m, alone and among 20,000.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.raster_cases import GROUPS, random_geoms, world_with
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.bench_suite.timing import best_times
from hil.signals._kernel import det_cos, det_sin
from hil.signals.samples import Vec3
from sim._kernels import RayCaster, coherent_order
from sim.frame.geometry import FrameGeometry
from sim.frame.mujoco_backend import WorldPose
from sim.scene.scene import load_scene
from sim.scene.world import World, load_world

Say = Callable[[str], None]
Float64 = NDArray[np.float64]
Hits = tuple[Float64, NDArray[np.int32]]  # range [m], +inf for none; geom, -1 for none

OURS, THEIRS = "this project", "mj_multiRay"
_NO_LIMIT_M = 1e9
_REACH_M = 100.0
_SAMPLE = 37  # every which ray is also cast by mj_ray; no divisor of a pattern
PATTERNS = {"16x900": (16, 900, 15.0), "32x1024": (32, 1024, 20.0), "64x2048": (64, 2048, 22.5)}


class Place:
    """A scene as it is at t = 0, made ready for both, and where to look from."""

    def __init__(self, name: str, world: World, origins_W: tuple[Vec3, ...]) -> None:
        self.name, self.origins_W = name, origins_W
        self.model, self.geoms = world.model, int(world.model.ngeom)
        self.geometry = FrameGeometry(world)
        self.caster = RayCaster(self.geometry.native)
        self.data = WorldPose(world).at(0)
        mujoco.mj_forward(self.model, self.data)  # mj_multiRay also needs the bounding volumes of bodies


@dataclass(frozen=True)
class Rays:
    """A pattern, level, with the order it is taken in and room for what is found (made once, as a sensor does)."""

    directions_W: Float64
    order: NDArray[np.int32]
    range_m: Float64
    geom: NDArray[np.int32]


def pattern_rays(name: str) -> Rays:
    """Rays of one of PATTERNS: channels evenly from -edge to +edge, columns evenly round."""
    channels, columns, edge_deg = PATTERNS[name]
    up = np.linspace(-edge_deg, edge_deg, channels) * (np.pi / 180.0)
    round_ = np.arange(columns) * (2.0 * np.pi / columns)
    c, s = (np.array([f(x) for x in round_.tolist()]) for f in (det_cos, det_sin))
    level, z = (np.array([f(x) for x in up.tolist()]) for f in (det_cos, det_sin))
    grid = np.broadcast_arrays(c[:, None] * level, s[:, None] * level, z)
    directions = np.ascontiguousarray(np.stack(grid, axis=-1).reshape(-1, 3))
    order = np.empty(len(directions), np.int32)
    coherent_order(directions, order)
    return Rays(directions, order, np.empty(len(directions)), np.empty(len(directions), np.int32))


def measure(*, quick: bool, say: Say) -> BenchmarkResult:
    """Cast every pattern in every scene by both."""
    result = BenchmarkResult(time_label="time of one sweep [s]")
    counts = (100, 1000) if quick else (100, 1000, 5000, 20_000)
    if quick:
        result.left_out.append("scenes of 5000 and 20,000 geoms against mj_multiRay (minutes of its time)")
    makers: list[Callable[[], Place]] = [park, *(lambda n=n: shapes(n) for n in counts)]
    rows: dict[tuple[str, str], tuple[Row, Row]] = {}
    disagreements = 0
    for make in makers:
        place = make()
        for pattern in PATTERNS:
            # Beyond this size mj_multiRay needs a minute for a sweep: its time per ray is known from the small pattern.
            if place.geoms >= 5000 and pattern != "16x900":
                continue
            say(f"{place.name}: {pattern}")
            ours, theirs, apart = _compare(place, pattern, turns=3 if quick else 7)
            result.rows += [ours, theirs]
            rows[place.name, pattern] = ours, theirs
            disagreements += apart
    result.checks += _checks(rows, disagreements)
    say("200 geoms in reach, alone and among 20,000")
    times_longer = _out_of_reach(result, turns=5 if quick else 15)
    name = "20,000 geoms of which 200 are in reach, over 200 geoms alone: time"
    result.checks.append(Check(name, times_longer, "<=", 2.0, "x"))
    return result


def _compare(place: Place, pattern: str, *, turns: int) -> tuple[Row, Row, int]:
    rays = pattern_rays(pattern)
    times: dict[str, list[float]] = {OURS: [], THEIRS: []}
    apart, worst, theirs_worst = 0, 0.0, 0.0
    for origin in place.origins_W:
        works = {OURS: partial(_cast, place, origin, rays), THEIRS: partial(_multi_ray, place, origin, rays)}
        for name, took in best_times(works, turns=turns, once_s=0.5).items():
            times[name].append(took)
        ours, theirs = (_kept(work()) for work in works.values())
        inside = _away_from_silhouettes(theirs[1], pattern)
        apart += int((ours[1] != theirs[1]).sum())
        some = slice(None, None, _SAMPLE)
        exact = _mj_ray(place, origin, rays.directions_W[some])
        sampled = [(hits[0][some], hits[1][some]) for hits in (ours, theirs)]
        worst = max(worst, difference_m(ours, theirs, inside), difference_m(sampled[0], exact, inside[some]))
        theirs_worst = max(theirs_worst, difference_m(sampled[1], exact, inside[some]))
    case = f"{place.name}, {pattern}"
    details = {"geoms": place.geoms, "rays": len(rays.directions_W), "disagreements": apart}
    return (
        Row(case, OURS, worst, "m", float(np.mean(times[OURS])), details),
        Row(case, THEIRS, theirs_worst, "m", float(np.mean(times[THEIRS])), details),
        apart,
    )


def _cast(place: Place, origin: Vec3, rays: Rays, reach_m: float = _NO_LIMIT_M) -> Hits:
    place.caster.cast(np.array([origin]), rays.directions_W, 0.0, reach_m, rays.range_m, rays.geom, order=rays.order)
    return rays.range_m, rays.geom


def _multi_ray(place: Place, origin: Vec3, rays: Rays) -> Hits:
    model, data, n, flat = place.model, place.data, len(rays.geom), rays.directions_W.reshape(-1)
    mujoco.mj_multiRay(
        model, data, np.array(origin), flat, GROUPS, True, -1, rays.geom, rays.range_m, None, n, _NO_LIMIT_M
    )
    return rays.range_m, rays.geom


def _kept(hits: Hits) -> Hits:
    """A copy, of ranges as this project has them: +inf for none."""
    return np.where(hits[1] >= 0, hits[0], np.inf), hits[1].copy()


def _mj_ray(place: Place, origin: tuple[float, float, float], directions_W: Float64) -> Hits:
    from_W, met = np.array(origin), np.zeros(1, np.int32)
    range_m, geom = np.empty(len(directions_W)), np.empty(len(directions_W), np.int32)
    for i, direction in enumerate(directions_W):
        t = mujoco.mj_ray(place.model, place.data, from_W, direction, GROUPS, True, -1, met)
        range_m[i], geom[i] = (t, met[0]) if met[0] >= 0 else (np.inf, -1)
    return range_m, geom


def _away_from_silhouettes(geom: NDArray[np.int32], pattern: str) -> NDArray[np.bool_]:
    """Rays whose neighbours, of the channels and the columns beside theirs, all meet the same geom."""
    channels, columns, _ = PATTERNS[pattern]
    grid = geom.reshape(columns, channels)
    inside = (grid == np.roll(grid, 1, axis=0)) & (grid == np.roll(grid, -1, axis=0))
    same = grid[:, 1:] == grid[:, :-1]
    inside[:, 1:] &= same
    inside[:, :-1] &= same
    return inside.reshape(-1)


def difference_m(a: Hits, b: Hits, inside: NDArray[np.bool_]) -> float:
    """Greatest difference of ranges of rays that meet the same geom or are `inside`; inf where one meets nothing."""
    counted = (inside | (a[1] == b[1])) & ((a[1] >= 0) | (b[1] >= 0))
    return float(np.abs(a[0][counted] - b[0][counted]).max(initial=0.0))


def _checks(rows: dict[tuple[str, str], tuple[Row, Row]], disagreements: int) -> list[Check]:
    checks = []
    for (scene, pattern), (ours, theirs) in rows.items():
        # A hundred shapes are rows only: with so few, what a ray costs before it meets any decides (8.4 to 10.9 times).
        if pattern == "16x900" and ours.details["geoms"] > 100:
            name = f"{scene}, 16 x 900: times faster than mj_multiRay"
            checks.append(Check(name, theirs.time_s / ours.time_s, ">=", 10.0, "x"))
    worst = max(ours.error for ours, _ in rows.values())
    checks.append(
        Check("range difference from mj_multiRay and mj_ray, all scenes and patterns", worst, "<=", 1e-5, "m")
    )
    total = sum(ours.details["rays"] * 3 for ours, _ in rows.values())
    checks.append(Check("rays that meet another geom than mj_multiRay says", disagreements / total, "<=", 1e-4, "1"))
    return checks


def _out_of_reach(result: BenchmarkResult, *, turns: int) -> float:
    """Times that 200 shapes in reach take longer among 20,000 than alone, a sweep of 16 x 900."""
    rays = pattern_rays("16x900")
    places = [shapes(200, beyond=beyond) for beyond in (0, 19_800)]
    times: dict[str, list[float]] = {place.name: [] for place in places}
    apart, changed = 0.0, 0
    for origin in places[0].origins_W:
        works = {place.name: partial(_cast, place, origin, rays, _REACH_M) for place in places}
        for name, took in best_times(works, turns=turns).items():
            times[name].append(took)
        # What is out of reach changes nothing, so the two agree to the last bit.
        alone, among = (_kept(work()) for work in works.values())
        changed += int((alone[1] != among[1]).sum())
        apart = max(apart, difference_m(alone, among, np.ones(len(alone[0]), bool)))
    means = [float(np.mean(took)) for took in times.values()]
    for place, took in zip(places, means, strict=True):
        details = {"geoms": place.geoms, "rays": len(rays.directions_W), "disagreements": changed}
        result.rows.append(Row("reach of 100 m, 16x900", f"{OURS}, {place.name}", apart, "m", took, details))
    return means[1] / means[0]


def park() -> Place:
    """city_park, its people where they are at t = 0."""
    world = load_world(load_scene("city_park"))
    return Place("city_park", world, ((0.3, 0.2, 1.5), (10.0, 5.0, 8.0), (-20.0, 13.0, 3.0)))


def shapes(count: int, *, beyond: int = 0) -> Place:
    """`count` geoms, a plane among them, within 80 x 80 m and 9 m up, and so many more out of reach."""
    random = np.random.Generator(np.random.Philox(count))
    geoms = random_geoms(random, count - 1, (-40, -40, 0.5), (40, 40, 8.5), largest_m=1.2)
    geoms += random_geoms(random, beyond, (1.5 * _REACH_M, -1000, 0.5), (15.0 * _REACH_M, 1000, 8.5), largest_m=1.2)
    name = f"{count} geoms" + (f", {beyond} more out of reach" if beyond else "")
    return Place(name, world_with(geoms), ((0.3, 0.2, 2.0), (15.0, -12.0, 6.0), (-25.0, 20.0, 1.0)))
