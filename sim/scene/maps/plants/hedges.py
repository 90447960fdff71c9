"""Clipped hedges: a closed, slightly uneven body of foliage."""

from __future__ import annotations

from functools import cache

from signals.samples import Vec3
from sim.scene.maps.meshes import Mesh
from sim.scene.random_generator import RandomGenerator

_SEGMENT_M = 1.7
_TILE_M = 0.8
_UNEVEN_M = 0.05


@cache
def hedge_body(half_m: Vec3) -> Mesh:
    """Return a hedge round the origin, x along it, with rounded upper edges; within 0.05 m of the box `half_m`."""
    x, y, z = half_m
    rng = RandomGenerator(0, "hedge")
    # From the foot of one side over the top to the other: place, and its outward direction.
    profile = (
        (-0.94 * y, -z, -1.0, 0.0), (-y, 0.45 * z, -1.0, 0.0), (-0.72 * y, z, -0.4, 0.9),
        (0.72 * y, z, 0.4, 0.9), (y, 0.45 * z, 1.0, 0.0), (0.94 * y, -z, 1.0, 0.0),
    )  # fmt: skip
    mesh = Mesh.empty()
    count = max(1, round(2.0 * x / _SEGMENT_M))
    row = len(profile)
    for k in range(count + 1):
        at = -x + 2.0 * x * k / count
        around = 0.0
        for j, (side, up, out_y, out_z) in enumerate(profile):
            if j:
                before = profile[j - 1]
                # The sides are steep and the top is flat: the way round is about the greater of both differences.
                around += max(abs(side - before[0]), abs(up - before[1]))
            off = rng.between(-_UNEVEN_M, _UNEVEN_M)
            mesh.vertices.append((at, side + off * out_y, up + off * out_z))
            mesh.uvs.append((at / _TILE_M, around / _TILE_M))
    for k in range(count):
        for j in range(row):
            a, b = k * row + j, k * row + (j + 1) % row
            mesh.triangles += [(a, b + row, b), (a, a + row, b + row)]
    for end in (0, count * row):
        corners = mesh.vertices[end : end + row]
        if end == 0:
            corners = corners[::-1]
        # Counter-clockwise seen from outside; the texture goes on from the sides.
        mesh.add_polygon(corners[::-1], [(py / _TILE_M, pz / _TILE_M) for _, py, pz in corners[::-1]])
    return mesh
