"""Places on the wheelchair (model people/wheelchair): x forward, y left, the origin on the ground below the hips."""

from __future__ import annotations

from math import sqrt

from signals.samples import Vec3
from sim.scene.maps.models import model

SEAT_M = 0.50
FOOTREST_M = 0.115
BOX: tuple[Vec3, Vec3] = ((0.06, 0.0, 0.30), (0.33, 0.28, 0.22))  # centre and half edges of its shape for contact


def reach_m(hip_z_m: float) -> float:
    """Return the distance of its farthest point from the hips."""
    farthest = model("people/wheelchair").facts["farthest_m"]  # from hips of any height
    return sqrt(max(x * x + y * y + (z - hip_z_m) * (z - hip_z_m) for x, y, z in farthest))
