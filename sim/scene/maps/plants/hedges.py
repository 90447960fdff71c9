"""Clipped hedges: a body of foliage with twigs all over it."""

from __future__ import annotations

from functools import cache

from signals.samples import Vec3
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.plants.cards import fan, weighted
from sim.scene.maps.plants.growth import along
from sim.scene.random_generator import RandomGenerator

_GAP_M = 1.1
INSIDE_M = 0.03  # depth of the body of foliage below the clipped faces


@cache
def hedge_cards(half_m: Vec3) -> Mesh:
    """Return the twigs that stick out of a hedge's upper edges, centred at its middle, x along it."""
    x, y, z = half_m
    rng = RandomGenerator(0, "hedge")
    mesh = Mesh.empty()
    count = max(2, int(2.0 * x / _GAP_M))
    for k in range(2 * count):
        side = 1.0 if k % 2 else -1.0
        at = -x + 2.0 * x * (k + rng.unit()) / (2.0 * count)
        out = (0.0, 0.8 * side, 0.6)
        d = weighted((1.0, (rng.between(-1.0, 1.0), 0.0, 0.0)), (0.10, out), (0.25, (0.0, 0.0, 1.0)))
        facing = weighted((1.0, out), (0.4, (rng.between(-1.0, 1.0), 0.0, rng.between(-1.0, 1.0))))
        long = 0.36 * rng.between(0.85, 1.15)
        base = along((at, (y - 0.02) * side, z - 0.05), d, -0.6 * long)
        fan(mesh, base, d, facing, (long, 1.9 * long), k, [weighted((1.0, out), (0.3, facing))] * 3)
    return mesh
