"""MuJoCo's binary mesh format."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]


def msh(vertex: Floats, triangle: NDArray[np.integer[Any]], uv: Floats | None, normal: Floats | None) -> bytes:
    """Return a mesh file: vertices (n, 3), triangles (m, 3), and for each vertex a texture coordinate (v downwards)
    and a normal. MuJoCo wants at least 4 vertices, so that the last one may be repeated."""
    while len(vertex) < 4:
        vertex = np.concatenate([vertex, vertex[-1:]])
        uv = None if uv is None else np.concatenate([uv, uv[-1:]])
        normal = None if normal is None else np.concatenate([normal, normal[-1:]])
    counts = (len(vertex), 0 if normal is None else len(normal), 0 if uv is None else len(uv), len(triangle))
    arrays = [np.array(counts, "<i4"), vertex.astype("<f4")]
    arrays += [array.astype("<f4") for array in (normal, uv) if array is not None]
    return b"".join(array.tobytes() for array in (*arrays, triangle.astype("<i4")))
