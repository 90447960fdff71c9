"""Scan matching for all particles at once: each particle's pose in its own map, its covariance and its likelihood.

For each point b of the scan (in H) with its normal n, and the nearest mean hit h of the particle's map,

    r = n . (h - (R(yaw) b + p))           distance from the surface; displacements along the surface do not change r

Gauss-Newton minimises sum w r^2 / s^2 + (x - x_0)' Q^-1 (x - x_0), with mean x_0 and covariance Q of the pose predicted
by the motion. w is Cauchy's weight times the number of hits, so that moving objects weigh little. A particle's weight
is the likelihood at its pose, tempered because neighbouring beams are not independent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_companion.explore.mapping.maps import Maps
from hil_companion.navigation.rotation import wrapped

_ROUNDS = 4
_STEPS = 2  # Gauss-Newton steps between two searches for the nearest hits
_SETTLED_M, _SETTLED_RAD = 0.01, 0.001  # a smaller step does not change the nearest hits
_SIGMA_M = 0.05  # of a point about its surface: range noise, cell size, tilt
_OUTLIER_M = 0.10  # Cauchy's scale
_RANDOM = 0.02  # likelihood of a beam on an unmapped object
_RIPE = 3  # hits from which a cell counts in full
_INDEPENDENT_POINTS = 8.0  # number of independent measurements in one scan, for the weights
_INDEPENDENT_SHARE = 0.4  # share of independent points in one scan, for the covariance
_MIN_POINTS = 12


class Match(NamedTuple):
    """Result per particle."""

    pose: np.ndarray  # (n, 3): x, y, yaw
    spread: np.ndarray  # (n, 3, 3) covariance of the pose
    log_likelihood: np.ndarray  # (n,)
    inliers: np.ndarray  # (n,) share of the known points that lie on a surface of the map
    known: np.ndarray  # (n,) share of the points with a hit of the map in reach


def match(maps: Maps, predicted: np.ndarray, information: np.ndarray, xy: np.ndarray, normal: np.ndarray) -> Match:
    """Match scan points (m, 2) with normals (m, 2), both in H. `predicted`: (n, 3); `information`: (3, 3), Q^-1."""
    pose = predicted.copy()
    n = len(pose)
    if len(xy) < _MIN_POINTS:
        spread = np.repeat(np.linalg.inv(information)[None], n, axis=0)
        return Match(pose, spread, np.zeros(n), np.zeros(n), np.zeros(n))
    has_normal = (normal != 0.0).any(axis=1)
    reach = maps.cell_m
    for round_number in range(_ROUNDS):
        c, s = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        bx, by = c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]
        cells = np.stack([bx + pose[:, :1], by + pose[:, 1:2]], axis=-1)
        dx, dy, far, count = maps.nearest(maps.cells(cells))
        dx, dy = dx * reach, dy * reach
        ripe = np.minimum(count, _RIPE) * (1.0 / _RIPE)
        nx, ny = c * normal[:, 0] - s * normal[:, 1], s * normal[:, 0] + c * normal[:, 1]
        length = np.sqrt(np.maximum(dx * dx + dy * dy, 1e-12))
        nx, ny = np.where(has_normal, nx, dx / length), np.where(has_normal, ny, dy / length)
        turn = ny * bx - nx * by  # derivative of -r by yaw
        r0 = nx * dx + ny * dy
        begin = pose.copy()
        for _ in range(_STEPS):
            move = pose - begin
            r = r0 - nx * move[:, :1] - ny * move[:, 1:2] - turn * move[:, 2:]
            w = ripe / (1.0 + (r * (1.0 / _OUTLIER_M)) ** 2) * (1.0 / (_SIGMA_M * _SIGMA_M))
            H, g = _normal_equations(w, r, nx, ny, turn)
            H = _INDEPENDENT_SHARE * H + information
            off = predicted - pose
            off[:, 2] = wrapped(off[:, 2])
            g = _INDEPENDENT_SHARE * g + off @ information
            pose = pose + np.linalg.solve(H, g[:, :, None])[:, :, 0]
        step = np.abs(pose - begin).max(axis=0)
        if round_number and max(step[0], step[1]) < _SETTLED_M and step[2] < _SETTLED_RAD:
            break
    move = pose - begin
    r = r0 - nx * move[:, :1] - ny * move[:, 1:2] - turn * move[:, 2:]
    known = np.isfinite(far)
    likely = np.where(known, np.exp(-0.5 * (r * (1.0 / _SIGMA_M)) ** 2) * ripe, 0.0)
    log_likelihood = np.log(likely + _RANDOM).mean(axis=1) * _INDEPENDENT_POINTS
    off = predicted - pose
    off[:, 2] = wrapped(off[:, 2])
    log_likelihood -= 0.5 * np.einsum("ni,ij,nj->n", off, information, off)
    on_surface = known & (np.abs(r) < 2.5 * _SIGMA_M)
    inliers = on_surface.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return Match(pose, np.linalg.inv(H), log_likelihood, inliers, known.mean(axis=1))


def _normal_equations(
    w: np.ndarray, r: np.ndarray, nx: np.ndarray, ny: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal matrix (n, 3, 3) and the gradient (n, 3) of each particle, summed over the points."""
    rows = np.stack((nx, ny, turn))
    weighted = w * rows
    return np.einsum("inm,jnm->nij", weighted, rows), np.einsum("inm,nm->ni", weighted, r)
