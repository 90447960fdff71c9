"""Mesh of a model, as arrays in the precision in which MuJoCo keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim.scene.imports.msh import msh

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ShippedMesh:
    """Vertices (n, 3) [m] with texture coordinates (n, 2), v downwards, perhaps normals (n, 3); triangles (m, 3)."""

    vertices: Float32
    uvs: Float32
    normals: Float32 | None
    triangles: NDArray[np.integer[Any]]
    suffix: ClassVar[str] = ".msh"

    def data(self) -> bytes:
        """Return the mesh as a file in MuJoCo's own format."""
        return msh(self.vertices, self.triangles, self.uvs, self.normals)


def joined(meshes: Sequence[ShippedMesh]) -> ShippedMesh:
    """Return all meshes as one; with normals if all have some."""
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    return ShippedMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.uvs for mesh in meshes]),
        np.concatenate(normals) if len(normals) == len(meshes) else None,
        np.concatenate([mesh.triangles.astype(np.int64) + start for mesh, start in zip(meshes, starts, strict=False)]),
    )
