"""Rays by mj_multiRay in double precision, continued through the holes of meshes, which MuJoCo does not know.

A hit on a mesh whose texture has an alpha channel is placed on its triangle; where the texel there is open, the ray is
cast again from just behind the hit.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.frame.scenery import open_texels

Float64 = NDArray[np.float64]
GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # geoms of group 3 and above are not drawn
_BEHIND_M = 1e-9
_MOST_HOLES = 200  # passed by one ray


def cast(
    model: mujoco.MjModel, data: mujoco.MjData, origin_W: Float64, directions_W: Float64
) -> tuple[NDArray[np.int32], Float64, Float64]:
    """Cast rays; `directions_W` is (n, 3), unit vectors.

    Return geom (n,), -1 for none, distance (n,) [m] and normal (n, 3).
    """
    n = len(directions_W)
    geom, distance, normal = np.zeros(n, np.int32), np.zeros(n), np.zeros((n, 3))
    vectors = np.ascontiguousarray(directions_W, np.float64).reshape(-1)
    mujoco.mj_multiRay(
        model, data, np.asarray(origin_W, float), vectors, GROUPS, 1, -1, geom, distance, normal.reshape(-1), n, 1e10
    )
    go_on(model, data, (np.asarray(origin_W, float), np.asarray(directions_W, float)), (geom, distance, normal))
    return geom, distance, normal


def go_on(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    rays: tuple[Float64, Float64],
    hits: tuple[NDArray[np.int32], Float64, Float64],
) -> None:
    """Replace hits in holes, in place; `rays`: origin and directions, `hits`: geom, distance and normal."""
    (origin_W, directions_W), (geom, distance, normal) = rays, hits
    holes = open_texels(model)
    left = np.flatnonzero(np.isin(geom, list(holes)))
    for _ in range(_MOST_HOLES):
        points_W = origin_W + distance[left, None] * directions_W[left]
        passes = np.zeros(len(left), bool)
        for number in np.unique(geom[left]).tolist():
            here = geom[left] == number
            passes[here] = _in_holes(model, data, number, holes[number], points_W[here])
        left = left[passes]
        if len(left) == 0:
            return
        for i in left.tolist():
            start = distance[i] + _BEHIND_M
            hit, n_W = np.zeros(1, np.int32), np.zeros(3)
            further = mujoco.mj_ray(
                model, data, origin_W + start * directions_W[i], directions_W[i], GROUPS, 1, -1, hit, n_W
            )
            geom[i], distance[i], normal[i] = hit[0], start + further if hit[0] >= 0 else -1.0, n_W
        left = left[np.isin(geom[left], list(holes))]


def _in_holes(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, is_open: NDArray[np.bool_], points_W: Float64
) -> NDArray[np.bool_]:
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[first : first + count]].astype(np.float64)
    uv = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + model.mesh_facetexcoord[first : first + count]]
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    n = np.cross(ab, ac)
    nn = np.maximum(np.einsum("mi,mi->m", n, n), 1e-300)
    height, width = is_open.shape
    found = np.zeros(len(points_W), bool)
    points = (points_W - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    for i, point in enumerate(points):
        p = point - a
        wb = np.einsum("mi,mi->m", np.cross(p, ac), n) / nn
        wc = np.einsum("mi,mi->m", np.cross(ab, p), n) / nn
        off_plane = np.abs(np.einsum("mi,mi->m", p, n)) / np.sqrt(nn)
        outside = np.maximum(np.maximum(-wb, -wc), np.maximum(wb + wc - 1.0, 0.0))
        t = int(np.argmin(off_plane + outside))
        u, v = uv[t, 0] + wb[t] * (uv[t, 1] - uv[t, 0]) + wc[t] * (uv[t, 2] - uv[t, 0])
        # MuJoCo counts v downwards from the first row.
        found[i] = is_open[int(np.floor(v * height)) % height, int(np.floor(u * width)) % width]
    return found
