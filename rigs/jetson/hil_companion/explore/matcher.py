"""Scan against map, for all particles at once: where each would put the scan, how sure that is, and how well it fits.

For each point b of the scan (in H), with its normal n, and the nearest place h that the particle's map holds about it,

    r = n . (h - (R(yaw) b + p))           distance from the surface; along it nothing pulls

and Gauss-Newton finds the pose that makes sum w r^2 / s^2 + (x - x_0)' Q^-1 (x - x_0) least, x_0 and Q where the motion
says that the particle is. w is Cauchy's weight times how often the place was met: what moves weighs nothing for long.
The likelihood of the field at that pose, tempered since neighbouring beams are no independent witnesses, is its weight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_companion.explore.maps import Maps
from hil_companion.explore.rotation import wrapped

_ROUNDS = 4
_STEPS = 2  # of Gauss-Newton between two looks for the nearest
_SETTLED_M, _SETTLED_RAD = 0.01, 0.001  # a step that finds no other nearest places
_SIGMA_M = 0.05  # of a point about its surface: range noise, cell, tilt
_OUTLIER_M = 0.10  # Cauchy's scale
_RANDOM = 0.02  # share of a beam's likelihood that anything has
_RIPE = 3  # met so often, a place counts in full
_WITNESSES = 8.0  # that all points of a scan are worth, for the weights
_INDEPENDENT = 0.4  # share of the points that are worth a witness each, for the spread
_LEAST_POINTS = 12


class Match(NamedTuple):
    """By particle."""

    pose: np.ndarray  # (n, 3): x, y, yaw
    spread: np.ndarray  # (n, 3, 3)
    log_likelihood: np.ndarray  # (n,)
    inliers: np.ndarray  # (n,) share of the points near a surface of the map, of those that have any place near
    known: np.ndarray  # (n,) share of the points that have any place near


def match(maps: Maps, predicted: np.ndarray, information: np.ndarray, xy: np.ndarray, normal: np.ndarray) -> Match:
    """`predicted` (n, 3), `information` (3, 3) = Q^-1."""
    pose = predicted.copy()
    n = len(pose)
    if len(xy) < _LEAST_POINTS:
        spread = np.repeat(np.linalg.inv(information)[None], n, axis=0)
        return Match(pose, spread, np.zeros(n), np.zeros(n), np.zeros(n))
    has_normal = (normal != 0.0).any(axis=1)
    reach = maps.cell_m
    for turn_number in range(_ROUNDS):
        c, s = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        bx, by = c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]
        cells = np.stack([bx + pose[:, :1], by + pose[:, 1:2]], axis=-1)
        dx, dy, far, count = maps.nearest(maps.cells(cells))
        dx, dy = dx * reach, dy * reach
        ripe = np.minimum(count, _RIPE) * (1.0 / _RIPE)
        nx, ny = c * normal[:, 0] - s * normal[:, 1], s * normal[:, 0] + c * normal[:, 1]
        length = np.sqrt(np.maximum(dx * dx + dy * dy, 1e-12))
        nx, ny = np.where(has_normal, nx, dx / length), np.where(has_normal, ny, dy / length)
        turn = ny * bx - nx * by  # how r falls with yaw
        r0 = nx * dx + ny * dy
        begin = pose.copy()
        for _ in range(_STEPS):
            move = pose - begin
            r = r0 - nx * move[:, :1] - ny * move[:, 1:2] - turn * move[:, 2:]
            w = ripe / (1.0 + (r * (1.0 / _OUTLIER_M)) ** 2) * (1.0 / (_SIGMA_M * _SIGMA_M))
            H, g = _normal_equations(w, r, nx, ny, turn)
            H = _INDEPENDENT * H + information
            off = predicted - pose
            off[:, 2] = wrapped(off[:, 2])
            g = _INDEPENDENT * g + off @ information
            pose = pose + np.linalg.solve(H, g[:, :, None])[:, :, 0]
        step = np.abs(pose - begin).max(axis=0)
        if turn_number and max(step[0], step[1]) < _SETTLED_M and step[2] < _SETTLED_RAD:
            break
    move = pose - begin
    r = r0 - nx * move[:, :1] - ny * move[:, 1:2] - turn * move[:, 2:]
    known = np.isfinite(far)
    likely = np.where(known, np.exp(-0.5 * (r * (1.0 / _SIGMA_M)) ** 2) * ripe, 0.0)
    log_likelihood = np.log(likely + _RANDOM).mean(axis=1) * _WITNESSES
    off = predicted - pose
    off[:, 2] = wrapped(off[:, 2])
    log_likelihood -= 0.5 * np.einsum("ni,ij,nj->n", off, information, off)
    near = known & (np.abs(r) < 2.5 * _SIGMA_M)
    inliers = near.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return Match(pose, np.linalg.inv(H), log_likelihood, inliers, known.mean(axis=1))


def _normal_equations(
    w: np.ndarray, r: np.ndarray, nx: np.ndarray, ny: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sums over the points, of each particle."""
    rows = np.stack((nx, ny, turn))
    weighted = w * rows
    return np.einsum("inm,jnm->nij", weighted, rows), np.einsum("inm,nm->ni", weighted, r)
