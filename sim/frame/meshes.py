"""Triangles of a MuJoCo model's meshes and height fields, for the native geometry."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

_SAME_DIRECTION = 1.0 - 1e-6  # cosine


class Triangles(NamedTuple):
    """Mesh: vertices [m], corners of triangles, optional texture coordinates and normals."""

    vertex: NDArray[np.float32]  # (n, 3)
    triangle: NDArray[np.int32]  # (m, 3)
    uv: NDArray[np.float32] | None = None  # (m, 3, 2)
    corner_normal: NDArray[np.float32] | None = None  # (m, 3, 3)


def mesh_triangles(model: mujoco.MjModel, mesh: int) -> Triangles:
    """Return mesh number `mesh`, in the frame of the geoms that use it."""

    def rows_of(array: NDArray, begin: NDArray, count: NDArray) -> NDArray:
        return array[int(begin[mesh]) : int(begin[mesh]) + int(count[mesh])]

    vertex = rows_of(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum)
    triangle = rows_of(model.mesh_face, model.mesh_faceadr, model.mesh_facenum)
    normals = rows_of(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum)
    normal_index = rows_of(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum)
    corner_normal = normals[normal_index] if len(normals) else None
    if corner_normal is not None and _flat(vertex[triangle].astype(np.float64), corner_normal):
        corner_normal = None
    uv = None
    if model.mesh_texcoordadr[mesh] >= 0:
        coordinates = rows_of(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum)
        uv = coordinates[rows_of(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum)]
        # MuJoCo counts v downwards from the first row.
        uv = uv * np.array([1.0, -1.0], np.float32) + np.array([0.0, 1.0], np.float32)
    return Triangles(
        _contiguous(vertex, np.float32),
        _contiguous(triangle, np.int32),
        None if uv is None else _contiguous(uv, np.float32),
        None if corner_normal is None else _contiguous(corner_normal, np.float32),
    )


def _flat(corners: NDArray, normals: NDArray) -> bool:
    """Return True if the normals at the corners are those of the triangles; both are (m, 3, 3)."""
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-30)
    return bool(np.all(np.einsum("mi,mki->mk", face, normals) > _SAME_DIRECTION))


def height_field_triangles(model: mujoco.MjModel, field: int) -> Triangles:
    """Return height field number `field`: its surface, cut along the diagonals of mj_ray, with sides and a bottom."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    begin = int(model.hfield_adr[field])
    half_x, half_y, top, bottom = (float(v) for v in model.hfield_size[field])
    height = model.hfield_data[begin : begin + rows * columns].reshape(rows, columns).astype(np.float64) * top
    x = np.linspace(-half_x, half_x, columns)
    y = np.linspace(-half_y, half_y, rows)
    grid_x, grid_y = np.meshgrid(x, y)
    surface = np.stack([grid_x, grid_y, height], axis=-1).reshape(-1, 3)
    base = surface.copy()
    base[:, 2] = -bottom
    vertex = np.concatenate([surface, base, [[0.0, 0.0, -bottom]]])
    index = np.arange(rows * columns).reshape(rows, columns)
    corner, next_x, next_y, next_xy = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = [_stack(corner, next_x, next_xy), _stack(corner, next_xy, next_y)]
    rim = np.concatenate([index[0, :], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    following = np.roll(rim, -1)
    n = rows * columns  # index of a surface vertex + n: the base vertex under it; 2 n: centre of the base
    triangles += [_stack(rim, rim + n, following), _stack(following, rim + n, following + n)]
    triangles.append(_stack(np.full_like(rim, 2 * n), following + n, rim + n))
    return Triangles(_contiguous(vertex, np.float32), _contiguous(np.concatenate(triangles), np.int32))


def _stack(*corners: NDArray) -> NDArray:
    return np.stack([corner.ravel() for corner in corners], axis=-1)


def _contiguous(array: NDArray, dtype: type) -> NDArray:
    return np.ascontiguousarray(array, dtype=dtype)
