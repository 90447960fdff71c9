"""Echoes by one mirror: over the ground, over walls, and by two surfaces that face each other. Their ghosts.

Rays leave the radar at O on a grid of equal solid angles dOmega (ray_grid.py). A ray that meets a flat, static surface
at B goes on as from the mirror's image of O, and may meet a surface at P. With R' = |OB| + |BP|, R = |OP|, d_B and d_P
the directions to B and P, c' the cosine of incidence at P, and g^2 the mirror's power (bistatic.py):

    path       range          directions out, in   amplitude, in W as in scatterers.py
    both ways  R'             d_B, d_B             g^2 sqrt(G_t(d_B) G_r(d_B) sigma0 dOmega / c') / R'
    out        (R' + R) / 2   d_B, d_P             g sqrt(G_t(d_B) G_r(d_P) sigma0 dOmega / c') / R
    back       (R' + R) / 2   d_P, d_B             g sqrt(G_t(d_P) G_r(d_B) sigma0 dOmega / c') / R

The last two need P free of obstacles from O, too. dA = R'^2 dOmega / c', so R' cancels. sigma0 is the bistatic one. A
second wall in the place of P gives the double bounce between two surfaces: its Kirchhoff lobe is the mirror that sends
the wave back. Range is linear in time: speeds are those of P and of the radar along both ways; mirrors are at rest.
Corner reflectors are found in the image of each mirror plane and return what comes from there (corner_echoes.py).

Rays (spacing three times that of the settings) find mirrors; the cells of mirrors and their neighbours are traced at
the spacing; the images of instances of few rays, at a third of it. Left out, with bounds on what they can hold:

* mirrors whose g^2 times the antenna's gain relative to the axis is below `floor_db`;
* curved mirrors: spheres, capsules, ellipsoids, cylinders, and facets of meshes without a neighbour in their plane;
* mirrors that move, and paths by more than one mirror and one other surface;
* mean ranges beyond the mask's range or the chirp's unambiguous one.

Vectors of many rays are (3, n), one row for each axis: numpy runs over rows of n, not of 3.

Phases: a ghost's points are not the pixels of its object, so the object and its ghosts do not interfere with certain
phases; powers add. The phase of Gamma is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_pow
from signals.rotation import applied, applied_back, dot
from signals.samples import Vec3
from signals.units import RAD_PER_DEG
from sim._kernels import MirrorSearch, Vicinity, mirror_in_plane
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.radar.antenna import Antenna
from sim.radar.bistatic import BistaticReflection
from sim.radar.bounces import Bounces
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.radar.mirrored_corners import MirroredCorners, MirrorPlane
from sim.radar.ray_grid import CellIndex, Cells, children, directions, forward_cells
from sim.radar.receiver import Receiver
from sim.radar.reflection import Reflection
from sim.radar.rotor_blades import RotorBlades
from sim.radar.scatterers import PATTERN_FLOOR, amplitude_scale

Float64 = NDArray[np.float64]
Vectors = NDArray[np.float64]  # (3, n)
Ids = NDArray[np.int64]

BOTH, OUT, BACK = 1, 2, 3  # kinds of paths
KINDS = ("direct", "both ways", "out", "back")

_FLAT_SHAPES = (0, 6)  # MuJoCo's plane and box
_FACETED_SHAPES = (1, 7)  # height field and mesh: flat where neighbours are in one plane
_COARSE = 3  # coarse spacing, in spacings
_GROUPS = 2  # of rays by their reach
_FEW_RAYS = 64  # an instance with fewer rays is traced at a third of the spacing
_THIN_M, _WIDE_M = 0.05, 0.5  # half the thickness and width of a mesh that is one flat slab, such as a path
_LIFT_M = 5e-4  # of reflected rays off their mirror
_TOUCH_M = 5e-3  # ranges that agree
_LEAST_COSINE = 1e-3


@dataclass(frozen=True, eq=False)
class Ghosts:
    """Ghost echoes of a frame with their paths: what they are echoes of, and by which mirror."""

    echoes: Echoes  # with `out_direction_R`
    kind: NDArray[np.uint8]  # BOTH, OUT or BACK
    instance: Ids  # of the true object
    mirror: Ids  # instance of the mirror

    @property
    def count(self) -> int:
        return len(self.kind)


@dataclass(frozen=True, eq=False)
class _Hits:
    """Surfaces that rays meet; without a hit geom is -1."""

    range_m: Float64
    geom: Ids
    normal: Vectors  # against the ray
    speed_mps: Float64  # of the surface along the ray

    def of(self, some: Ids) -> _Hits:
        return _Hits(self.range_m[some], self.geom[some], self.normal[:, some], self.speed_mps[some])


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays by mirrors that meet a surface."""

    cell: Cells
    solid_sr: Float64  # dOmega
    way_W: Vectors  # d_B
    first_m: Float64  # |OB|
    mirror_geom: Ids
    power: Float64  # g^2
    bent_W: Vectors  # direction from B to P
    found: _Hits  # from B

    def of(self, some: Ids) -> _Rays:
        return _Rays(
            self.cell[some], self.solid_sr[some], self.way_W[:, some], self.first_m[some], self.mirror_geom[some],
            self.power[some], self.bent_W[:, some], self.found.of(some),
        )  # fmt: skip


class GhostEchoes:
    """Finds the ghosts of one radar's frames. Not thread-safe."""

    def __init__(
        self,
        geometry: FrameGeometry,
        chirp: Chirp,
        antenna: Antenna,
        receiver: Receiver,
        mask: Mask,
        settings: Bounces,
        seen: Chirp | None = None,
    ) -> None:
        """`seen`: the frame of one transmitter, for the speeds of rotor blades; None: `chirp`."""
        world = geometry.world
        self._geometry, self._antenna, self._mask = geometry, antenna, mask
        self._chirp = chirp if seen is None else seen
        self._limit_m = chirp.max_range_m if mask.max_range_m is None else min(mask.max_range_m, chirp.max_range_m)
        self._class_kept = mask.kept_classes(world.class_names)
        self._scale = amplitude_scale(chirp, antenna, receiver)
        self._reflection = BistaticReflection(world.surfaces, chirp.center_frequency_hz, Reflection())
        self._blades = RotorBlades(world)
        self._spacing_rad = settings.spacing_deg * RAD_PER_DEG
        self._floor = det_pow(10.0, 0.1 * settings.floor_db)
        self._surface = world.geom_surface.astype(np.int64)
        self._instance = world.geom_instance.astype(np.int64)
        self._class = world.geom_class
        shape = world.model.geom_type
        half_m = np.sort(world.model.geom_aabb[:, 3:], axis=1)
        thin = (half_m[:, 0] <= _THIN_M) & (half_m[:, 1] >= _WIDE_M)
        flat = np.isin(shape, _FLAT_SHAPES) | (np.isin(shape, _FACETED_SHAPES) & thin)
        is_mirror = (flat | np.isin(shape, _FACETED_SHAPES)) & (world.geom_actor < 0)
        # By geom, with one more element for -1: no hit.
        self._flat_at, self._mirror_at = np.append(flat, False), np.append(is_mirror, False)
        self._echoes_at = np.append(self._surface > 0, False)
        coarse = forward_cells(self._spacing_rad * _COARSE)
        share = self._share(directions(coarse, self._spacing_rad * _COARSE))
        coarse, self._coarse_share = coarse[share >= self._floor], share[share >= self._floor]
        self._coarse_R = _columns(directions(coarse, self._spacing_rad * _COARSE))
        self._fine = children(coarse)
        self._search = MirrorSearch(
            self._reflection.table,
            surface=self._surface,
            mirror=is_mirror.astype(np.uint8),
            flat=flat.astype(np.uint8),
            around=CellIndex(coarse).neighbours(coarse),
            fine_R=_columns(directions(self._fine, self._spacing_rad)),
            floor=self._floor,
        )
        self._corners = MirroredCorners(world.map.corners, antenna, mask, self._scale, chirp.wavelength_m)
        self.rays = 0  # cast in the last frame

    def find(self, pose: CameraPose) -> Ghosts:
        """Return the ghosts seen from a pose at the geometry's time."""
        self.rays = 0
        p_W = pose.p_WC
        self._geometry.pose_within(Vicinity(p_W, p_W, self._limit_m))
        axes = _axes_of(pose)
        fine, ways_W, primary, power, assumed = self._mirrors(p_W, axes)
        rays = self._bent(p_W, fine, ways_W, primary, power, self._spacing_rad, assumed)
        planes = _planes(primary, ways_W) if len(self._corners) and len(fine) else []
        few = self._of_few(rays)
        if few is not None:
            split, kept = few
            rays = _both(rays.of(kept), self._finer(p_W, axes, split))
        ghosts = self._ghosts(pose, axes, rays)
        return _joined([ghosts, self._of_corners(pose, planes)]) if planes else ghosts

    def _share(self, direction_R: Float64) -> Float64:
        """Return the greater gain of a transmitter or receiver relative to the axis; 0 outside the mask's angles."""
        share = np.maximum(*self._shares(direction_R))
        return np.where(self._mask.in_window(direction_R), share, 0.0)

    def _shares(self, direction_R: Float64) -> tuple[Float64, Float64]:
        """Return the gains of transmitter and receiver relative to the axis."""
        tx = self._antenna.tx.share(direction_R)
        return tx, tx if self._antenna.rx == self._antenna.tx else self._antenna.rx.share(direction_R)

    def _cast(self, origins_W: Vectors, ways_W: Vectors, limit_m: float) -> _Hits:
        """Return what rays meet; `origins_W`: (3, n), or (3, 1) for all."""
        n = ways_W.shape[1]
        self.rays += n
        range_m, geom, normal, speed = np.empty(n), np.empty(n, np.int32), np.empty((n, 3)), np.empty(n)
        if n:
            origins, ways = np.ascontiguousarray(origins_W.T), np.ascontiguousarray(ways_W.T)
            self._geometry.caster.cast(origins, ways, 0.0, limit_m, range_m, geom, normal, speed)
        return _Hits(range_m, geom.astype(np.int64), _columns(normal), speed)

    def _mirror_power(self, ways_W: Vectors, share: Float64, hits: _Hits) -> Float64:
        """Return g^2; 0 for what is no mirror, or one below the floor. `share`: the antenna's gain."""
        power = np.empty(len(hits.geom))
        self._search.powers(hits.geom, hits.normal, ways_W, share, power)
        return power

    def _mirrors(self, p_W: Vec3, axes: Float64) -> tuple[Cells, Vectors, _Hits, Float64, NDArray[np.bool_]]:
        """Return the cells that show mirrors, their rays, what these meet, and g^2.

        Within a mirror, where all neighbours show the same flat geom, rays are assumed to meet its plane: the last
        array is True there. `_bent` casts those that count, which are few: most rays by the ground end in the sky.
        """
        coarse_W = _turned(self._coarse_R, axes)
        coarse = self._cast(_at(p_W), coarse_W, self._limit_m)
        power = self._mirror_power(coarse_W, self._coarse_share, coarse)
        near, within = np.empty(len(power), np.int64), np.empty(len(power), np.uint8)
        near = near[: self._search.near(coarse.geom, coarse.normal, coarse_W, power, near, within)]

        n = 9 * len(near)
        ways_W, normal = np.empty((3, n)), np.empty((3, n))
        range_m, geom, assumed = np.empty(n), np.empty(n, np.int64), np.empty(n, np.bool_)
        self._search.fine(
            coarse.geom, coarse.normal, coarse_W, coarse.range_m, near, within, axes,
            ways_W, range_m, geom, normal, assumed.view(np.uint8),
        )  # fmt: skip
        checked = np.flatnonzero(~assumed)
        cast = self._cast(_at(p_W), ways_W[:, checked], self._limit_m)
        range_m[checked], geom[checked], normal[:, checked] = cast.range_m, cast.geom, cast.normal
        hits = _Hits(range_m, geom, normal, range_m)  # mirrors are at rest: their speeds are not asked for
        cells = self._fine[(9 * near[:, None] + _NINE).reshape(-1)]
        power = self._plane_power(cells, ways_W, np.repeat(self._coarse_share[near], 9), hits)
        some = np.flatnonzero(power > 0.0)
        return cells[some], ways_W[:, some], hits.of(some), power[some], assumed[some]

    def _plane_power(self, cells: Cells, ways_W: Vectors, share: Float64, hits: _Hits) -> Float64:
        """Return g^2 of what is plane, and 0 for what is no mirror.

        A facet of a mesh is plane where two or more of the eight neighbours are in its plane.
        """
        power = self._mirror_power(ways_W, share, hits)
        faceted = np.flatnonzero((power > 0.0) & ~self._flat_at[hits.geom])
        if len(faceted):
            plane = np.empty(len(faceted), np.bool_)
            mirror_in_plane(cells, hits.normal, ways_W, hits.range_m, faceted, plane.view(np.uint8))
            power[faceted[~plane]] = 0.0
        return power

    def _bent(
        self,
        p_W: Vec3,
        cells: Cells,
        way_W: Vectors,
        hits: _Hits,
        power: Float64,
        spacing_rad: float,
        assumed: NDArray[np.bool_] | None = None,
    ) -> _Rays:
        """Return the rays by the mirrors `hits` that meet a surface with an echo; `assumed`: as from `_mirrors`."""
        n = hits.normal
        bent = way_W - 2.0 * dot(way_W, n) * n
        origin = _at(p_W) + hits.range_m * way_W + _LIFT_M * n
        found = self._cast_within(origin, bent, self._reach_m(hits.range_m, dot(way_W, bent)))
        keep = self._echoes_at[found.geom]
        if assumed is not None:
            check = np.flatnonzero(keep & assumed)
            seen = self._cast(_at(p_W), way_W[:, check], self._limit_m)
            wrong = (seen.geom != hits.geom[check]) | ~(np.abs(seen.range_m - hits.range_m[check]) < _TOUCH_M)
            keep[check[wrong]] = False
        kept = np.flatnonzero(keep)
        return _Rays(
            cells[kept], np.full(len(kept), spacing_rad * spacing_rad), way_W[:, kept], hits.range_m[kept],
            hits.geom[kept], power[kept], bent[:, kept], found.of(kept),
        )  # fmt: skip

    def _reach_m(self, first_m: Float64, cosine: Float64) -> Float64:
        """Return |BP| beyond which no path is within the limit L: (|OB| + |BP| + |OP|) / 2 <= L.

        By the law of cosines |BP| <= 2 L (L - |OB|) / (2 L - |OB| (1 - cos)), cos between d_B and the bent ray.
        """
        limit_m = self._limit_m
        return np.asarray(2.0 * limit_m * (limit_m - first_m) / (2.0 * limit_m - first_m * (1.0 - cosine)))

    def _cast_within(self, origins_W: Vectors, ways_W: Vectors, reach_m: Float64) -> _Hits:
        """Return what rays meet within the reach of each, in groups of similar reaches."""
        n = len(reach_m)
        hits = _Hits(np.full(n, np.inf), np.full(n, -1), np.zeros((3, n)), np.zeros(n))
        group = np.minimum((reach_m * (_GROUPS / self._limit_m)).astype(np.int64), _GROUPS - 1)
        for k in range(_GROUPS):
            some = np.flatnonzero(group == k)
            if not len(some):
                continue
            cast = self._cast(origins_W[:, some], ways_W[:, some], self._limit_m * ((k + 1) / _GROUPS))
            hits.range_m[some], hits.geom[some], hits.speed_mps[some] = cast.range_m, cast.geom, cast.speed_mps
            hits.normal[:, some] = cast.normal
        hits.geom[hits.range_m > reach_m] = -1
        return hits

    def _of_few(self, rays: _Rays) -> tuple[Cells, Ids] | None:
        """Return the cells to be divided, and which rays remain; None: no instance has few rays."""
        instance = self._instance[rays.found.geom]
        count = np.bincount(instance)
        few = (count[instance] < _FEW_RAYS) & (instance > 0)
        if not few.any():
            return None
        wanted = rays.cell[few]
        around = (wanted[:, None, :] + _AROUND[None, :, :]).reshape(-1, 2)
        first = np.minimum(around.min(axis=0), rays.cell.min(axis=0))
        marked = np.zeros(np.maximum(around.max(axis=0), rays.cell.max(axis=0)) - first + 1, np.bool_)
        marked[around[:, 0] - first[0], around[:, 1] - first[1]] = True
        split = np.argwhere(marked) + first
        return split, np.flatnonzero(~marked[rays.cell[:, 0] - first[0], rays.cell[:, 1] - first[1]])

    def _finer(self, p_W: Vec3, axes: Float64, split: Cells) -> _Rays:
        """Return the rays of the divided cells."""
        spacing_rad = self._spacing_rad / 3.0
        cells = children(split)
        ways = directions(cells, spacing_rad)
        front = np.flatnonzero(ways[:, 0] > 0.0)
        cells, ways = cells[front], ways[front]
        ways_W = _turned(_columns(ways), axes)
        hits = self._cast(_at(p_W), ways_W, self._limit_m)
        power = self._plane_power(cells, ways_W, self._share(ways), hits)
        some = np.flatnonzero(power > 0.0)
        return self._bent(p_W, cells[some], ways_W[:, some], hits.of(some), power[some], spacing_rad)

    def _ghosts(self, pose: CameraPose, axes: Float64, rays: _Rays) -> Ghosts:
        found = rays.found
        surface = self._surface[found.geom]
        cos_in = -dot(found.normal, rays.bent_W)
        image_m = rays.first_m + found.range_m
        v_W = pose.v_WC_W
        image_mps = found.speed_mps - dot(rays.way_W, v_W)
        way_R = _turned_back(rays.way_W, axes)
        tx, rx = self._shares(way_R)
        kept = cos_in > _LEAST_COSINE
        if self._class_kept is not None:
            kept &= self._class_kept[self._class[found.geom]] > 0

        both = np.flatnonzero(kept & (image_m <= self._limit_m) & (tx * rx >= PATTERN_FLOOR))
        c = cos_in[both]
        sigma0 = self._reflection.sigma0(surface[both], c, c, c, np.ones(len(c)))
        seen_power = tx[both] * rx[both] * sigma0 * rays.solid_sr[both] / c
        amplitude = self._scale * rays.power[both] * np.sqrt(seen_power) / image_m[both]
        there_R = way_R[both]
        parts = [self._made(BOTH, both, rays, image_m[both], image_mps[both], there_R, there_R, amplitude)]

        bent_place = rays.first_m * rays.way_W + found.range_m * rays.bent_W
        direct_m = np.sqrt(dot(bent_place, bent_place))
        mean_m = 0.5 * (image_m + direct_m)
        kept &= (direct_m > _TOUCH_M) & (mean_m <= self._limit_m)
        direct_W = bent_place / np.maximum(direct_m, _TOUCH_M)
        cos_out = -dot(found.normal, direct_W)
        direct_R = _turned_back(direct_W, axes)
        tx_direct, rx_direct = self._shares(direct_R)
        out_share, back_share = tx * rx_direct, tx_direct * rx
        kept &= (cos_out > _LEAST_COSINE) & (np.maximum(out_share, back_share) >= PATTERN_FLOOR)
        kept &= self._mask.in_window(direct_R)
        candidates = np.flatnonzero(kept)
        seen = self._cast(_at(pose.p_WC), direct_W[:, candidates], self._limit_m)
        free = seen.range_m >= direct_m[candidates] - _TOUCH_M
        # Beyond P there is another surface, or none, where rounding takes the ray past its edge.
        on_it = np.flatnonzero(free & (seen.range_m <= direct_m[candidates] + _TOUCH_M))
        at, seen = candidates[on_it], seen.of(on_it)
        to_W, normal = direct_W[:, at], found.normal[:, at]
        mean_mps = 0.5 * (image_mps[at] + seen.speed_mps - dot(to_W, v_W))
        c, c_out = cos_in[at], cos_out[at]
        bisector = -(rays.bent_W[:, at] + to_W)
        length = np.sqrt(np.maximum(dot(bisector, bisector), 1e-12))
        cos_beta = np.clip(dot(bisector, normal) / length, 0.0, 1.0)
        cos_local = np.clip(0.5 * length, 0.0, 1.0)
        sigma0 = self._reflection.sigma0(surface[at], c, c_out, cos_beta, cos_local)
        common = self._scale * np.sqrt(rays.power[at] * sigma0 * rays.solid_sr[at] / c) / direct_m[at]
        by_mirror_R, straight_R = way_R[at], direct_R[at]
        for kind, share, coming_R, going_R in (
            (OUT, out_share, straight_R, by_mirror_R),
            (BACK, back_share, by_mirror_R, straight_R),
        ):
            amplitude = common * np.sqrt(np.where(share[at] >= PATTERN_FLOOR, share[at], 0.0))
            parts.append(self._made(kind, at, rays, mean_m[at], mean_mps, coming_R, going_R, amplitude))
        return _joined(parts)

    def _made(
        self, kind: int, some: Ids, rays: _Rays, range_m: Float64, speed_mps: Float64,
        coming_R: Float64, going_R: Float64, amplitude: Float64,
    ) -> Ghosts:  # fmt: skip
        geom = rays.found.geom[some]
        speed = self._blades.seen_speeds(speed_mps, self._surface[geom], self._chirp)
        echoes = Echoes(range_m, speed, coming_R, amplitude, going_R)
        mirror = self._instance[rays.mirror_geom[some]]
        return Ghosts(echoes, np.full(len(geom), kind, np.uint8), self._instance[geom], mirror)

    def _of_corners(self, pose: CameraPose, planes: list[MirrorPlane]) -> Ghosts:
        made = self._corners.find(pose, planes, self._limit_m, self._caster_ranges, self._mirror_power_at)
        rows = [row for row in made if row.amplitude > 0.0]
        direction_R = np.array([row.direction_R for row in rows]).reshape(-1, 3)
        echoes = Echoes(
            np.array([row.range_m for row in rows], np.float64),
            np.array([row.speed_mps for row in rows], np.float64),
            direction_R,
            np.array([row.amplitude for row in rows], np.float64),
            direction_R,
        )
        instance = np.array([self._instance[row.plate_geom] if row.plate_geom >= 0 else 0 for row in rows], np.int64)
        mirror = np.array([self._instance[row.mirror_geom] for row in rows], np.int64)
        return Ghosts(echoes, np.full(len(rows), BOTH, np.uint8), instance, mirror)

    def _caster_ranges(self, origin_W: Vec3, way_W: Vec3) -> tuple[float, int, Vec3]:
        """Return range, geom and normal of the nearest surface."""
        hit = self._cast(_at(origin_W), _at(way_W), 4.0 * self._limit_m)
        x, y, z = hit.normal[:, 0].tolist()
        return float(hit.range_m[0]), int(hit.geom[0]), (x, y, z)

    def _mirror_power_at(self, geom: int, cosine: float) -> float:
        if geom < 0 or not self._mirror_at[geom]:
            return 0.0
        return float(self._reflection.mirror_power(self._surface[[geom]], np.array([cosine]))[0])


_AROUND = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
_NINE = np.arange(9)


def _planes(hits: _Hits, ways_W: Vectors) -> list[MirrorPlane]:
    """Return the planes that rays meet, by geom and direction: the first ray's of each."""
    key = np.round(hits.normal.T * 100.0).astype(np.int64)
    rows = np.concatenate([hits.geom[:, None], key], axis=1)
    planes = []
    for at in np.sort(np.unique(rows, axis=0, return_index=True)[1]).tolist():
        nx, ny, nz = hits.normal[:, at].tolist()
        wx, wy, wz = ways_W[:, at].tolist()
        distance_m = -float(hits.range_m[at]) * (nx * wx + ny * wy + nz * wz)
        planes.append(MirrorPlane((nx, ny, nz), distance_m, int(hits.geom[at])))
    return planes


def _both(a: _Rays, b: _Rays) -> _Rays:
    def joined(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([x, y], axis=-1)

    found = _Hits(*(joined(getattr(a.found, f.name), getattr(b.found, f.name)) for f in fields(_Hits)))
    return _Rays(
        np.concatenate([a.cell, b.cell]), joined(a.solid_sr, b.solid_sr), joined(a.way_W, b.way_W),
        joined(a.first_m, b.first_m), joined(a.mirror_geom, b.mirror_geom), joined(a.power, b.power),
        joined(a.bent_W, b.bent_W), found,
    )  # fmt: skip


def _joined(parts: list[Ghosts]) -> Ghosts:
    e = [part.echoes for part in parts]
    out = [x.direction_R if x.out_direction_R is None else x.out_direction_R for x in e]
    return Ghosts(
        Echoes(
            np.concatenate([x.range_m for x in e]),
            np.concatenate([x.speed_mps for x in e]),
            np.concatenate([x.direction_R for x in e]),
            np.concatenate([x.amplitude for x in e]),
            np.concatenate(out),
        ),
        np.concatenate([part.kind for part in parts]),
        np.concatenate([part.instance for part in parts]),
        np.concatenate([part.mirror for part in parts]),
    )


def _axes_of(pose: CameraPose) -> Float64:
    """Return x_R, y_R, z_R in W as rows: x_R = z_C, y_R = -x_C, z_R = -y_C."""
    R = pose.R_WC
    return np.array([[R[2], R[5], R[8]], [-R[0], -R[3], -R[6]], [-R[1], -R[4], -R[7]]])


def _columns(rows: Float64) -> Vectors:
    """Return rows of three as (3, n)."""
    return np.ascontiguousarray(rows.T)


def _turned(d_R: Vectors, axes: Float64) -> Vectors:
    return np.stack(applied_back(axes.ravel().tolist(), d_R))


def _turned_back(d_W: Vectors, axes: Float64) -> Float64:
    """Return directions in R as rows of three, as echoes have them."""
    return np.stack(applied(axes.ravel().tolist(), d_W), axis=1)


def _at(p: Vec3) -> Vectors:
    return np.array(p, np.float64).reshape(3, 1)
