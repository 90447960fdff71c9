"""Slow, exact reference of a frame: one double-precision ray per pixel against every geom, by brute force.

A ray p(t) = o + t d meets each shape where, in the frame of the geom (o, d turned into it):

    plane       o_z + t d_z = 0, met from above only, inside the half edges (0 = without end)
    sphere      |o + t d|^2 = r^2
    ellipsoid   |S^-1 (o + t d)|^2 = 1,  S = diag(semi-axes)
    box         the last entry to, or the first exit from, three slabs
    cylinder    slab |z| <= h cut with x^2 + y^2 <= r^2
    capsule     the nearest of the side |z| <= h and of the two half spheres
    mesh        Moeller and Trumbore (J. Graphics Tools 2, 1997), every triangle, from both sides
    hfield      two triangles per cell, the base box, and the sides between base and terrain: a solid, as mj_ray sees it

The smallest t > t_min counts: from inside a closed shape that is the way out. The velocity of the surface at p, of a
geom whose body moves with the twist (v, w) at x, is v + w x (p - x); seen from a point that moves with v_C,

    radial velocity = (v + w x (p - x) - v_C) . d,   positive: receding.

Conventions of mj_ray hold: geoms of group >= 3 or alpha 0 are not there. No code is shared with what it checks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
_RAYS_AT_ONCE = 4096
_PARALLEL = 1e-300


@dataclass(frozen=True)
class Hits:
    """What n rays met. Without a hit: geom -1, range inf, normal and velocity 0."""

    geom: NDArray[np.int32]
    range_m: Float64
    normal_W: Float64  # (n, 3) unit, towards the origin of the ray
    radial_velocity_mps: Float64


@dataclass(frozen=True)
class Twists:
    """Motion of each geom: velocity [m/s] of the point x_W [m] fixed to it, and its turn rate [rad/s]."""

    x_W: Float64  # (ngeom, 3)
    v_W: Float64
    w_W: Float64

    @staticmethod
    def still(count: int) -> Twists:
        """Nothing moves."""
        return Twists(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)))


def visible_geoms(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms a camera sees: group below 3, alpha above 0."""
    alpha = model.geom_rgba[:, 3].copy()
    with_material = model.geom_matid >= 0
    alpha[with_material] = model.mat_rgba[model.geom_matid[with_material], 3]
    return (model.geom_group < 3) & (alpha > 0)


def cast(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origin_W: Float64,
    directions_W: Float64,
    *,
    twists: Twists | None = None,
    v_origin_W: Float64 | None = None,
    t_min: Float64 | float = 0.0,
) -> Hits:
    """Cast rays from one point; `data` must be posed (mj_kinematics). `t_min` [m]: nearer surfaces are not seen."""
    directions = np.ascontiguousarray(directions_W, np.float64).reshape(-1, 3)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    nearest = np.broadcast_to(np.asarray(t_min, np.float64), len(directions))
    origin = np.asarray(origin_W, np.float64)
    geom = np.full(len(directions), -1, np.int32)
    range_m = np.full(len(directions), np.inf)
    normal = np.zeros((len(directions), 3))
    for index in np.flatnonzero(visible_geoms(model)):
        R_WG = data.geom_xmat[index].reshape(3, 3)
        p_WG = data.geom_xpos[index]
        candidates = _near(origin, directions, p_WG, _reach(model, int(index)))
        shape = _shape(model, int(index))
        for first in range(0, len(candidates), _RAYS_AT_ONCE):
            rays = candidates[first : first + _RAYS_AT_ONCE]
            o = (origin - p_WG) @ R_WG
            d = directions[rays] @ R_WG
            t, n = shape(np.broadcast_to(o, d.shape), d, nearest[rays])
            better = t < range_m[rays]
            which = rays[better]
            range_m[which] = t[better]
            geom[which] = index
            normal[which] = n[better] @ R_WG.T
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    normal *= np.where(np.einsum("ij,ij->i", normal, directions) > 0, -1.0, 1.0)[:, None]
    velocity = _radial_velocity(geom, range_m, origin, directions, twists, v_origin_W)
    return Hits(geom, range_m, normal, velocity)


def pinhole_directions(width: int, height: int, fov_deg: float) -> Float64:
    """(H, W, 3) unit directions in C (x right, y down, z forward) of the pixel centres; `fov_deg` is across."""
    focal = 0.5 * width / np.tan(0.5 * np.deg2rad(fov_deg))
    x = (np.arange(width) + 0.5 - 0.5 * width) / focal
    y = (np.arange(height) + 0.5 - 0.5 * height) / focal
    directions = np.stack([*np.meshgrid(x, y), np.ones((height, width))], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def _radial_velocity(
    geom: NDArray[np.int32],
    range_m: Float64,
    origin: Float64,
    directions: Float64,
    twists: Twists | None,
    v_origin_W: Float64 | None,
) -> Float64:
    velocity = np.zeros(len(geom))
    hit = geom >= 0
    relative = np.zeros((int(hit.sum()), 3))
    if twists is not None:
        g = geom[hit]
        p_W = origin + range_m[hit, None] * directions[hit]
        relative += twists.v_W[g] + np.cross(twists.w_W[g], p_W - twists.x_W[g])
    if v_origin_W is not None:
        relative -= v_origin_W
    velocity[hit] = np.einsum("ij,ij->i", relative, directions[hit])
    return velocity


def _reach(model: mujoco.MjModel, index: int) -> float:
    """Radius about the geom's origin that holds all of it; inf for planes."""
    kind, size = model.geom_type[index], model.geom_size[index]
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return np.inf
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return float(np.linalg.norm(_mesh(model, index), axis=-1).max(initial=0.0)) * (1 + 1e-9)
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        x, y, top, base = model.hfield_size[model.geom_dataid[index]]
        return float(np.linalg.norm((x, y, max(top, base)))) * (1 + 1e-9)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return float(size[0]) * (1 + 1e-9)
    return float(np.abs(size).sum()) * (1 + 1e-9)


def _near(origin: Float64, directions: Float64, p_WG: Float64, reach_m: float) -> NDArray[np.intp]:
    """Rays that pass within `reach_m` of the geom's origin, ahead of theirs."""
    if not np.isfinite(reach_m):
        return np.arange(len(directions))
    to_geom = p_WG - origin
    along = directions @ to_geom
    beside2 = to_geom @ to_geom - along * along
    return np.flatnonzero((beside2 <= reach_m**2 + 1e-9) & (along >= -reach_m))


_Shape = Callable[[Float64, Float64, Float64], tuple[Float64, Float64]]


def _shape(model: mujoco.MjModel, index: int) -> _Shape:
    kind, size = mujoco.mjtGeom(model.geom_type[index]), np.array(model.geom_size[index])
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return lambda o, d, t0: _plane(o, d, t0, size)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return lambda o, d, t0: _ellipsoid(o, d, t0, np.full(3, size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return lambda o, d, t0: _ellipsoid(o, d, t0, size)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return lambda o, d, t0: _box(o, d, t0, size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return lambda o, d, t0: _cylinder(o, d, t0, size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return lambda o, d, t0: _capsule(o, d, t0, size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        triangles = _mesh(model, index)
        return lambda o, d, t0: _triangles(o, d, t0, triangles)
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        terrain, base, base_centre = _hfield(model, index)
        return lambda o, d, t0: _nearest(_triangles(o, d, t0, terrain), _box(o - base_centre, d, t0, base))
    raise NotImplementedError(f"geom {index}: no reference for {kind.name}")


def _first(roots: list[Float64], t_min: Float64) -> Float64:
    """The smallest of the roots that is beyond t_min; inf (also for NaN) if there is none."""
    t = np.full(len(t_min), np.inf)
    for root in roots:
        t = np.where((root > t_min) & (root < t), root, t)
    return t


def _nearest(a: tuple[Float64, Float64], b: tuple[Float64, Float64]) -> tuple[Float64, Float64]:
    nearer = a[0] <= b[0]
    return np.where(nearer, a[0], b[0]), np.where(nearer[:, None], a[1], b[1])


def _at(o: Float64, d: Float64, t: Float64) -> Float64:
    return o + np.where(np.isfinite(t), t, 0.0)[:, None] * d


def _quadratic(a: Float64, half_b: Float64, c: Float64) -> tuple[Float64, Float64]:
    """Both roots of a t^2 + 2 half_b t + c, NaN without one."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(half_b * half_b - a * c)
        return (-half_b - root) / a, (-half_b + root) / a


def _plane(o: Float64, d: Float64, t_min: Float64, size: Float64) -> tuple[Float64, Float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(d[:, 2] < 0, -o[:, 2] / d[:, 2], np.inf)
    t = _first([t], t_min)
    p = _at(o, d, t)
    inside = ((size[0] <= 0) | (np.abs(p[:, 0]) <= size[0])) & ((size[1] <= 0) | (np.abs(p[:, 1]) <= size[1]))
    return np.where(inside, t, np.inf), np.broadcast_to([0.0, 0.0, 1.0], d.shape)


def _ellipsoid(o: Float64, d: Float64, t_min: Float64, semi_axes: Float64) -> tuple[Float64, Float64]:
    os, ds = o / semi_axes, d / semi_axes
    # Closest approach first, then half the chord: b^2 - a c of a far, small shape would cancel.
    a = np.einsum("ij,ij->i", ds, ds)
    middle = -np.einsum("ij,ij->i", os, ds) / a
    closest = os + middle[:, None] * ds
    with np.errstate(invalid="ignore"):
        half = np.sqrt((1.0 - np.einsum("ij,ij->i", closest, closest)) / a)
    t = _first([middle - half, middle + half], t_min)
    return t, _at(o, d, t) / semi_axes**2


def _box(o: Float64, d: Float64, t_min: Float64, half: Float64) -> tuple[Float64, Float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (-half - o) / d, (half - o) / d
    outside = (np.abs(d) < _PARALLEL) & (np.abs(o) > half)
    parallel = np.abs(d) < _PARALLEL
    entry = np.where(parallel, -np.inf, np.fmin(one, two))
    leave = np.where(parallel, np.inf, np.fmax(one, two))
    t_in, t_out = entry.max(axis=1), leave.min(axis=1)
    met = (t_in <= t_out) & ~outside.any(axis=1)
    t = _first([np.where(met, t_in, np.inf), np.where(met, t_out, np.inf)], t_min)
    axis = np.where(t == t_in, entry.argmax(axis=1), leave.argmin(axis=1))
    normal = np.zeros_like(d)
    rows = np.arange(len(d))
    normal[rows, axis] = np.sign(_at(o, d, t)[rows, axis])
    return t, normal


def _cylinder(o: Float64, d: Float64, t_min: Float64, radius: float, half: float) -> tuple[Float64, Float64]:
    side_a, side_b = _round_side(o, d, radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (-half - o[:, 2]) / d[:, 2], (half - o[:, 2]) / d[:, 2]
    on_side = [np.where(np.abs(o[:, 2] + t * d[:, 2]) <= half, t, np.inf) for t in (side_a, side_b)]
    on_caps = []
    for t in (low, high):
        p = _at(o, d, t)
        on_caps.append(np.where(p[:, 0] ** 2 + p[:, 1] ** 2 <= radius**2, t, np.inf))
    t_side, t_cap = _first(on_side, t_min), _first(on_caps, t_min)
    t = np.minimum(t_side, t_cap)
    normal = _at(o, d, t) * [1.0, 1.0, 0.0]
    normal[t_cap < t_side] = [0.0, 0.0, 1.0]
    return t, normal


def _capsule(o: Float64, d: Float64, t_min: Float64, radius: float, half: float) -> tuple[Float64, Float64]:
    side = [np.where(np.abs(o[:, 2] + t * d[:, 2]) <= half, t, np.inf) for t in _round_side(o, d, radius)]
    t = _first(side, t_min)
    normal = _at(o, d, t) * [1.0, 1.0, 0.0]
    for end in (-half, half):
        to_end = o - [0.0, 0.0, end]
        b = np.einsum("ij,ij->i", to_end, d)
        closest = to_end - b[:, None] * d
        with np.errstate(invalid="ignore"):
            chord = np.sqrt(radius**2 - np.einsum("ij,ij->i", closest, closest))
        roots = [np.where((o[:, 2] + r * d[:, 2]) * np.sign(end) >= half, r, np.inf) for r in (-b - chord, -b + chord)]
        t_end = _first(roots, t_min)
        normal = np.where((t_end < t)[:, None], _at(to_end, d, t_end), normal)
        t = np.minimum(t, t_end)
    return t, normal


def _round_side(o: Float64, d: Float64, radius: float) -> tuple[Float64, Float64]:
    a = d[:, 0] ** 2 + d[:, 1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = -(o[:, 0] * d[:, 0] + o[:, 1] * d[:, 1]) / a
        beside = o[:, :2] + middle[:, None] * d[:, :2]
        half = np.sqrt((radius**2 - np.einsum("ij,ij->i", beside, beside)) / a)
    return middle - half, middle + half


def _triangles(o: Float64, d: Float64, t_min: Float64, corners: Float64) -> tuple[Float64, Float64]:
    """`corners` (triangles, 3, 3) in the frame of the geom."""
    t = np.full(len(d), np.inf)
    normal = np.zeros_like(d)
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    face = np.cross(edge1, edge2)
    for i in range(len(d)):  # by ray: the triangles are many and the rays that pass near a mesh are few
        pvec = np.cross(d[i], edge2)
        det = np.einsum("ij,ij->i", edge1, pvec)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / det
            tvec = o[i] - corners[:, 0]
            u = np.einsum("ij,ij->i", tvec, pvec) * inverse
            qvec = np.cross(tvec, edge1)
            v = (qvec @ d[i]) * inverse
            along = np.einsum("ij,ij->i", edge2, qvec) * inverse
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (along > t_min[i]) & np.isfinite(along)
        if met.any():
            best = int(np.argmin(np.where(met, along, np.inf)))
            t[i], normal[i] = along[best], face[best]
    return t, normal


def _mesh(model: mujoco.MjModel, index: int) -> Float64:
    mesh = int(model.geom_dataid[index])
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    start, vertices = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = np.asarray(model.mesh_vert[start : start + vertices], np.float64)
    return points[model.mesh_face[first : first + count]]


def _hfield(model: mujoco.MjModel, index: int) -> tuple[Float64, Float64, Float64]:
    """Triangles of terrain and sides; half edges and centre of the base box."""
    field = int(model.geom_dataid[index])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, top, base = model.hfield_size[field]
    start = model.hfield_adr[field]
    height = np.asarray(model.hfield_data[start : start + rows * columns], np.float64).reshape(rows, columns) * top
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    p = np.stack([x, y, height], axis=-1)
    floor = p * [1.0, 1.0, 0.0]
    a, b, c, e = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]  # the diagonal runs from a to c
    triangles = [np.stack([a, b, c], axis=-2).reshape(-1, 3, 3), np.stack([a, c, e], axis=-2).reshape(-1, 3, 3)]
    for upper, lower in ((p[0], floor[0]), (p[-1], floor[-1]), (p[:, 0], floor[:, 0]), (p[:, -1], floor[:, -1])):
        triangles.append(np.stack([upper[:-1], upper[1:], lower[1:]], axis=-2))
        triangles.append(np.stack([upper[:-1], lower[1:], lower[:-1]], axis=-2))
    return np.concatenate(triangles), np.array([half_x, half_y, 0.5 * base]), np.array([0.0, 0.0, -0.5 * base])
