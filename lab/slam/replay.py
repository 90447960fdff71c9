"""Replay of recorded flights through the companion's SLAM, and its errors.

    trajectory   root mean square of the distance between estimated and true position over all frames, in W, without
                 alignment, because the start is known
    map          share of the occupied cells within two cells of a surface, and mean distance of the occupied cells from
                 the nearest surface; surfaces are those within a band around the flight's height

The time of an update is the processor time of one call. Wall-clock times are recorded too; other load
lengthens them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.apps.bench_suite.result import ShowStatus
from hil.config.companion.clients import make_client_importable
from lab.slam.flight import Flight, fly
from lab.slam.recording import (
    Float64,
    Mask,
    Noise,
    distance_m,
    make_village,
    path_through,
    record,
    true_surfaces,
)

if TYPE_CHECKING:
    from hil_companion.frame import Frame

START, GOAL = (0.0, 0.0), (70.0, 60.0)
_BAND_M = 1.0
_CLEAR_M = 1.5


@dataclass(frozen=True)
class Recording:
    """One flight, its sensors' frames, and the true surfaces around its height."""

    name: str
    flight: Flight
    frames: list[Frame]
    surfaces: Mask
    height_m: float


@dataclass(frozen=True)
class Outcome:
    """Errors and cost of one replay. `ate_m` is the RMS, `worst_m` the greatest error of position."""

    ate_m: float
    worst_m: float
    map_share: float  # 1.0 if no cell is occupied
    map_error_m: float
    update_s: Float64  # (frames,) processor time
    wall_s: Float64  # (frames,) wall-clock time
    map_bytes: Float64  # (frames,) memory of the maps


def make_recording(
    seed: int,
    *,
    height_m: float = 10.0,
    speed_mps: float = 3.0,
    noise: Noise | None = None,
    legs: int = 1,
    parameters: dict[str, Any] | None = None,
) -> Recording:
    """Record a flight through village `seed` that goes `legs` times from START to GOAL or back."""
    village = make_village(seed, **(parameters or {}))
    obstacles = true_surfaces(village, height_m - _BAND_M, height_m + _BAND_M)
    path = path_through(obstacles, START, GOAL, _CLEAR_M)
    path = np.concatenate([path[:: 1 if k % 2 == 0 else -1] for k in range(legs)])
    flight = fly(path, height_m=height_m, speed_mps=speed_mps, nose_along_path=seed % 2 == 0)
    frames = record(village, flight, noise or Noise(seed=seed))
    return Recording(f"village {seed}", flight, frames, obstacles, height_m)


def replay(
    recording: Recording,
    *,
    frames: Sequence[Frame] | None = None,
    status: ShowStatus = lambda _: None,
    **settings: Any,
) -> Outcome:
    """Run the SLAM with `settings` over a recording; `frames` replace its frames."""
    make_client_importable()
    from hil_companion.explore.mapping.slam import Slam
    from hil_companion.explore.mapping.slam_settings import SlamSettings

    slam_settings = SlamSettings(flight_height_m=recording.height_m, band_half_m=_BAND_M, **settings)
    slam = Slam(slam_settings, start_W=recording.flight.start_W, seed=1)
    truths, tick_ns = recording.flight.truths, recording.flight.tick_ns
    error, update_s, wall_s, map_bytes = [], [], [], []
    estimate: Any = None
    for frame in recording.frames if frames is None else frames:
        began = time.perf_counter(), time.process_time()
        estimate = slam.update(frame)
        update_s.append(time.process_time() - began[1])
        wall_s.append(time.perf_counter() - began[0])
        map_bytes.append(slam.maps.bytes)
        error.append(float(np.linalg.norm(estimate.p_W - np.array(truths[frame.t_ns // tick_ns].p_WB))))
        if len(update_s) % 100 == 0:
            status(f"{recording.name}: {frame.t_ns * 1e-9:.0f} s of flight")
    share, distance = map_error(estimate.grid, recording.surfaces)
    ate = float(np.sqrt(np.mean(np.square(error))))
    costs = np.array(update_s), np.array(wall_s), np.array(map_bytes, float)
    return Outcome(ate, max(error), share, distance, *costs)


def map_error(grid: Any, surfaces: Mask) -> tuple[float, float]:
    """Return the share of occupied cells within two cells of a surface, and their mean distance from one [m]."""
    occupied = grid.centres(grid.occupied)
    if not len(occupied):
        return 1.0, 0.0
    distances_m = distance_m(occupied, surfaces)
    return float(np.mean(distances_m <= 2.0 * grid.cell_m)), float(np.mean(distances_m))
