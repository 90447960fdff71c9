"""Exact paths by one mirror, for tests: images of given planes, visibility by mj_ray, and the plain radar equation.

Slow, and independent of what it judges: points P are sampled on the surface itself and not by rays, mirrors are given
and not found, visibility is MuJoCo's, and reflection is written down again in complex numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.radar.antenna import Antenna
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.scene.scene_map import Surface

Float64 = NDArray[np.float64]
SLOPE = 0.1  # rms slope of facets
_TOUCH_M = 1e-4


@dataclass(frozen=True)
class Patch:
    """Points of a surface with outward normals and areas."""

    point_W: Float64
    normal_W: Float64
    area_m2: Float64
    surface: Surface


@dataclass(frozen=True)
class Plane:
    """Mirror: a geom with a point and the outward normal of one face."""

    geom: int
    point_W: Float64
    normal_W: Float64
    surface: Surface


@dataclass(frozen=True)
class Sum:
    """Sum of the paths of one kind."""

    power: float  # of A^2 [counts^2]
    range_m: float
    speed_mps: float


def sphere(centre: tuple[float, float, float], radius_m: float, count: int, surface: Surface) -> Patch:
    """Return even points of a sphere (Fibonacci's lattice)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z * z)
    normal = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    area = np.full(count, 4.0 * np.pi * radius_m**2 / count)
    return Patch(np.array(centre) + radius_m * normal, normal, area, surface)


def face(
    middle: tuple[float, float, float],
    across: tuple[float, float, float],
    up: tuple[float, float, float],
    counts: tuple[int, int],
    surface: Surface,
) -> Patch:
    """Return even points of a parallelogram with half edges `across` and `up`; its normal is across x up."""
    a, b = (((np.arange(n) + 0.5) / n * 2.0 - 1.0) for n in counts)
    s, t = (x.reshape(-1, 1) for x in np.meshgrid(a, b, indexing="ij"))
    point = np.array(middle) + s * np.array(across) + t * np.array(up)
    normal = np.cross(across, up)
    area = 4.0 * float(np.linalg.norm(normal)) / point.shape[0]
    normal = normal / np.linalg.norm(normal)
    return Patch(point, np.tile(normal, (len(point), 1)), np.full(len(point), area), surface)


def gamma2(surface: Surface, carrier_hz: float, cosine: Float64 | float) -> Any:
    """Return |Gamma|^2, the mean of both polarisations."""
    eps = surface.relative_permittivity - 1j * surface.conductivity_s_per_m / (
        2.0 * np.pi * carrier_hz * 8.8541878128e-12
    )
    w = np.sqrt(eps - 1.0 + np.square(cosine))
    across = np.abs((cosine - w) / (cosine + w)) ** 2
    along = np.abs((eps * cosine - w) / (eps * cosine + w)) ** 2
    return 0.5 * (across + along)


def bistatic(surface: Surface, carrier_hz: float, to_tx: Float64, to_rx: Float64, normal: Float64) -> Float64:
    """Return sigma0 for unit vectors from the surface (n, 3)."""
    c_i, c_s = np.sum(to_tx * normal, axis=1), np.sum(to_rx * normal, axis=1)
    h = to_tx + to_rx
    h = h / np.linalg.norm(h, axis=1, keepdims=True)
    cos_beta, cos_local = np.sum(h * normal, axis=1), np.sum(h * to_tx, axis=1)
    k_h = 2.0 * np.pi * carrier_hz / SPEED_OF_LIGHT_MPS * surface.roughness_m
    coherent = np.exp(-((k_h * (c_i + c_s)) ** 2))
    tan2 = 1.0 / cos_beta**2 - 1.0
    lobe = np.exp(-tan2 / (2.0 * SLOPE**2)) / (2.0 * SLOPE**2 * cos_beta**4)
    rough = np.sqrt(gamma2(surface, carrier_hz, c_i) * gamma2(surface, carrier_hz, c_s))
    return np.asarray(
        coherent * gamma2(surface, carrier_hz, cos_local) * lobe + 4.0 * (1.0 - coherent) * rough * c_i * c_s
    )


@dataclass
class PathTracer:
    """Paths from a radar at `p_W` that looks along +x of W, y_R and z_R along those of W."""

    model: mujoco.MjModel
    antenna: Antenna
    scale: float  # A R^2 per root of the cross-section, on the axis
    carrier_hz: float
    p_W: Float64
    v_W: Float64

    def __post_init__(self) -> None:
        self._data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self._data)

    def _first(self, origin: Float64, way: Float64) -> tuple[float, int]:
        geom = np.array([-1], np.int32)
        reached = mujoco.mj_ray(self.model, self._data, origin, way, None, 1, -1, geom)
        return (float(reached) if reached >= 0.0 else np.inf), int(geom[0])

    def sums(self, patch: Patch, plane: Plane, v_P_W: Float64 | None = None) -> dict[str, Sum]:
        """Return the sums of "both ways", "out" and "back" of a patch by a plane."""
        o, v_P = self.p_W, np.zeros(3) if v_P_W is None else v_P_W
        height = float(np.dot(o - plane.point_W, plane.normal_W))
        image = o - 2.0 * height * plane.normal_W
        rows: list[tuple[float, ...]] = []
        for point, normal, area in zip(patch.point_W, patch.normal_W, patch.area_m2, strict=True):
            beyond = point - image
            image_m = float(np.linalg.norm(beyond))
            bent = beyond / image_m
            c_in, drop = -float(np.dot(bent, normal)), float(np.dot(bent, plane.normal_W))
            if c_in <= 0.0 or drop <= 0.0 or np.dot(point - plane.point_W, plane.normal_W) <= _TOUCH_M:
                continue
            b = image + height / drop * bent
            first_m = float(np.linalg.norm(b - o))
            way = (b - o) / first_m
            reached, geom = self._first(o, way)
            if geom != plane.geom or abs(reached - first_m) > _TOUCH_M:
                continue
            second_m = float(np.linalg.norm(point - b))
            if self._first(b + 1e-6 * plane.normal_W, bent)[0] < second_m - _TOUCH_M:
                continue
            k_h = 4.0 * np.pi * self.carrier_hz / SPEED_OF_LIGHT_MPS * plane.surface.roughness_m
            g2 = float(gamma2(plane.surface, self.carrier_hz, drop) * np.exp(-((k_h * drop) ** 2)))
            image_mps = float(np.dot(v_P, bent) - np.dot(self.v_W, way))
            tx, rx = (float(p.share(way[None])[0]) for p in (self.antenna.tx, self.antenna.rx))
            to_image, n = -bent[None], normal[None]
            s0 = float(bistatic(patch.surface, self.carrier_hz, to_image, to_image, n)[0])
            both = self.scale**2 * g2 * g2 * tx * rx * s0 * area / image_m**4
            direct = point - o
            direct_m = float(np.linalg.norm(direct))
            d = direct / direct_m
            out = back = 0.0
            if -np.dot(d, normal) > 0.0 and d[0] > 0.0 and self._first(o, d)[0] >= direct_m - _TOUCH_M:
                s0 = float(bistatic(patch.surface, self.carrier_hz, to_image, -d[None], n)[0])
                common = self.scale**2 * g2 * s0 * area / (image_m * direct_m) ** 2
                tx_d, rx_d = (float(p.share(d[None])[0]) for p in (self.antenna.tx, self.antenna.rx))
                out, back = common * tx * rx_d, common * tx_d * rx
            mean_mps = 0.5 * (image_mps + float(np.dot(v_P, d) - np.dot(self.v_W, d)))
            rows.append((both, out, back, image_m, image_mps, 0.5 * (image_m + direct_m), mean_mps))
        r = np.array(rows).reshape(-1, 7).T
        return {
            "both ways": _sum(r[0], r[3], r[4]),
            "out": _sum(r[1], r[5], r[6]),
            "back": _sum(r[2], r[5], r[6]),
        }


def _sum(power: Float64, range_m: Float64, speed_mps: Float64) -> Sum:
    total = float(power.sum())
    if total == 0.0:
        return Sum(0.0, np.nan, np.nan)
    return Sum(total, float((power * range_m).sum()) / total, float((power * speed_mps).sum()) / total)
