"""Tracks of what moves. Equations and rules: sim/native/radar/processing_tracker.hpp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim._kernels import RadarTracker
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing

TRACK_DTYPE = np.dtype(
    [
        ("id", "<u2"),
        ("age_frames", "<u2"),
        ("p_R_m", "<f4", (3,)),
        ("v_R_mps", "<f4", (3,)),
        ("range_m", "<f4"),
        ("speed_mps", "<f4"),
        ("azimuth_rad", "<f4"),
        ("elevation_rad", "<f4"),
        ("range_std_m", "<f4"),
        ("speed_std_mps", "<f4"),
        ("azimuth_std_rad", "<f4"),
        ("elevation_std_rad", "<f4"),
        ("unseen_s", "<f4"),  # since the last frame with a point of it
    ]
)


class Tracker:
    """Tracks over the frames of one radar; identities count up from 1."""

    def __init__(self, chirp: Chirp, processing: Processing) -> None:
        p = processing.tracker
        self._room = processing.max_tracks
        self._last_ns: int | None = None
        self._native = RadarTracker(
            whole_speed_mps=2.0 * chirp.max_speed_mps,
            cluster=(p.cluster_range_m, p.cluster_speed_mps, p.cluster_sine),
            gate=(p.gate_range_m, p.gate_speed_mps, p.gate_sine),
            birth_speed_mps=p.birth_speed_mps,
            birth_snr_db=p.birth_snr_db,
            sigma=(p.range_sigma_m, p.speed_sigma_mps, p.sine_sigma),
            acceleration=(p.acceleration_mps2, p.sine_acceleration_ps2),
            confirm=(p.confirm_hits, p.confirm_frames),
            coast_s=p.coast_s,
            pause_s=p.pause_s,
        )

    def step(self, points: NDArray[np.void], t_ns: int) -> NDArray[np.void]:
        """Confirmed tracks after the points of a frame at `t_ns`, which must rise; a new array of TRACK_DTYPE."""
        if self._last_ns is not None and t_ns <= self._last_ns:
            raise ValueError(f"a frame at {t_ns} ns after one at {self._last_ns} ns: frames come in the order of time")
        dt_s = 0.0 if self._last_ns is None else (t_ns - self._last_ns) * 1e-9
        self._last_ns = t_ns
        found = np.empty((self._room, TRACK_DTYPE.itemsize), np.uint8)
        rows = np.ascontiguousarray(points).view(np.float32).reshape(-1, 8)
        count = self._native.step(dt_s, rows, found)
        return found[:count].copy().view(TRACK_DTYPE)[:, 0]

    def reset(self) -> None:
        """As constructed."""
        self._last_ns = None
        self._native.reset()
