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

    def part(array: NDArray, begin: NDArray, count: NDArray) -> NDArray:
        return array[int(begin[mesh]) : int(begin[mesh]) + int(count[mesh])]

    vertex = part(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum)
    triangle = part(model.mesh_face, model.mesh_faceadr, model.mesh_facenum)
    normals = part(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum)
    of_normal = part(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum)
    corner_normal = normals[of_normal] if len(normals) else None
    if corner_normal is not None and _flat(vertex[triangle].astype(np.float64), corner_normal):
        corner_normal = None
    uv = None
    if model.mesh_texcoordadr[mesh] >= 0:
        coordinates = part(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum)
        uv = coordinates[part(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum)]
        uv = uv * np.array([1.0, -1.0], np.float32) + np.array(
            [0.0, 1.0], np.float32
        )  # v of MuJoCo counts downwards from the first row
    return Triangles(
        _as(vertex, np.float32),
        _as(triangle, np.int32),
        None if uv is None else _as(uv, np.float32),
        None if corner_normal is None else _as(corner_normal, np.float32),
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
    here, right, up, across = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = [_stack(here, right, across), _stack(here, across, up)]
    rim = np.concatenate([index[0, :], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    following = np.roll(rim, -1)
    below = rows * columns
    triangles += [_stack(rim, rim + below, following), _stack(following, rim + below, following + below)]
    triangles.append(_stack(np.full_like(rim, 2 * below), following + below, rim + below))
    return Triangles(_as(vertex, np.float32), _as(np.concatenate(triangles), np.int32))


def _stack(*corners: NDArray) -> NDArray:
    return np.stack([corner.ravel() for corner in corners], axis=-1)


def _as(array: NDArray, dtype: type) -> NDArray:
    return np.ascontiguousarray(array, dtype=dtype)
