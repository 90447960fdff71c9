"""`hil bench radar`: time and error of a radar frame, compared with the exact sum, in one process on one core.

The error is ||x - x_direct|| / ||x_direct|| over all receivers, chirps and samples, with x noise-free and before the
ADC. x_direct is the method `direct`; its own row holds its error against radar_reference.py over some
of the echoes. Times are the best of several runs.

Sweeps cover tolerances of 1e-2 to 1e-9, 5,000 to 300,000 echoes, speeds to 30 m/s, ranges to 200 m and all presets;
radar_arrays.py has those with several transmitters, radar_bounces.py ghosts, radar_effects.py interference, rain and
errors of the sweep, radar_spinning.py a turning beam. Further cases: pictures of city_park, where negligible echoes are
dropped; point targets through the processing chain; a person who walks away and back; another vehicle; and a real
recording, if one is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.radar_arrays import PRESETS, array_target_checks, city_park_arrays
from hil.apps.bench_suite.sensors.radar_bounces import bounce_rows
from hil.apps.bench_suite.sensors.radar_cases import PIXELS, radar_parameters, radar_view, random_echoes, synthesizer
from hil.apps.bench_suite.sensors.radar_checks import (
    characteristic_checks,
    person_checks,
    recording_checks,
    target_checks,
    vehicle_checks,
)
from hil.apps.bench_suite.sensors.radar_effects import effect_rows
from hil.apps.bench_suite.sensors.radar_reference import reference
from hil.apps.bench_suite.sensors.radar_spinning import spinning_rows
from hil.apps.bench_suite.sensors.raster_cases import scene_case
from hil.apps.bench_suite.timing import best_times, one_core
from sim.radar.echoes import Echoes
from sim.sensors.radar_parameters import RadarParameters

TITLE = "Radar: error of a raw frame against time per frame"
Float64 = NDArray[np.float64]
UNIT = "relative, to the exact sum"
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
_REFERENCE_SAMPLES = 3 * 64 * 64  # of a frame, for 60 echoes; fewer echoes for larger frames
_COUNTS = (5_000, 20_000, PIXELS, 300_000)
_SPEEDS_MPS = (0.0, 3.0, 10.0, 30.0)
_RANGES_M = (1.0, 10.0, 50.0, 200.0)


def measure(*, quick: bool, status: ShowStatus) -> BenchmarkResult:
    """Run all parts; `quick` leaves out the large sweeps."""
    result = BenchmarkResult(time_label="time of one frame [s]")
    with one_core():
        _synthesis(result, quick=quick, status=status)
        status("city_park")
        _city_park(result, views=4 if quick else 12)
        city_park_arrays(result, quick=quick, status=status)
        bounce_rows(result, quick=quick, status=status)
        effect_rows(result, quick=quick, status=status)
        spinning_rows(result, quick=quick, status=status)
    status("point targets")
    result.checks += characteristic_checks()
    result.checks += target_checks(quick=quick)
    result.checks += array_target_checks(quick=quick)
    status("a person who walks away and back")
    result.checks += person_checks(result, quick=quick)
    status("another vehicle")
    result.checks += vehicle_checks(result, quick=quick)
    status("the real recording")
    result.checks += recording_checks(result)
    return result


def _synthesis(result: BenchmarkResult, *, quick: bool, status: ShowStatus) -> None:
    parameters = radar_parameters()
    status("all tolerances")
    table_2 = _Case("table 2, 76,800 echoes", parameters, random_echoes(PIXELS))
    times = table_2.sweep(result, TOLERANCES, repeats=3 if quick else 7)
    for tolerance, limit_s in ((1e-3, 15e-3), (1e-6, 60e-3)):
        took, error = times[tolerance]
        result.checks.append(Check(f"76,800 echoes at {tolerance:g}: error", error, "<=", tolerance, "1"))
        result.checks.append(
            Check(f"76,800 echoes at {tolerance:g}: time", 1e3 * took, "<=", 1e3 * limit_s, "ms", "speed")
        )
    ratio = table_2.direct_s / times[1e-3][0]
    result.checks.append(Check("times faster than the exact sum at 1e-3, same core", ratio, ">=", 100.0, "x", "speed"))
    worst = max(error / tolerance for tolerance, (_, error) in times.items())
    cases = [
        _Case(f"wideband, speeds to {v:g} m/s", radar_parameters("bgt60tr13c_wideband"), _moving(v, 5_000))
        for v in ((3.0,) if quick else (3.0, 30.0))
    ]
    if quick:
        cases += [_Case(f"speeds to {v:g} m/s", parameters, _moving(v, 5_000)) for v in (0.0, 30.0)]
        cases += [_Case(f"ranges to {r:g} m", parameters, _distant(r, 5_000)) for r in (200.0,)]
        result.left_out.append(
            "echo counts other than 76,800 and 5,000; speeds 3 and 10 m/s; ranges 1 to 50 m; two thirds of the views"
        )
    else:
        cases += [_Case(f"{n:,} echoes", parameters, random_echoes(n)) for n in _COUNTS]
        cases += [_Case(f"speeds to {v:g} m/s", parameters, _moving(v, PIXELS)) for v in _SPEEDS_MPS]
        cases += [_Case(f"ranges to {r:g} m", parameters, _distant(r, PIXELS)) for r in _RANGES_M]
    for name in PRESETS:
        p = radar_parameters(name)
        ranges_m = (1.0, 0.9 * p.chirp.max_range_m)
        cases.append(_Case(f"{name}, 5,000 echoes", p, random_echoes(5_000, range_m=ranges_m, speed_mps=(-10.0, 10.0))))
    for case in cases:
        status(case.name)
        measured = case.sweep(result, (1e-3, 1e-6, 1e-9), repeats=2 if quick else 5)
        worst = max(worst, *(error / tolerance for tolerance, (_, error) in measured.items()))
    result.checks.append(Check("greatest error, in tolerances: all counts, speeds and ranges", worst, "<=", 1.0, "1"))


def _moving(speed_mps: float, count: int) -> Echoes:
    return random_echoes(count, seed=2, speed_mps=(-speed_mps, speed_mps))


def _distant(range_m: float, count: int) -> Echoes:
    return random_echoes(count, seed=3, range_m=(0.5 * range_m, range_m))


class _Case:
    """Echoes of one radar configuration."""

    def __init__(self, name: str, parameters: RadarParameters, echoes: Echoes) -> None:
        self.name, self._p, self._echoes = name, parameters, echoes
        self.direct_s = 0.0

    def sweep(
        self, result: BenchmarkResult, tolerances: tuple[float, ...], *, repeats: int
    ) -> dict[float, tuple[float, float]]:
        """Add a row for the exact sum and one per tolerance; return time [s] and error by tolerance."""
        shape = self._p.raw_shape
        exact, out = np.empty(shape), np.empty(shape)
        direct = synthesizer(self._p, "direct", 1e-3)
        run = partial(direct.synthesize, self._echoes, exact)
        self.direct_s = best_times({"direct": run}, rounds=2)["direct"]
        direct_error = _direct_error(self._p, self._echoes)
        result.rows.append(
            Row(self.name, "direct", direct_error, UNIT, self.direct_s, {"echoes": len(self._echoes.range_m)})
        )
        measured: dict[float, tuple[float, float]] = {}
        for tolerance in tolerances:
            transform = synthesizer(self._p, "nufft", tolerance)
            report = transform.synthesize(self._echoes, out)  # the first call allocates its buffers
            error = _error(out, exact)
            took = best_times({"": partial(transform.synthesize, self._echoes, out)}, rounds=repeats)[""]
            measured[tolerance] = took, error
            details = {"terms": report.terms, "panels": report.panels, "width": report.width, "dropped": report.dropped}
            result.rows.append(Row(self.name, f"nufft @ {tolerance:g}", error, UNIT, took, details))
        return measured


def _direct_error(p: RadarParameters, echoes: Echoes) -> float:
    """Return the relative error of `direct` over some echoes; the reference is too slow for all of them."""
    some = max(4, 60 * _REFERENCE_SAMPLES // int(np.prod(p.raw_shape)))
    step = max(1, len(echoes.range_m) // some)
    arrays = (echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude)
    subset = Echoes(*(np.ascontiguousarray(array[::step]) for array in arrays))
    cutoffs: Mapping[str, float | None] = {
        "hp_cutoff_hz": p.receiver.hp_cutoff_hz,
        "aaf_cutoff_hz": p.receiver.aaf_cutoff_hz,
    }
    exact = reference(p.chirp, p.antenna.array, subset, **cutoffs)
    out = np.empty(exact.shape)
    synthesizer(p, "direct", p.tolerance).synthesize(subset, out)
    return _error(out, exact.astype(np.float64))


def _city_park(result: BenchmarkResult, *, views: int) -> None:
    """Measure the step from pictures to raw frames, without rendering; times are means over the views."""
    parameters, tolerance = radar_parameters(), 1e-3
    case = scene_case("city_park", views=views, seed=1)
    radar = radar_view(case.world, parameters)
    shape = parameters.raw_shape
    exact, out = np.empty(shape), np.empty(shape)
    transform, direct = synthesizer(parameters, "nufft", tolerance), synthesizer(parameters, "direct", tolerance)
    times_s = [np.inf] * len(case.views)
    direct_s: list[float] = []
    errors: list[float] = []
    kept_shares: list[float] = []
    for k in range(3):  # three rounds at different times, because other load on the machine lasts for a while
        for i, view in enumerate(case.views):
            radar.draw(view)
            run = partial(transform.synthesize, radar.echoes(view), out)
            report = run()
            times_s[i] = min(times_s[i], best_times({"": run}, rounds=3)[""])
            if k == 0:
                direct_s.append(best_times({"": partial(direct.synthesize, radar.echoes(view), exact)})[""])
                errors.append(_error(out, exact))
                kept_shares.append((report.echoes - report.dropped) / PIXELS)
    name, worst = "city_park, pictures of 320 x 240", max(errors)
    details = {"pixels_kept": float(np.mean(kept_shares)), "views": len(case.views)}
    result.rows.append(Row(name, "nufft @ 0.001", worst, UNIT, float(np.mean(times_s)), details))
    result.rows.append(Row(name, "direct", 0.0, UNIT, float(np.mean(direct_s))))
    result.checks.append(Check("city_park with skipping: error", worst, "<=", tolerance, "1"))
    result.checks.append(
        Check("city_park with skipping: time, mean", 1e3 * float(np.mean(times_s)), "<=", 6.0, "ms", "speed")
    )
    result.checks.append(
        Check("city_park with skipping: time, slowest view", 1e3 * max(times_s), "<=", 6.0, "ms", "speed")
    )


def _error(x: Float64, exact: Float64) -> float:
    norm = float(np.linalg.norm(exact))
    return float(np.linalg.norm(x - exact)) / norm if norm > 0.0 else float(np.linalg.norm(x))
