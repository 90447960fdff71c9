"""Ways of signals to the antenna through a scene, found by its rays.

A ray goes on through foliage and through what moves until it meets a solid. The way through foliage is the sum of the
gaps between two surfaces of the same plant in a row. Its loss is that of ITU-R P.833 for a way d [m]:

    L = A_m (1 - exp(-d g / A_m)),   A_m = 0.18 f^0.752 = 45.6 dB at f = 1575 MHz

A reflection counts if the ray to its point meets a face there with the face's normal, and if the ray on to the
satellite is free. Faces within 250 m count, as if they were larger than the first Fresnel zone. Diffraction round edges
is left out: a signal is there or blocked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_exp
from signals.rotation import dot, minus, norm
from signals.samples import Vec3
from sim._kernels import above_mask, mirror_hits
from sim.gnss.surroundings import Surroundings

Float64 = NDArray[np.float64]

_FOLIAGE_MOST_DB = 45.6
_FAR_M = 1e6
_STEP_M = 1e-4  # by which a ray goes on behind a surface
_MOST_SURFACES = 400  # of foliage and of moving things on one ray
_MEETS_M, _MEETS_COSINE = 0.3, 0.995  # windows and ledges stand out from a wall's plane
_MOST_IMAGES = 4096
FARTHEST_FACE_M = 250.0  # beyond, most faces are smaller than the first Fresnel zone


class Reach(NamedTuple):
    """Ends of rays: of each, the distance to the first solid, and the way through foliage before it."""

    range_m: Float64  # +inf: nothing
    geom: NDArray[np.int32]  # -1: nothing
    normal: Float64
    foliage_m: Float64


class Reflection(NamedTuple):
    """Signal of a satellite by way of one face."""

    satellite: int
    direction: Vec3  # in which the antenna sees it
    extra_m: float
    extra_rate: float  # of extra_m per velocity: d extra / dt = extra_rate . v
    rate_direction: Vec3
    cosine: float
    geom: int
    foliage_m: float


class SignalPaths:
    """Casts the rays of one antenna."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._around = surroundings
        self._caster = surroundings.caster
        self._of = np.empty((_MOST_IMAGES, 2), np.int32)
        self._what = np.empty((_MOST_IMAGES, 9))
        self.rays = 0

    def is_clear(self, antenna_W: Vec3, mask_tangent: float) -> bool:
        """Return True if nothing of the scene rises above the elevation mask, seen from the antenna."""
        return not above_mask(self._around.boxes, antenna_W, mask_tangent)

    def cast(self, origins: Float64, directions: Float64, farthest_m: float = _FAR_M) -> Reach:
        """Cast rays to the first solid."""
        around, count = self._around, len(directions)
        reach = Reach(np.full(count, np.inf), np.full(count, -1, np.int32), np.zeros((count, 3)), np.zeros(count))
        if count == 0:
            return reach
        active = np.arange(count)
        start = np.zeros(count)  # of the present piece of each ray
        plant = np.full(count, -1, np.int64)  # instance of the last surface, if it was foliage
        for _ in range(_MOST_SURFACES):
            n = len(active)
            d = np.ascontiguousarray(directions[active])
            p = np.ascontiguousarray(origins[active] + start[active, None] * d)
            t, geom, normal = np.empty(n), np.empty(n, np.int32), np.empty((n, 3))
            self._caster.cast(p, d, 0.0, farthest_m, t, geom, normal)
            self.rays += n
            met = geom >= 0
            at = start[active] + t
            met &= at <= farthest_m
            safe = np.maximum(geom, 0)
            leaf = met & around.geom_foliage[safe] & ~around.geom_moving[safe]
            passed = leaf | (met & around.geom_moving[safe])
            solid = met & ~passed
            hit = active[solid]
            reach.range_m[hit], reach.geom[hit], reach.normal[hit] = at[solid], geom[solid], normal[solid]
            instance = np.where(leaf, around.geom_instance[safe].astype(np.int64), -1)
            same = leaf & (instance == plant[active])
            reach.foliage_m[active[same]] += t[same]
            plant[active[leaf]] = instance[leaf]
            start[active] = np.where(passed, at + _STEP_M, start[active])
            active = active[passed]
            if len(active) == 0:
                break
        return reach

    def to_satellites(self, antenna_W: Vec3, directions: Float64) -> Reach:
        """Cast the rays from the antenna."""
        return self.cast(np.tile(np.array(antenna_W), (len(directions), 1)), directions)

    def reflections(self, antenna_W: Vec3, directions: Float64, farthest_extra_m: float) -> list[Reflection]:
        """Return the reflections that reach the antenna, in the order of the satellites."""
        found = mirror_hits(
            antenna_W, self._around.faces, directions, FARTHEST_FACE_M, farthest_extra_m, self._of, self._what
        )
        count = min(int(found), _MOST_IMAGES)
        if count == 0:
            return []
        of, what = self._of[:count].copy(), self._what[:count].copy()
        to_face = what[:, :3]
        origin = np.array(antenna_W)
        seen = self.cast(np.tile(origin, (count, 1)), to_face)
        n = what[:, 3:6]
        along = dot(seen.normal.T, n.T)
        meets = (np.abs(seen.range_m - what[:, 6]) <= _MEETS_M) & (along >= _MEETS_COSINE)
        kept = np.flatnonzero(meets)
        if len(kept) == 0:
            return []
        points = origin + (seen.range_m[kept] - 1e-3)[:, None] * to_face[kept]
        onward = self.cast(points, np.ascontiguousarray(directions[of[kept, 0]]))
        result: list[Reflection] = []
        known: set[tuple[int, int]] = set()
        for k, (i, is_free) in enumerate(zip(kept.tolist(), (onward.geom < 0).tolist(), strict=True)):
            satellite = int(of[i, 0])
            # Sheets of one wall have one image: the ray met the one in front.
            same = (satellite, round(float(what[i, 7]) / _MEETS_M))
            if not is_free or same in known:
                continue
            known.add(same)
            row = what[i].tolist()
            result.append(
                Reflection(
                    satellite,
                    (row[0], row[1], row[2]),
                    row[7],
                    2.0 * row[8],
                    (row[3], row[4], row[5]),
                    row[8],
                    int(seen.geom[i]),
                    float(seen.foliage_m[i] + onward.foliage_m[k]),
                )
            )
        return result

    def is_hidden(self, antenna_W: Vec3, place_W: Vec3) -> bool:
        """Return True if a solid stands between the antenna and a place."""
        d = minus(place_W, antenna_W)
        length = norm(d)
        if length < 0.1:
            return False
        direction = np.array([[x / length for x in d]])
        return bool(self.cast(np.array([antenna_W]), direction, length - 0.05).geom[0] >= 0)


def foliage_loss_db(way_m: float, db_per_m: float) -> float:
    """Return the loss on a way through foliage."""
    if way_m <= 0.0:
        return 0.0
    return _FOLIAGE_MOST_DB * (1.0 - det_exp(-way_m * db_per_m / _FOLIAGE_MOST_DB))
