"""Errors of a frame against mj_ray in double precision, pixel by pixel.

A pixel is "away from silhouettes" if mj_ray hits the same geom in all pixels of its 3 x 3 neighbourhood. Depth, range,
normals and radial velocity are compared at such pixels, out to 60 m; ids are compared there and at all pixels. The
exact radial velocity is that of the point hit, in double precision:

    (v + cross(w, p - b) - v_C) . d    p: point hit; v, w: velocity and angular velocity of its body at the origin b;
                                       v_C: velocity of the camera; d: direction of the ray
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import mujoco
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.mujoco_rays import cast
from hil.apps.bench_suite.sensors.raster_cases import Case, View
from sim.frame.camera_model import CameraModel
from sim.frame.mujoco_backend import WorldPose

Float64 = NDArray[np.float64]
COMPARED_M = 60.0  # errors other than of ids are compared up to this range
_FAR_M = 10_000.0  # the raster's far plane
_MAX_DRAWS = 8  # of random pixels per view, because a view may have too few pixels away from silhouettes


@dataclass
class Errors:
    """Errors of all compared pixels, one array per channel."""

    depth_m: Float64 = field(default_factory=lambda: np.zeros(0))
    range_m: Float64 = field(default_factory=lambda: np.zeros(0))
    normal_deg: Float64 = field(default_factory=lambda: np.zeros(0))  # without meshes and height fields
    velocity_mps: Float64 = field(default_factory=lambda: np.zeros(0))
    id_agrees: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))  # away from silhouettes
    id_agrees_anywhere: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    @staticmethod
    def merged(parts: Sequence[Errors]) -> Errors:
        """Return the errors of all parts joined."""
        return Errors(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Errors)))


@dataclass(frozen=True)
class Truth:
    """Exact values at random pixels of one view, from mj_ray and the twists of the bodies.

    The first `drawn` pixels are a sample of the whole picture; the others were added because too few were away from
    silhouettes.
    """

    drawn: int
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    geom: NDArray[np.int32]
    instance: NDArray[np.int32]
    away: NDArray[np.bool_]  # from silhouettes
    depth_m: Float64
    range_m: Float64
    normal_C: Float64
    velocity_mps: Float64


def truth(case: Case, view: View, posed: WorldPose, camera: CameraModel, pixels: int, seed: int) -> Truth:
    """Return the truth at random pixels of a view, border excluded, with at least `pixels` away from silhouettes.

    Fewer are returned if `_MAX_DRAWS` draws do not find enough.
    """
    data = posed.at(view.t_ns)
    model = posed.model
    rng = np.random.Generator(np.random.Philox(seed))
    directions_C = camera.rays()
    R_WC = np.reshape(view.pose.R_WC, (3, 3))
    p_W = np.array(view.pose.p_WC)
    draws: list[tuple[NDArray, ...]] = []
    missing = pixels
    while missing > 0 and len(draws) < _MAX_DRAWS:
        rows, columns = rng.integers(1, camera.height - 1, pixels), rng.integers(1, camera.width - 1, pixels)
        if draws:  # more than are missing, because some of these will be on silhouettes too
            n = min(pixels, 2 * missing)
            rows, columns = rows[:n], columns[:n]
        around = np.zeros((9, len(rows)), np.int32)
        for k, (dy, dx) in enumerate((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)):
            d_C = directions_C[rows + dy, columns + dx]
            geom, distance, normal = cast(model, data, p_W, d_C @ R_WC.T)
            around[k] = geom = np.where(distance * d_C[:, 2] <= _FAR_M, geom, -1)
            if k == 4:
                middle = (geom, np.where(geom >= 0, distance, np.inf), normal, d_C)
        away = (around == around[4]).all(axis=0)
        draws.append((rows, columns, away, *middle))
        missing -= int(away.sum())
    rows, columns, away, geom, range_m, normal_W, d_C = (np.concatenate(parts) for parts in zip(*draws, strict=True))
    normal_C = normal_W @ R_WC
    normal_C *= -np.where(np.einsum("ij,ij->i", normal_C, d_C) > 0, 1.0, -1.0)[:, None]
    body = model.geom_bodyid[geom]
    d_W = d_C @ R_WC.T
    hit_W = np.where(geom[:, None] >= 0, np.where(np.isfinite(range_m), range_m, 0.0)[:, None] * d_W + p_W, 0.0)
    v_W = posed.v_WB_W[body] + np.cross(posed.w_WB_W[body], hit_W - data.xpos[body]) - np.array(view.pose.v_WC_W)
    instance = np.where(geom >= 0, case.world.geom_instance[geom].astype(np.int32), 0)
    return Truth(
        len(draws[0][0]),
        rows,
        columns,
        geom,
        instance,
        away,
        range_m * d_C[:, 2],
        range_m,
        normal_C,
        np.einsum("ij,ij->i", v_W, d_W),
    )


def errors(frame: Mapping[str, NDArray], true: Truth, model: mujoco.MjModel) -> Errors:
    """Return the errors of depth, range, instance, geom, normal and radial_velocity, as far as the frame has them."""
    at = (true.rows, true.columns)
    result = Errors()
    if "instance" in frame or "geom" in frame:
        if "instance" in frame:
            same = frame["instance"][at].astype(np.int32) == true.instance
        else:
            same = frame["geom"][at] == true.geom
        result.id_agrees, result.id_agrees_anywhere = same[true.away], same[: true.drawn]
    # A pixel that shows another geom counts as a wrong id only.
    same_geom = frame["geom"][at] == true.geom if "geom" in frame else np.ones(len(true.geom), bool)
    compared = true.away & (true.geom >= 0) & (true.range_m <= COMPARED_M) & same_geom
    if "depth" in frame:
        result.depth_m = _difference(frame["depth"][at][compared], true.depth_m[compared])
    if "range" in frame:
        result.range_m = _difference(frame["range"][at][compared], true.range_m[compared])
    if "radial_velocity" in frame:
        result.velocity_mps = _difference(frame["radial_velocity"][at][compared], true.velocity_mps[compared])
    if "normal" in frame:
        measured = frame["normal"][at][compared].astype(np.float64)
        # atan2 of sine and cosine, because arccos is inaccurate near 0.
        sine = np.linalg.norm(np.cross(measured, true.normal_C[compared]), axis=1)
        angle = np.rad2deg(np.arctan2(sine, np.einsum("ij,ij->i", measured, true.normal_C[compared])))
        angle = np.where(np.isfinite(angle), angle, 180.0)
        kinds = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
        of_triangles = np.isin(model.geom_type[true.geom[compared]], [int(kind) for kind in kinds])
        result.normal_deg = angle[~of_triangles]
    return result


def _difference(measured: NDArray, exact: Float64) -> Float64:
    """Return absolute differences; non-finite ones count as 1000."""
    difference = np.abs(measured.astype(np.float64) - exact)
    return np.where(np.isfinite(difference), difference, 1000.0)
