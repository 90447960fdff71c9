"""Texture coordinates of painted meshes."""

from __future__ import annotations

from sim.scene.maps.meshes import Mesh, Vec2

# Texture coordinates of a gap between two panels, in the shade of the paint's own colour, and of a bead in a sheet.
_GAP: Vec2 = (0.5, 0.5 / 128.0)
_BEAD: Vec2 = (0.5, 0.52)


def reflecting(mesh: Mesh) -> Mesh:
    """Return a painted mesh with texture coordinates for what paint reflects: once along 4 m, and up to its top."""
    high = max((z for _, _, z in mesh.vertices), default=1.0)
    uvs = [((x + 0.35 * y) / 4.0, min(0.99, max(0.01, z / high))) for x, y, z in mesh.vertices]
    return Mesh(mesh.vertices, uvs, mesh.triangles)


def with_lines(paint: Mesh, gaps: Mesh, beads: Mesh) -> Mesh:
    """Return a painted mesh with the lines on it: the same material, darker by their texture coordinates."""
    whole = Mesh(list(paint.vertices), list(paint.uvs), list(paint.triangles))
    for lines, uv in ((gaps, _GAP), (beads, _BEAD)):
        first = len(whole.vertices)
        whole.vertices += lines.vertices
        whole.uvs += [uv] * len(lines.vertices)
        whole.triangles += [(a + first, b + first, c + first) for a, b, c in lines.triangles]
    return whole
