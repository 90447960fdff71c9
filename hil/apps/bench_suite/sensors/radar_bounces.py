"""Part of `hil bench radar`: paths with more than one bounce, each spacing of rays with its error beside its time.

error    of the power of the ghosts of a radar range (ground, person, corner reflectors), against rays of 0.2 degrees.
         Against exact paths, on small scenes: tests/reference/test_radar_bounces.py
time     of a frame of city_park from picture to samples, mean and greatest over street-level views
"""

from __future__ import annotations

from functools import partial

import numpy as np

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.bench_suite.sensors.radar_cases import RadarView, radar_parameters, radar_view, synthesizer
from hil.apps.bench_suite.sensors.raster_cases import View, camera_pose, looking
from hil.apps.bench_suite.timing import best_times
from sim.radar.bounces import Bounces
from sim.radar.ghost_echoes import KINDS, GhostEchoes
from sim.scene.scene import load_scene
from sim.sensors.radar_parameters import RadarParameters
from sim.world_loader import load_world

_SPACINGS_DEG = (3.0, 2.0, 1.5, 1.0, 0.5)
_FINEST_DEG = 0.2
_PLACES_M = ((0.0, 0.0, 1.8), (10.0, 5.0, 1.8), (-20.0, 10.0, 1.8), (40.0, 0.0, 2.0), (0.0, -40.0, 2.0))
_HEADINGS_DEG = (0.0, 120.0, 240.0)


def bounce_rows(result: BenchmarkResult, *, quick: bool, status: ShowStatus) -> None:
    """Add rows for spacings, and checks of the default's error and time."""
    p, default_deg = radar_parameters(), Bounces().spacing_deg
    spacings = (default_deg,) if quick else _SPACINGS_DEG
    errors_db = _errors_db(p, spacings, 0.5 if quick else _FINEST_DEG)
    park = radar_view(load_world(load_scene("city_park")), p)
    for spacing_deg in spacings:
        status(f"bounces, rays of {spacing_deg:g} degrees")
        times_s, plain_s, ghosts = _times(park, p, spacing_deg, quick=quick)
        details = {"plain_s": float(np.mean(plain_s)), "slowest_s": max(times_s), "ghosts": float(np.mean(ghosts))}
        name = "city_park with bounces"
        result.rows.append(
            Row(name, f"rays of {spacing_deg:g} deg", errors_db[spacing_deg], "dB", float(np.mean(times_s)), details)
        )
        if spacing_deg == default_deg:
            mean_ms = 1e3 * float(np.mean(times_s))
            result.checks += [
                Check(f"{name}: power of ghosts by path, {spacing_deg:g} deg", errors_db[spacing_deg], "<=", 0.5, "dB"),
                Check(f"{name}: frame, mean", mean_ms, "<=", 8.0, "ms", "speed"),
                Check(f"{name}: frame, slowest view", 1e3 * max(times_s), "<=", 8.0, "ms", "speed"),
            ]


def _errors_db(p: RadarParameters, spacings: tuple[float, ...], finest_deg: float) -> dict[float, float]:
    """Return the greatest difference in power of any kind of path by the ground."""
    radar = radar_view(load_world(load_scene("radar_range")), p)
    view = View(4 * 10**9, camera_pose(np.array([0.0, 0.0, 1.8]), looking(0.0, 0.0)))
    radar.draw(view)

    def powers(spacing_deg: float) -> list[float]:
        finder = GhostEchoes(
            radar.renderer.geometry, p.chirp, p.antenna, p.receiver, p.mask, Bounces(spacing_deg=spacing_deg)
        )
        ghosts = finder.find(view.pose)
        return [float(np.sum(ghosts.echoes.amplitude[ghosts.kind == k] ** 2)) for k in range(1, len(KINDS))]

    true = powers(finest_deg)
    return {
        spacing: max(abs(10.0 * float(np.log10(a / b))) for a, b in zip(powers(spacing), true, strict=True))
        for spacing in spacings
    }


def _times(
    radar: RadarView, p: RadarParameters, spacing_deg: float, *, quick: bool
) -> tuple[list[float], list[float], list[int]]:
    """Return seconds of a frame with bounces, without, and the number of ghosts, for each view."""
    finder = GhostEchoes(
        radar.renderer.geometry, p.chirp, p.antenna, p.receiver, p.mask, Bounces(spacing_deg=spacing_deg)
    )
    transform, signal = synthesizer(p, "nufft", 1e-3), np.empty(p.raw_shape)
    times_s: list[float] = []
    plain_s: list[float] = []
    ghosts: list[int] = []
    for place_m in _PLACES_M[:2] if quick else _PLACES_M:
        for heading_deg in _HEADINGS_DEG:
            view = View(10**9, camera_pose(np.array(place_m), looking(heading_deg, 0.0)))
            radar.draw(view)

            def plain(view: View = view) -> None:
                transform.synthesize(radar.echoes(view), signal)

            def bounced(view: View = view) -> None:
                radar.echoes(view)
                transform.synthesize(radar.scatterers.with_more(finder.find(view.pose).echoes), signal)

            steps = best_times({"plain": plain, "bounced": partial(bounced)}, rounds=3)
            times_s.append(steps["bounced"])
            plain_s.append(steps["plain"])
            ghosts.append(finder.find(view.pose).count)
    return times_s, plain_s, ghosts
