"""Preprocessing of a LiDAR sweep: corrected for the vehicle's motion, levelled, and sorted by ring and azimuth.

Each ring and each half degree of azimuth is a slot with its nearest return: 28,000 returns become at most 11,520.
Coordinates are in the level frame H at the time of capture: the body's origin, with the axes of W turned by the
heading.

    p_H = R_HB(t_c) [ R_BB(t) (R_BL p_L + p_BL) + p_BB(t) ]         t the return's own time

An empty slot (a beam was sent and had no return) is distinguished from an unknown one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Sequence

import numpy as np

from hil_companion.explore.mapping.slam_settings import SlamSettings
from hil_companion.navigation.inertial import InertialFilter
from hil_companion.navigation.rotation import matrix_of, roll_pitch_yaw

AZIMUTHS = 720
_TABLE_S = 1e-3  # resolution of the motion table; the error at 1 rad/s and 40 m is at most 2 cm
_MAX_SWEEP_S = 0.2
_MAX_RANGE_M = 200.0
_ALIVE = 4  # neighbouring azimuths to each side, one of which must have a return for a beam to count as sent
_BAD, _EMPTY = -1.0, 0.0
_MAX_RINGS = 256
_MAX_BESIDE_SHARE = 0.01  # share of returns beside their ring that may be transmission errors
_MOVED_M = 0.2
_AT_REST_M, _DIFFERENT = 0.05, 5  # this many different sweeps of a vehicle at rest show that the LiDAR has noise
_STRIDE = 7  # every 7th point is compared
_OFF_M, _OFF_RAD = 0.05, 0.015  # tolerance of a return beside its ring, since beams do not start at one point


class Sweep(NamedTuple):
    """Slots: rings by azimuths. Rings are ordered by elevation, lowest first."""

    p_H: np.ndarray  # (rings, azimuths, 3) float32; zeros without a return
    range_m: np.ndarray  # (rings, azimuths): > 0 a return, 0 no return, < 0 unknown
    ray_H: np.ndarray | None  # (rings, azimuths, 3): direction of each beam; None if unknown
    origin_H: np.ndarray  # approximate origin of the beams
    returns: int  # number of valid ones


def make_sweep(inertial: InertialFilter, lidar: Any, settings: SlamSettings) -> Sweep:
    """Make a sweep, with `inertial` at the time of the capture. Invalid data of a broken LiDAR is left out."""
    elevation_deg: Sequence[float] = settings.lidar_elevation_deg
    azimuths = AZIMUTHS // settings.decimation
    points = np.asarray(lidar["points_L"], np.float32).reshape(-1, 3)
    ring = np.asarray(lidar["ring"]).reshape(-1).astype(np.int64)
    offset = np.asarray(lidar["time_offset_ns"]).reshape(-1)
    n = min(len(points), len(ring), len(offset))
    points, ring, offset = points[:n], ring[:n], offset[:n]
    with np.errstate(invalid="ignore", over="ignore"):
        level_m = np.hypot(points[:, 0], points[:, 1])
        range_m = np.sqrt(level_m * level_m + points[:, 2] * points[:, 2])
        good = np.isfinite(range_m) & (range_m > 0.05) & (range_m < _MAX_RANGE_M)
    if len(elevation_deg):
        beside = good & ~on_ring(points, ring, elevation_deg)
        if settings.lidar_rings_sure:
            good &= ~beside
        elif np.count_nonzero(beside) > _MAX_BESIDE_SHARE * max(1, np.count_nonzero(good)):
            elevation_deg = ()  # another device than configured: beams without a return are not used
    rings = len(elevation_deg) or (min(max(int(ring.max()) + 1, 1), _MAX_RINGS) if n else 1)
    known = (ring >= 0) & (ring < rings)
    good &= known
    order = np.argsort(_elevations(elevation_deg, ring[good], points[good], level_m[good], rings), kind="stable")
    rank = np.empty(rings, np.int64)
    rank[order] = np.arange(rings)
    slots = np.zeros(rings * azimuths, np.float32)
    yaw_bin = azimuths / (2.0 * math.pi)
    at = points[good]
    azimuth = np.floor(np.arctan2(at[:, 1], at[:, 0]) * yaw_bin).astype(np.int64) % azimuths
    slot = rank[ring[good]] * azimuths + azimuth
    keep = _nearest(slot, range_m[good], slots)
    if known.any() and not good.all():
        _mark_unknown(slots, rank, ring, offset, good, known, azimuth, azimuths)
    chosen = np.flatnonzero(good)[keep]
    times = offset[chosen] * 1e-9
    R_BL, t_BL = matrix_of(settings.lidar_q_BL), np.array(settings.lidar_p_BL)
    R_HB = _level(inertial.R)
    turn, move = _motion(inertial)
    step = np.clip((-times / _TABLE_S + 0.5).astype(np.int64), 0, len(turn) - 1)
    R_HL = np.matmul(np.matmul(R_HB, turn), R_BL).astype(np.float32)
    t_HL = (np.matmul(turn, t_BL) + move) @ R_HB.T
    p = _turned(R_HL[step], points[chosen]) + t_HL[step].astype(np.float32)
    p_H = np.zeros((rings * azimuths, 3), np.float32)
    p_H[slot[keep]] = p
    ray_H = None
    if len(elevation_deg):
        ray_H = _rays(np.asarray(elevation_deg)[order], azimuths, R_HL, azimuth[keep], step)
    shape = (rings, azimuths)
    found = _without_blocked(slots.reshape(shape))
    return Sweep(p_H.reshape(*shape, 3), found, ray_H, t_HL[0], int(good.sum()))


def _elevations(
    elevation_deg: Sequence[float], ring: np.ndarray, points: np.ndarray, level_m: np.ndarray, rings: int
) -> np.ndarray:
    """Return a sort key for each ring: the given elevation, or the mean slope of the ring's returns."""
    if len(elevation_deg):
        return np.asarray(elevation_deg, float)
    slope = points[:, 2] / np.maximum(level_m, 1e-3)
    return np.bincount(ring, slope, rings) / np.maximum(np.bincount(ring, minlength=rings), 1)


def _nearest(slot: np.ndarray, range_m: np.ndarray, slots: np.ndarray) -> np.ndarray:
    """Fill each slot with the smallest range of its returns; return the indices of these returns."""
    holder = np.full(len(slots), -1, np.int64)
    order = np.argsort(-range_m, kind="stable")
    holder[slot[order]] = order  # the nearest return of each slot is written last
    keep = np.sort(holder[holder >= 0])
    slots[slot[keep]] = range_m[keep]
    return keep


def _mark_unknown(
    slots: np.ndarray,
    rank: np.ndarray,
    ring: np.ndarray,
    offset: np.ndarray,
    good: np.ndarray,
    known: np.ndarray,
    azimuth: np.ndarray,
    azimuths: int,
) -> None:
    """Mark the slots of returns without a valid range as unknown; their azimuth follows from their time."""
    bad = known & ~good
    if len(azimuth) >= 16 and np.ptp(offset[good]) > 0:
        # The azimuth of a spinning head is linear in time, so the valid returns give it by a straight-line fit.
        t = offset[good].astype(float)
        angle = np.unwrap(azimuth * (2.0 * math.pi / azimuths))
        slope, at_zero = np.polyfit(t, angle, 1)
        guess = ((slope * offset[bad] + at_zero) * (azimuths / (2.0 * math.pi))).astype(np.int64) % azimuths
        spot = rank[ring[bad]] * azimuths + guess
        for shift in (-2, -1, 0, 1, 2):
            place = spot - guess + (guess + shift) % azimuths
            slots[place] = np.where(slots[place] == _EMPTY, _BAD, slots[place])
    else:
        slots[slots == _EMPTY] = _BAD


def _without_blocked(slots: np.ndarray) -> np.ndarray:
    """Mark empty slots as unknown where no ring has a return near their azimuth: the head may be blocked or off."""
    alive = (slots > 0.0).any(axis=0)
    near = alive.copy()
    for shift in range(1, _ALIVE + 1):
        near |= np.roll(alive, shift) | np.roll(alive, -shift)
    slots[:, ~near] = np.where(slots[:, ~near] == _EMPTY, _BAD, slots[:, ~near])
    return slots


def _level(R_WB: np.ndarray) -> np.ndarray:
    """Return the rotation from B to H."""
    _, _, yaw = roll_pitch_yaw(R_WB)
    c, s = math.cos(yaw), math.sin(yaw)
    return np.asarray(np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_WB)


def _motion(inertial: InertialFilter) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and shift from B at past times to B at the filter's time, for each 1 ms step backwards."""
    t_ns = inertial.t_ns or 0
    moments = inertial.states_since(t_ns - int(_MAX_SWEEP_S * 1e9))
    moments = [m for m in moments if m.t_ns <= t_ns] or [inertial.state()]
    q = np.array([m.q for m in moments])
    flip = np.cumsum(np.concatenate([[0], np.sum(q[1:] * q[:-1], axis=1) < 0.0])) % 2 == 1
    q[flip] *= -1.0
    p = np.array([m.p for m in moments])
    t = np.array([(m.t_ns - t_ns) * 1e-9 for m in moments])
    steps = -_TABLE_S * np.arange(int(_MAX_SWEEP_S / _TABLE_S) + 1)
    if len(t) > 1:
        q = np.stack([np.interp(steps, t, q[:, k]) for k in range(4)], axis=-1)
        p = np.stack([np.interp(steps, t, p[:, k]) for k in range(3)], axis=-1)
    else:
        v = np.array(moments[-1].v)
        q, p = np.repeat(q, len(steps), axis=0), p + steps[:, None] * v
    q /= np.linalg.norm(q, axis=1)[:, None]
    R = np.ascontiguousarray(matrix_of(q.T).transpose(2, 0, 1))
    back = R[0].T
    return np.matmul(back, R), (p - p[0]) @ back.T


def _rays(
    elevation_deg: np.ndarray, azimuths: int, R_HL: np.ndarray, azimuth: np.ndarray, step: np.ndarray
) -> np.ndarray:
    """Return the direction of each slot's centre in H at the time of the returns at the nearest azimuth."""
    when = np.full(azimuths, -1, np.int64)
    when[azimuth] = step
    seen = np.flatnonzero(when >= 0)
    if len(seen):
        near = seen[np.clip(np.searchsorted(seen, np.arange(azimuths)), 0, len(seen) - 1)]
        when = when[near]
    else:
        when[:] = 0
    angle = (np.arange(azimuths) + 0.5) * (2.0 * math.pi / azimuths)
    up = np.radians(elevation_deg)
    d = np.empty((len(up), azimuths, 3), np.float32)
    d[:, :, 0] = np.cos(up)[:, None] * np.cos(angle)
    d[:, :, 1] = np.cos(up)[:, None] * np.sin(angle)
    d[:, :, 2] = np.sin(up)[:, None]
    return _turned(R_HL[when], d)


def _turned(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return R p for each vector of p (..., 3), with rotations R that broadcast against p's leading axes."""
    out = np.empty(p.shape, np.float32)
    for i in range(3):
        out[..., i] = R[:, i, 0] * p[..., 0] + R[:, i, 1] * p[..., 1] + R[:, i, 2] * p[..., 2]
    return out


def on_ring(points_L: np.ndarray, ring: np.ndarray, elevation_deg: Sequence[float]) -> np.ndarray:
    """Return which points (n, 3) lie on their ring's cone; False for unknown rings and points that are not finite."""
    slopes = np.tan(np.radians(np.asarray(elevation_deg, float)))
    known = (ring >= 0) & (ring < len(slopes))
    slope = slopes[np.where(known, ring, 0)] if len(slopes) else np.zeros(len(ring))
    with np.errstate(invalid="ignore", over="ignore"):
        level_m = np.hypot(points_L[:, 0], points_L[:, 1])
        off_m = np.abs(points_L[:, 2] - slope * level_m)
        return np.asarray(known & (off_m <= _OFF_M + _OFF_RAD * (level_m + np.abs(points_L[:, 2]))))


class FreshSweeps:
    """Detects repeated sweeps of a LiDAR that hangs, with an old or a new timestamp. Call `is_new` once per sweep.

    A noisy sensor never repeats a sweep. Without noise, identical points count as repeated only if the vehicle has
    moved since they first came.
    """

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._points = b""
        self._first_W = np.zeros(3)  # the vehicle's position when these points first came
        self._rest_W = np.zeros(3)
        self._different = 0

    @property
    def _noisy(self) -> bool:
        return self._different >= _DIFFERENT

    def is_new(self, sweep: Any, *, now_ns: int, p_W: np.ndarray) -> bool:
        """Return True if the sweep is new. `p_W`: the vehicle's position."""
        t_ns = int(sweep.t_capture_ns)
        if t_ns > now_ns or (self._t_ns is not None and t_ns <= self._t_ns):
            return False
        points = np.asarray(sweep["points_L"], np.float32).reshape(-1, 3)[::_STRIDE].tobytes()
        here_W = np.array(p_W, float)
        if points != self._points:
            self._points, self._first_W = points, here_W
            if not self._noisy:
                stays = float(np.linalg.norm(here_W - self._rest_W)) < _AT_REST_M
                self._different = self._different + 1 if stays else 0
                self._rest_W = self._rest_W if stays else here_W
        elif len(points) and (self._noisy or not float(np.linalg.norm(here_W - self._first_W)) < _MOVED_M):
            return False
        self._t_ns = t_ns
        return True
