"""Labels of a frame's ghosts: for each object, path and mirror the mean and the expected power of its ghost echoes.

Means and powers are those of `ObjectEcho` (object_echoes.py). A ghost of kind "out" or "back" has the range and speed
half way between the object and its image, and comes back from the object or from the mirror.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels import azimuth_elevation
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.ghost_echoes import KINDS, Ghosts
from sim.radar.object_echoes import ObjectEcho
from sim.radar.receiver import Receiver


class GhostEcho(NamedTuple):
    """Ghost of one object by one mirror."""

    echo: ObjectEcho  # `instance`: the true object
    path: str  # "both ways", "out" or "back": where it goes by the mirror
    mirror: int  # instance of the mirror


def ghost_objects(ghosts: Ghosts, chirp: Chirp, receiver: Receiver) -> list[GhostEcho]:
    """Return the ghosts by rising instance, path and mirror; instance 0 (no object) has none."""
    e = ghosts.echoes
    input_power = e.amplitude * e.amplitude
    f_hz = e.range_m * (2.0 * chirp.slope_hz_per_s / SPEED_OF_LIGHT_MPS)
    power = input_power * receiver.filter_power(f_hz)
    found: list[GhostEcho] = []
    order = np.lexsort((ghosts.mirror, ghosts.kind, ghosts.instance))
    key = np.stack([ghosts.instance[order], ghosts.kind[order].astype(np.int64), ghosts.mirror[order]], axis=1)
    starts = np.flatnonzero(np.any(np.diff(key, axis=0, prepend=-1) != 0, axis=1)).tolist()
    for first, last in pairwise([*starts, len(order)]):  # none in a frame without ghosts
        instance, kind, mirror = key[first].tolist()
        some = order[first:last]
        weight, total = power[some], _sum(power[some])
        if instance == 0 or total == 0.0:
            continue
        d = np.array([[_sum(weight * e.direction_R[some, axis]) / total for axis in range(3)]])
        azimuth, elevation = np.empty(1), np.empty(1)
        azimuth_elevation(d, azimuth, elevation)
        echo = ObjectEcho(
            instance,
            _sum(weight * e.range_m[some]) / total,
            float(e.range_m[some].min()),
            _sum(weight * e.speed_mps[some]) / total,
            float(azimuth[0]),
            float(elevation[0]),
            total,
            _sum(input_power[some]) / receiver.counts_per_sqrt_watt**2,
        )
        found.append(GhostEcho(echo, KINDS[kind], mirror))
    return found


def _sum(values: NDArray[np.float64]) -> float:
    """Return the sum in the order of the values, the same on every machine."""
    return float(np.bincount(np.zeros(len(values), np.int64), values)[0])
