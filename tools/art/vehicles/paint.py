"""Texture coordinates of painted meshes."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh, Vec2

# Texture coordinate of beads: somewhat darker than the sheet beside them.
_BEAD: Vec2 = (0.5, 0.52)


def reflecting(mesh: Mesh) -> Mesh:
    """Return a painted mesh with texture coordinates for what paint reflects: once along 4 m, and up to its top."""
    high = max((z for _, _, z in mesh.vertices), default=1.0)
    uvs = [((x + 0.35 * y) / 4.0, min(0.99, max(0.01, z / high))) for x, y, z in mesh.vertices]
    return Mesh(mesh.vertices, uvs, mesh.triangles)


def with_beads(paint: Mesh, beads: Mesh) -> Mesh:
    """Return a painted mesh with the beads on it, which differ from it by their texture coordinate only."""
    first = len(paint.vertices)
    return Mesh(
        paint.vertices + beads.vertices,
        paint.uvs + [_BEAD] * len(beads.vertices),
        paint.triangles + [(a + first, b + first, c + first) for a, b, c in beads.triangles],
    )
