"""Texture coordinates of painted meshes."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh


def reflecting(mesh: Mesh) -> Mesh:
    """Return a painted mesh with texture coordinates for what paint reflects: once along 4 m, and up to its top."""
    high = max((z for _, _, z in mesh.vertices), default=1.0)
    uvs = [((x + 0.35 * y) / 4.0, min(0.99, max(0.01, z / high))) for x, y, z in mesh.vertices]
    return Mesh(mesh.vertices, uvs, mesh.triangles)
