"""Tracks of moving objects from the points of successive frames.

State of a track: range and radial speed (r, v), and the direction sines d_y, d_z with their rates, each pair a Kalman
filter with white acceleration q:

    F = | 1 dt |     Q = q^2 | dt^3/3  dt^2/2 |
        | 0  1 |             | dt^2/2  dt     |

Steps of a frame:

1. Predict all tracks.
2. Cluster points that are near one another in range, speed and direction. A chain of neighbours is one cluster.
3. Assign each cluster to the nearest track within the gate. The track is updated with the mean range and direction of
   its points, weighted by amplitude, and with the speed that the trunk of a walker most likely has (trunk_speed.py).
4. Start tracks from the moving clusters that belong to no track.

A track is confirmed, and gets an identity, once it was seen in `confirm_hits` of its first `confirm_frames` frames. It
ends when it was not seen for `coast_s`. While it is not seen, its speed decays with `pause_s`, because an object that
vanishes from the map has most likely stopped. Speeds are compared modulo 2 v_max, as the radar measures them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_asin, det_atan2, det_cos, det_exp, det_sin
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import Processing
from sim.radar.processing.trunk_speed import TrunkSpeed

TRACK_DTYPE = np.dtype(
    [
        ("id", "<u2"),
        ("age_frames", "<u2"),  # since the first point; saturates
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
        ("unseen_s", "<f4"),  # since the last frame with one of its points
    ]
)

_NEPERS_PER_DECIBEL = 0.230258509299404568402  # ln 10 / 10
_FIRST_RATE_SIGMA = 0.3  # of a direction sine, 1/s
_ROUNDING_S = 1e-6  # rounding error of summed times
_MIN_FORWARD_SINE = 0.05  # lower limit of d_x in the deviations of angles
_MAX_UINT16 = 65535  # limit of identities and ages

Float64 = NDArray[np.float64]


@dataclass
class _Filter:
    """Kalman filter of a value and its rate."""

    value: float
    rate: float
    p00: float
    p01: float
    p11: float

    def predict(self, dt: float, q: float) -> None:
        self.value += self.rate * dt
        self.p00 += dt * (2.0 * self.p01 + dt * self.p11) + q * q * dt * dt * dt / 3.0
        self.p01 += dt * self.p11 + q * q * dt * dt / 2.0
        self.p11 += q * q * dt

    def update_value(self, measured: float, sigma: float) -> None:
        s = self.p00 + sigma * sigma
        k0, k1, innovation = self.p00 / s, self.p01 / s, measured - self.value
        self.value += k0 * innovation
        self.rate += k1 * innovation
        self.p11 -= k1 * self.p01
        self.p01 *= 1.0 - k0
        self.p00 *= 1.0 - k0

    def update_rate(self, measured: float, sigma: float) -> None:
        s = self.p11 + sigma * sigma
        k0, k1, innovation = self.p01 / s, self.p11 / s, measured - self.rate
        self.value += k0 * innovation
        self.rate += k1 * innovation
        self.p00 -= k0 * self.p01
        self.p01 *= 1.0 - k1
        self.p11 *= 1.0 - k1


@dataclass
class _Track:
    range: _Filter
    speed: TrunkSpeed
    y: _Filter
    z: _Filter
    id: int = 0  # 0 until confirmed
    age: int = 1
    hits: int = 1
    unseen_s: float = 0.0


class _Points:
    """Points of a frame as arrays.

    Range is weighted by amplitude over noise, so that the strongest point of an extended body does not dominate it.
    Speed is weighted by power over noise, so that the strongest point dominates it.
    """

    def __init__(self, points: NDArray[np.void]) -> None:
        self.range = points["range_m"].astype(np.float64)
        self.speed = points["speed_mps"].astype(np.float64)
        self.snr_db = points["snr_db"].astype(np.float64)
        angles = list(zip(points["azimuth_rad"].tolist(), points["elevation_rad"].tolist(), strict=True))
        self.y = np.array([det_cos(elevation) * det_sin(azimuth) for azimuth, elevation in angles])
        self.z = np.array([det_sin(elevation) for _, elevation in angles])
        self.weight = np.array([det_exp(0.5 * _NEPERS_PER_DECIBEL * snr) for snr in self.snr_db.tolist()])
        self.power = self.weight * self.weight


@dataclass
class _Cluster:
    members: NDArray[np.bool_]
    range: float
    speed: float
    y: float
    z: float
    snr_db: float
    track: _Track | None = None


class Tracker:
    """Tracker of objects over the frames of one radar; identities count up from 1."""

    def __init__(self, chirp: Chirp, processing: Processing) -> None:
        self._p = processing.tracker
        self._chirp = chirp
        self._whole_speed_mps = 2.0 * chirp.max_speed_mps
        self._max_tracks = processing.max_tracks
        self.reset()

    def reset(self) -> None:
        """Reset to the state after construction."""
        self._last_ns: int | None = None
        self._tracks: list[_Track] = []
        self._next_id = 1

    def step(self, points: NDArray[np.void], t_ns: int) -> NDArray[np.void]:
        """Add the points of a frame at `t_ns`, and return the confirmed tracks: a new array of TRACK_DTYPE.

        Raises ValueError if `t_ns` does not rise.
        """
        if self._last_ns is not None and t_ns <= self._last_ns:
            raise ValueError(f"a frame at {t_ns} ns after one at {self._last_ns} ns: frames come in the order of time")
        dt_s = 0.0 if self._last_ns is None else (t_ns - self._last_ns) * 1e-9
        self._last_ns = t_ns
        for track in self._tracks:
            self._predict(track, dt_s)
        seen = _Points(points)
        clusters = self._clusters(seen)
        for cluster in clusters:
            self._assign(cluster)
        for track in self._tracks:
            members = [cluster.members for cluster in clusters if cluster.track is track]
            if members:
                self._update(track, seen, np.any(members, axis=0))
        self._remove_ended()
        for cluster in clusters:
            self._start_track(cluster)
        for track in self._tracks:
            if track.id == 0 and track.hits >= self._p.confirm_hits:
                track.id = self._next_id
                self._next_id = self._next_id % _MAX_UINT16 + 1
        confirmed = [_row(track) for track in self._tracks if track.id != 0]
        return np.array(confirmed[: self._max_tracks], TRACK_DTYPE)

    def _fold(self, speed: Any) -> Any:
        """Return speeds modulo 2 v_max, as the radar measures them."""
        return speed - self._whole_speed_mps * np.floor(speed / self._whole_speed_mps + 0.5)

    def _speed_gate(self, track: _Track) -> float:
        """Return the gate in speed; a track that was not seen for a while accepts any speed."""
        return self._p.gate_speed_mps + 2.0 * max(0.0, math.sqrt(track.range.p11) - self._p.speed_sigma_mps)

    def _squared_distance(self, cluster: _Cluster, track: _Track) -> float:
        """Return the squared distance in position, 1 at the gate."""
        dr = (cluster.range - track.range.value) / self._p.gate_range_m
        dy = (cluster.y - track.y.value) / self._p.gate_sine
        return dr * dr + dy * dy

    def _predict(self, track: _Track, dt_s: float) -> None:
        if track.unseen_s > 0.0:  # it has probably stopped
            track.range.rate /= 1.0 + dt_s / self._p.pause_s
        track.range.predict(dt_s, self._p.acceleration_mps2)
        track.speed.predict(dt_s, self._p.acceleration_mps2)
        track.y.predict(dt_s, self._p.sine_acceleration_ps2)
        track.z.predict(dt_s, self._p.sine_acceleration_ps2)
        track.unseen_s += dt_s
        track.age += 1

    def _clusters(self, points: _Points) -> list[_Cluster]:
        p, clusters = self._p, []
        dr = (points.range[:, None] - points.range) / p.cluster_range_m
        dv = self._fold(points.speed[:, None] - points.speed) / p.cluster_speed_mps
        dy = (points.y[:, None] - points.y) / p.cluster_sine
        near = dr * dr + dv * dv + dy * dy <= 1.0
        free = np.ones(len(points.range), dtype=bool)
        for seed in range(len(free)):
            if not free[seed]:
                continue
            members, grown = near[seed], near[near[seed]].any(axis=0)
            while not np.array_equal(members, grown):
                members, grown = grown, near[grown].any(axis=0)
            free &= ~members
            weight = points.weight[members]
            total = weight.sum()
            off = self._fold(points.speed[members] - points.speed[seed])
            clusters.append(
                _Cluster(
                    members,
                    range=float((weight * points.range[members]).sum() / total),
                    speed=float(self._fold(points.speed[seed] + (weight * off).sum() / total)),
                    y=float((weight * points.y[members]).sum() / total),
                    z=float((weight * points.z[members]).sum() / total),
                    snr_db=float(points.snr_db[members].max()),
                )
            )
        return clusters

    def _assign(self, cluster: _Cluster) -> None:
        nearest = math.inf
        for track in self._tracks:
            position_distance = self._squared_distance(cluster, track)
            if position_distance > 1.0:
                continue
            # A cluster of any speed at the position of a track belongs to it: a limb is not another person.
            dv = float(self._fold(cluster.speed - track.range.rate)) / self._speed_gate(track)
            distance = 0.5 * position_distance + min(0.5, 0.5 * dv * dv)
            if distance < nearest:
                nearest, cluster.track = distance, track

    def _update(self, track: _Track, points: _Points, members: NDArray[np.bool_]) -> None:
        weight = points.weight[members]
        total = weight.sum()
        p = self._p
        track.speed.update(points.speed[members], points.power[members])
        track.range.update_rate(track.speed.mean_mps, p.speed_sigma_mps)
        track.range.update_value(float((weight * points.range[members]).sum() / total), p.range_sigma_m)
        track.range.rate = track.speed.mean_mps  # the density has weighed the frames already
        track.y.update_value(float((weight * points.y[members]).sum() / total), p.sine_sigma)
        track.z.update_value(float((weight * points.z[members]).sum() / total), p.sine_sigma)
        track.unseen_s = 0.0
        track.hits += 1

    def _remove_ended(self) -> None:
        """Remove tracks that ended, and the younger of two with the same position and speed."""
        kept: list[_Track] = []
        for track in self._tracks:
            if not self._ended(track) and not any(self._coincides(track, older) for older in kept):
                kept.append(track)
        self._tracks = kept

    def _ended(self, track: _Track) -> bool:
        p = self._p
        if not track.range.value > 0.0:
            return True
        if track.id != 0:
            return track.unseen_s > p.coast_s + _ROUNDING_S
        return track.hits + (p.confirm_frames - track.age) < p.confirm_hits

    def _coincides(self, track: _Track, other: _Track) -> bool:
        dr = (track.range.value - other.range.value) / self._p.gate_range_m
        dy = (track.y.value - other.y.value) / self._p.gate_sine
        dv = float(self._fold(track.range.rate - other.range.rate)) / self._p.gate_speed_mps
        return dr * dr + dy * dy + dv * dv < 0.25

    def _start_track(self, cluster: _Cluster) -> None:
        p = self._p
        if cluster.track is not None or cluster.snr_db < p.birth_snr_db or abs(cluster.speed) < p.birth_speed_mps:
            return
        # No second track next to one that began in this frame.
        if any(self._squared_distance(cluster, track) <= 1.0 for track in self._tracks):
            return
        sine2, rate2 = p.sine_sigma * p.sine_sigma, _FIRST_RATE_SIGMA * _FIRST_RATE_SIGMA
        self._tracks.append(
            _Track(
                _Filter(cluster.range, cluster.speed, p.range_sigma_m**2, 0.0, p.speed_sigma_mps**2),
                TrunkSpeed(self._chirp, cluster.speed, sigma_mps=p.speed_sigma_mps),
                _Filter(cluster.y, 0.0, sine2, 0.0, rate2),
                _Filter(cluster.z, 0.0, sine2, 0.0, rate2),
            )
        )


def _row(t: _Track) -> tuple[Any, ...]:
    """Return a track as a record of TRACK_DTYPE."""
    scale = 1.0 / max(1.0, math.sqrt(t.y.value * t.y.value + t.z.value * t.z.value))
    dy, dz = scale * t.y.value, scale * t.z.value
    dx = math.sqrt(max(0.0, 1.0 - dy * dy - dz * dz))
    r, v = t.range.value, t.range.rate
    forward, level = max(dx, _MIN_FORWARD_SINE), max(math.sqrt(dx * dx + dy * dy), _MIN_FORWARD_SINE)
    rate_x = -(dy * t.y.rate + dz * t.z.rate) / forward
    return (
        t.id,
        min(t.age, _MAX_UINT16),
        (r * dx, r * dy, r * dz),
        (v * dx + r * rate_x, v * dy + r * t.y.rate, v * dz + r * t.z.rate),
        r,
        v,
        det_atan2(dy, dx),
        det_asin(dz),
        math.sqrt(t.range.p00),
        math.sqrt(t.range.p11),
        math.sqrt(t.y.p00) / forward,
        math.sqrt(t.z.p00) / level,
        t.unseen_s,
    )
