"""Recorded flights through the companion's SLAM, and how far it was off.

    trajectory   root mean square of the distance between estimated and true position, over all frames, in W as they
                 are: no alignment, the start is known
    map          of the cells that the grid calls occupied, the share within two cells of a surface, and the mean
                 distance from one; "surface" is anything within the band about the flight's height

The time of an update is what the process spent on the processor in one call: what it takes on one core that it has to
itself. Wall-clock times, which others on the same machine lengthen, stand beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.bench_suite.slam_flight import Flight, fly
from hil.bench_suite.slam_recording import Float64, Mask, Noise, distance_m, record, surfaces, village, way_through
from hil.companion.started import use_client

if TYPE_CHECKING:
    from hil_companion.frame import Frame

START, GOAL = (0.0, 0.0), (70.0, 60.0)
_BAND_M = 1.0
_CLEAR_M = 1.5


@dataclass(frozen=True)
class Recording:
    """One flight, what its sensors said, and what stands at its height."""

    name: str
    flight: Flight
    frames: list[Frame]
    surfaces: Mask
    height_m: float


@dataclass(frozen=True)
class Outcome:
    """One recording through one SLAM."""

    ate_m: float
    worst_m: float
    map_share: float  # 1.0 where nothing is called occupied
    map_error_m: float
    update_s: Float64  # of each frame, on the processor
    wall_s: Float64  # the same by the clock on the wall
    map_bytes: Float64  # held by the maps, after each frame


def make_recording(
    seed: int,
    *,
    height_m: float = 10.0,
    speed_mps: float = 3.0,
    noise: Noise | None = None,
    legs: int = 1,
    parameters: dict[str, Any] | None = None,
) -> Recording:
    """Through village `seed` from start to goal, and back and forth until there were `legs`."""
    place = village(seed, **(parameters or {}))
    standing = surfaces(place, height_m - _BAND_M, height_m + _BAND_M)
    way = way_through(standing, START, GOAL, _CLEAR_M)
    way = np.concatenate([way[:: 1 if k % 2 == 0 else -1] for k in range(legs)])
    flight = fly(way, height_m=height_m, speed_mps=speed_mps, turns=seed % 2 == 0)
    frames = record(place, flight, noise or Noise(seed=seed))
    return Recording(f"village {seed}", flight, frames, standing, height_m)


def replay(
    recording: Recording,
    *,
    frames: Sequence[Frame] | None = None,
    say: Callable[[str], None] = lambda _: None,
    **settings: Any,
) -> Outcome:
    """`frames`: others than the recording's own, such as `slam_recording.without_gps` makes."""
    use_client()
    from hil_companion.explore.slam import Slam
    from hil_companion.explore.slam_settings import SlamSettings

    chosen = SlamSettings(flight_height_m=recording.height_m, band_half_m=_BAND_M, **settings)
    slam = Slam(chosen, start_W=recording.flight.start_W, seed=1)
    truths, tick_ns = recording.flight.truths, recording.flight.tick_ns
    error, took, wall, held = [], [], [], []
    estimate: Any = None
    for frame in recording.frames if frames is None else frames:
        began = time.perf_counter(), time.process_time()
        estimate = slam.update(frame)
        took.append(time.process_time() - began[1])
        wall.append(time.perf_counter() - began[0])
        held.append(slam.maps.bytes)
        error.append(float(np.linalg.norm(estimate.p_W - np.array(truths[frame.t_ns // tick_ns].p_WB))))
        if len(took) % 100 == 0:
            say(f"{recording.name}: {frame.t_ns * 1e-9:.0f} s of flight")
    share, far = map_error(estimate.grid, recording.surfaces)
    ate = float(np.sqrt(np.mean(np.square(error))))
    bytes_held = np.array(held, float)
    return Outcome(ate, max(error), share, far, np.array(took), np.array(wall), bytes_held)


def map_error(grid: Any, surfaces: Mask) -> tuple[float, float]:
    """Share of the occupied cells within two cells of a surface, and the mean distance from one [m]."""
    occupied = grid.centres(grid.occupied)
    if not len(occupied):
        return 1.0, 0.0
    far = distance_m(occupied, surfaces)
    return float(np.mean(far <= 2.0 * grid.cell_m)), float(np.mean(far))
