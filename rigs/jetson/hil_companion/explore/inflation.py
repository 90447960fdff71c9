"""How far from obstacles the vehicle has to stay, and what a metre costs where.

    hard    = radius + clearance + 2 sigma + slow speed times reaction + half a cell's diagonal
    comfort = hard + cruising speed times reaction

Nothing is planned within `hard` of an obstacle; between the two a metre costs more and is flown slower. sigma is the
larger half axis of the position's covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from hil_companion.explore.settings import FlightSettings

MOST_SIGMA_M = 0.4  # more uncertainty than this is flown with slower, not with a wider berth: streets are not wider
_NEAR_PRICE = 1.5  # a metre at `hard` counts as 1 + this


@dataclass(frozen=True)
class Berth:
    """Distances of the vehicle's middle to obstacles [m]."""

    red_m: float  # the clearance is nearly used up: stop, back off
    orange_m: float  # move away from the obstacle
    hard_m: float  # nothing is planned nearer
    comfort_m: float


def sigma_m(covariance_xy: np.ndarray) -> float:
    """The larger half axis; infinite where it is no covariance."""
    a, b, d = float(covariance_xy[0][0]), float(covariance_xy[0][1]), float(covariance_xy[1][1])
    largest = 0.5 * (a + d) + math.sqrt(max(0.25 * (a - d) * (a - d) + b * b, 0.0))
    return math.sqrt(largest) if largest >= 0.0 and math.isfinite(largest) else math.inf


def berth(settings: FlightSettings, sigma: float, cell_m: float) -> Berth:
    """For this uncertainty of the position."""
    least = settings.vehicle_radius_m + settings.clearance_m
    spread = 2.0 * min(sigma, MOST_SIGMA_M)
    hard = least + spread + settings.slow_mps * settings.reaction_s + 0.7072 * cell_m
    comfort = hard + settings.speed_mps * settings.reaction_s
    red = least + 0.1
    # Measured by the newest sweep, which no error of the position touches.
    return Berth(red, max(red + 0.1, hard - 0.5 * spread - 0.1), hard, comfort)


def distances_m(occupied: np.ndarray, cell_m: float) -> np.ndarray:
    """From the middle of every cell to the nearest occupied one's; large where there is none."""
    if not occupied.any():
        return np.full(occupied.shape, 1e3, np.float32)
    free = np.where(occupied, 0, 1).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5), np.float32) * np.float32(cell_m)


def prices(distance_m: np.ndarray, unknown: np.ndarray, around: Berth, unknown_price: float) -> np.ndarray:
    """Of a metre in every cell: 1 in known free space far from anything, infinite nearer than `hard`."""
    near = np.clip((around.comfort_m - distance_m) / max(around.comfort_m - around.hard_m, 1e-6), 0.0, 1.0)
    price = 1.0 + _NEAR_PRICE * near * near + unknown_price * unknown
    return np.where(distance_m < around.hard_m, np.inf, price).astype(np.float64)


def coarser(price: np.ndarray, blocks: int) -> np.ndarray:
    """Of every block of cells the cheapest. Optimistic: what cannot be passed here, cannot be in the finer grid."""
    height, width = price.shape
    padded = np.pad(price, ((0, -height % blocks), (0, -width % blocks)), constant_values=np.inf)
    h, w = padded.shape
    return np.asarray(padded.reshape(h // blocks, blocks, w // blocks, blocks).min(axis=(1, 3)))
