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

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.lidar_scenes import PATTERNS, Place, Rays, park, pattern_rays, shapes
from hil.bench_suite.raster_cases import GROUPS
from hil.bench_suite.result import BenchmarkResult, Check, Row

Say = Callable[[str], None]
Float64 = NDArray[np.float64]
Hits = tuple[Float64, NDArray[np.int32]]  # range [m], +inf for none; geom, -1 for none

OURS, THEIRS = "this project", "mj_multiRay"
_NO_LIMIT_M = 1e9
_REACH_M = 100.0
_SAMPLE = 37  # every which ray is also cast by mj_ray; no divisor of a pattern
_SLOW_RAYS = 20_000_000  # rays times geoms beyond which mj_multiRay takes seconds and is run once


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
            ours, theirs, apart = _compare(place, pattern, repeats=3 if quick else 7)
            result.rows += [ours, theirs]
            rows[place.name, pattern] = ours, theirs
            disagreements += apart
    result.checks += _checks(rows, disagreements)
    say("200 geoms in reach, alone and among 20,000")
    alone, among = _out_of_reach(result, repeats=5 if quick else 15)
    name = "20,000 geoms of which 200 are in reach, over 200 geoms alone: time"
    result.checks.append(Check(name, among / alone, "<=", 2.0, "x"))
    return result


def _compare(place: Place, pattern: str, *, repeats: int) -> tuple[Row, Row, int]:
    rays = pattern_rays(pattern)
    slow = len(rays.directions_W) * place.geoms > _SLOW_RAYS
    ours_s: list[float] = []
    theirs_s: list[float] = []
    apart, worst, theirs_worst = 0, 0.0, 0.0
    for origin in place.origins_W:
        best = [np.inf, np.inf]
        for repeat in range(repeats):
            took, ours = _timed(_cast, place, origin, rays)
            best[0], ours = min(best[0], took), _kept(ours)
            if repeat == 0 or not slow:
                took, theirs = _timed(_multi_ray, place, origin, rays)
                best[1], theirs = min(best[1], took), _kept(theirs)
        ours_s.append(best[0])
        theirs_s.append(best[1])
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
        Row(case, OURS, worst, "m", float(np.mean(ours_s)), details),
        Row(case, THEIRS, theirs_worst, "m", float(np.mean(theirs_s)), details),
        apart,
    )


def _timed(work: Callable[..., Hits], *arguments: Any) -> tuple[float, Hits]:
    began = time.perf_counter()
    found = work(*arguments)
    return time.perf_counter() - began, found


def _cast(place: Place, origin: tuple[float, float, float], rays: Rays, reach_m: float = _NO_LIMIT_M) -> Hits:
    place.caster.cast(np.array([origin]), rays.directions_W, 0.0, reach_m, rays.range_m, rays.geom, order=rays.order)
    return rays.range_m, rays.geom


def _multi_ray(place: Place, origin: tuple[float, float, float], rays: Rays) -> Hits:
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


def _out_of_reach(result: BenchmarkResult, *, repeats: int) -> tuple[float, float]:
    """Time of a sweep of 16 x 900 over 200 shapes in reach, alone and among 20,000."""
    rays = pattern_rays("16x900")
    places = [shapes(201, far_beyond_m=_REACH_M * 1.5, near=200), shapes(20_000, far_beyond_m=_REACH_M * 1.5, near=200)]
    best = [np.inf, np.inf]
    found: list[list[Hits]] = [[], []]
    for repeat in range(repeats):
        for k, place in enumerate(places):
            total = 0.0
            for origin in place.origins_W:
                took, hits = _timed(_cast, place, origin, rays, _REACH_M)
                total += took
                if repeat == 0:
                    found[k].append(_kept(hits))
            best[k] = min(best[k], total / len(place.origins_W))
    # What is out of reach changes nothing, so the two agree to the last bit.
    pairs = list(zip(found[0], found[1], strict=True))
    changed = sum(int((a[1] != b[1]).sum()) for a, b in pairs)
    apart = max(difference_m(a, b, np.ones(len(a[0]), bool)) for a, b in pairs)
    for place, took in zip(places, best, strict=True):
        details = {"geoms": place.geoms, "rays": len(rays.directions_W), "disagreements": changed}
        result.rows.append(Row("reach of 100 m, 16x900", f"{OURS}, {place.name}", apart, "m", took, details))
    return best[0], best[1]
