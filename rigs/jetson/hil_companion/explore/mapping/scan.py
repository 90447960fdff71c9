"""Two-dimensional scans of a sweep: points for matching, and free and occupied cells at the flight's height.

For matching, points on upright surfaces at any height count: a wall is the same line at 3 m and at 10 m, so the vehicle
can localise while it climbs and over low houses. Returns of two neighbouring rings at the same azimuth and distance,
one above the other, lie on an upright surface; ground and roofs give no such pairs. With a LiDAR of one ring, all
returns at about the LiDAR's height count.

For the map only a band about the flight's height counts. A beam marks cells free only as far as it stays in that band,
and occupied where it ends in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hil_companion.explore.mapping.slam_settings import SlamSettings
from hil_companion.explore.mapping.sweep import Sweep

_LEAN = 0.35  # largest ratio of horizontal to vertical distance of two returns on an upright surface
_NOISE_M = 0.04  # tolerance of that horizontal distance
_MIN_RISE_M = 0.02
_ABOVE_GROUND_M = 0.4
_LEVEL_M = 2.0  # half height of the band used of a LiDAR with one ring
_NORMAL_REACH = 3  # azimuth slots to each side over which a normal is computed
_STRAIGHT = 0.25  # largest offset of the point from the middle of both sides, as a share of their distance
_FREE_SHARE = 0.6  # middle part of the band in which a beam marks cells free
_BINS = 720
_GROUND_WITHIN_M, _GROUND_RETURNS, _GROUND_ROUGH_M = 0.6, 150, 0.15


class Scan(NamedTuple):
    """A scan in H, metres. `band_xy`: hits in the band; `reach_m`: free distance of each azimuth from -pi up."""

    match_xy: np.ndarray  # (m, 2)
    normal_xy: np.ndarray  # (m, 2) of unit length, or zeros if unknown
    all_xy: np.ndarray  # (k, 2) all upright points, one per cell, for the map's layer of hits
    band_xy: np.ndarray  # (b, 2)
    reach_m: np.ndarray  # (_BINS,)
    above_m: tuple[float, float] = (
        0.0,
        0.0,
    )  # mean and standard deviation of the upright points' height above the body


def make_scan(sweep: Sweep, s: SlamSettings, z_m: float) -> Scan:
    """Make the scan of a sweep. `z_m`: the body's height in W."""
    p, has_return = sweep.p_H, sweep.range_m > 0.0
    z = p[:, :, 2] + np.float32(z_m)
    r = np.hypot(p[:, :, 0], p[:, :, 1])
    xy, normal, up_m = _upright(p, r, z, has_return, s.ground_z_m, s.match_range_m)
    above_m = (float(up_m.mean()) - z_m, float(up_m.std())) if len(up_m) else (0.0, 0.0)
    xy, normal = _mean_per_cell(xy, normal, s.cell_m)
    chosen = _spread(len(xy), s.match_points)
    height_z_m = s.ground_z_m + s.flight_height_m
    low, high = height_z_m - s.band_half_m, height_z_m + s.band_half_m
    low = max(low, s.ground_z_m + _ABOVE_GROUND_M)
    band = has_return & (z >= low) & (z <= high) & (r <= s.map_range_m)
    reach_m = _reach(sweep, r, z, band, z_m, s)
    band_xy = p[:, :, :2][band].astype(float)
    band_xy, _ = _mean_per_cell(band_xy, np.zeros_like(band_xy), 0.5 * s.cell_m)
    return Scan(xy[chosen], normal[chosen], xy, band_xy, reach_m, above_m)


def ground_offset_m(sweep: Sweep, *, z_m: float, ground_z_m: float) -> float | None:
    """Return the median height of the ground's returns above `ground_z_m`; None for too few returns or no plane.

    The result is the error of the height `z_m`. Only errors below 0.6 m are found, so `z_m` has to be known roughly.
    """
    z = sweep.p_H[:, :, 2] + np.float32(z_m - ground_z_m)
    low = z[(sweep.range_m > 0.0) & (np.abs(z) < _GROUND_WITHIN_M)]
    if len(low) < _GROUND_RETURNS:
        return None
    lower, median, upper = np.percentile(low, (25.0, 50.0, 75.0))
    return float(median) if upper - lower < _GROUND_ROUGH_M else None


def _upright(
    p: np.ndarray, r: np.ndarray, z: np.ndarray, has_return: np.ndarray, ground_z_m: float, range_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the midpoints (n, 2) of ring pairs on upright surfaces, the surfaces' normals (n, 2) and heights (n,)."""
    if len(p) == 1:  # one ring gives no slope, so all returns at about its height count as upright
        pair = has_return & (z > ground_z_m + _ABOVE_GROUND_M) & (np.abs(p[:, :, 2]) < _LEVEL_M) & (r < range_m)
        middle, up = p[:, :, :2], z
    else:
        rise = z[1:] - z[:-1]
        out = np.abs(r[1:] - r[:-1])
        pair = has_return[1:] & has_return[:-1] & (rise > _MIN_RISE_M) & (out < _LEAN * rise + _NOISE_M)
        pair &= (np.minimum(z[1:], z[:-1]) > ground_z_m + _ABOVE_GROUND_M) & (r[1:] < range_m)
        middle, up = 0.5 * (p[1:, :, :2] + p[:-1, :, :2]), 0.5 * (z[1:] + z[:-1])
    # The normal comes from the slots to both sides in the same ring pair, if they lie on a line with this one.
    a, b = np.roll(middle, _NORMAL_REACH, axis=1), np.roll(middle, -_NORMAL_REACH, axis=1)
    both = np.roll(pair, _NORMAL_REACH, axis=1) & np.roll(pair, -_NORMAL_REACH, axis=1)
    along = b - a
    length = np.hypot(along[:, :, 0], along[:, :, 1])
    off = np.abs(along[:, :, 0] * (middle - a)[:, :, 1] - along[:, :, 1] * (middle - a)[:, :, 0])
    share = np.abs(np.sum((middle - a) * along, axis=2) - 0.5 * length * length)
    line = pair & both & (length > 0.05) & (length < 0.2 * r[-len(pair) :] + 0.5)
    line &= (off < (0.05 + 0.05 * length) * length) & (share < _STRAIGHT * length * length)
    normal = np.zeros_like(middle)
    safe = np.where(line, length, 1.0)
    normal[:, :, 0] = np.where(line, -along[:, :, 1] / safe, 0.0)
    normal[:, :, 1] = np.where(line, along[:, :, 0] / safe, 0.0)
    return middle[pair].astype(float), normal[pair].astype(float), up[pair]


def _mean_per_cell(xy: np.ndarray, normal: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean point and mean normal of each cell of a grid in H, summed in the order of the points."""
    if not len(xy):
        return xy, normal
    cell = np.floor(xy / cell_m).astype(np.int64)
    key = (cell[:, 0] + 32768) * 65536 + cell[:, 1] + 32768
    _, group, count = np.unique(key, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    mean = np.stack([np.bincount(group, xy[:, k]) / count for k in (0, 1)], axis=-1)
    n = np.stack([np.bincount(group, normal[:, k]) for k in (0, 1)], axis=-1)
    length = np.hypot(n[:, 0], n[:, 1])
    sure = length > 0.5 * count  # the normals agree
    return mean, np.where(sure[:, None], n / np.where(length > 0.0, length, 1.0)[:, None], 0.0)


def _spread(n: int, max_count: int) -> np.ndarray:
    """Return up to `max_count` indices of n, evenly spread."""
    return np.arange(n) if n <= max_count else (np.arange(max_count) * n) // max_count


def _reach(sweep: Sweep, r: np.ndarray, z: np.ndarray, band: np.ndarray, z_m: float, s: SlamSettings) -> np.ndarray:
    """Return the free distance of each azimuth: the longest beam in the band, at most up to the band's nearest hit."""
    reach = np.zeros(_BINS, np.float32)
    ray, max_m = sweep.ray_H, s.map_range_m
    height_z_m, half_m = s.ground_z_m + s.flight_height_m, _FREE_SHARE * s.band_half_m
    begin_z = z_m + float(sweep.origin_H[2])
    above, below = height_z_m + half_m - begin_z, begin_z - (height_z_m - half_m)
    if above <= 0.0 or below <= 0.0:
        return reach  # the beams begin outside the band
    scale = _BINS / (2.0 * math.pi)
    if ray is not None:
        level = np.hypot(ray[:, :, 0], ray[:, :, 1])
        slope = ray[:, :, 2] / np.maximum(level, 1e-6)
        azimuth = np.arctan2(ray[:, :, 1], ray[:, :, 0])
    else:
        slope = (z - np.float32(begin_z)) / np.maximum(r, 1e-3)
        azimuth = np.arctan2(sweep.p_H[:, :, 1], sweep.p_H[:, :, 0])
    inside = np.where(slope > 0.0, above, below) / np.maximum(np.abs(slope), 1e-6)
    free_m = np.where(sweep.range_m > 0.0, r, max_m if ray is not None else 0.0)
    free_m = np.minimum(np.minimum(free_m, inside), max_m)
    known = sweep.range_m >= 0.0
    at = ((azimuth + math.pi) * scale).astype(np.int64) % _BINS
    use = known & (free_m > 1.0)
    order = np.argsort(free_m[use], kind="stable")
    reach[at[use][order]] = free_m[use][order]  # the longest beam of each azimuth is written last
    if band.any():
        hit_azimuth = np.arctan2(sweep.p_H[:, :, 1][band], sweep.p_H[:, :, 0][band])
        hit_at = ((hit_azimuth + math.pi) * scale).astype(np.int64) % _BINS
        hit_m = r[band] - s.cell_m
        stop = np.full(_BINS, np.inf, np.float32)
        order = np.argsort(-hit_m, kind="stable")
        stop[hit_at[order]] = hit_m[order]  # the nearest hit of each azimuth is written last
        # A beam has a width, so a hit at a neighbouring azimuth stops it too.
        stop = np.minimum(stop, np.minimum(np.roll(stop, 1), np.roll(stop, -1)))
        reach = np.minimum(reach, np.maximum(stop, 0.0))
    return reach
