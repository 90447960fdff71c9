"""Path tracer of a scene, in the child process: rays by Mitsuba's Embree, one compiled kernel by Dr.Jit.

A lane of the kernel is a pixel. It traces its paths one after another in one loop, so that no lane waits for the
longest path of its neighbours. At each surface point a ray towards a random point of the sun's disc brings sunlight;
the next direction is drawn from the coat (GGX; visible normals, Heitz, JCGT 2018) or from the diffuse base, and brings
skylight where it leaves the scene. With the half vector h and F by Schlick's approximation:

    f = (1 - F(v)) (1 - metallic) c / pi + F(v.h) D(h) G(v, l) / (4 (n.v) (n.l))

Random numbers are a function of pixel, sample, bounce and `seed` alone: a rotated R2 sequence for directions, and a
hash of the pixel. There are no sums whose order depends on threads.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from sim.frame.path_traced.protocol import LEAFY, WATERY, Exposure
from sim.frame.path_traced.protocol import LensData as Lens
from sim.frame.path_traced.sky import Sky

U, F, V = mi.UInt32, mi.Float, mi.Vector3f

MAX_BOUNCES = 5
_MAX_HOLES = 24  # holes that one ray may pass
_FIREFLY = 12.0  # brightest path, in units of a white surface in the light that the exposure is set for
_SUN_HALF_RAD = 0.00465
_OFFSET_M = 2e-4
_PER_HORIZON = 50.0  # the ground beyond the farthest geometry fades into the sky within 1 / 50 rad
_LEAST_FACING = 0.08  # cosine between a shading normal and the view
_LEAF_THROUGH = 0.35  # share of the light on a leaf that comes through


class Pictures(NamedTuple):
    """Means over the pixel: radiance, and the guides of the denoiser. All (height, width, 3)."""

    light: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray


class Tracer:
    """Scene in the tracer's memory."""

    def __init__(self, message: dict[str, Any], sky: Sky) -> None:
        self.set_sky(sky)
        static, moving = message["static"], message["moving"]
        self._first_moving = len(static[3])
        self._local_corner, self._local_normal, _, self._moving_geom = moving
        ends = [0, *(np.flatnonzero(np.diff(self._moving_geom)) + 1).tolist(), len(self._moving_geom)]
        self._parts = [
            (int(self._moving_geom[first]), slice(first, end)) for first, end in pairwise(ends) if first < end
        ]
        corner = np.concatenate([static[0], np.zeros_like(moving[0])])
        normal = np.concatenate([static[1], np.zeros_like(moving[1])])
        self._corner = F(corner.ravel())
        self._normal = F(normal.ravel())
        self._uv = F(np.concatenate([static[2], moving[2]]).ravel())
        self._geom = U(np.concatenate([static[3], moving[3]]).astype(np.uint32))
        tables = (message["material"], message["plain_material"])
        self._tables = tuple(F(table.ravel()) for table in tables)
        self._holes = bool(tables[0][:, 9].any())
        self._relief = bool((tables[0][:, 10] >= 0.0).any())
        self._columns = int(tables[0].shape[1])
        self._load_textures(message["textures"])
        shapes: dict[str, Any] = {"type": "scene"}
        self._meshes = {}
        for name, part in (("static", static[0]), ("moving", moving[0])):
            if len(part):
                shapes[name] = self._meshes[name] = _mesh(name, part)
        self._scene = mi.load_dict(shapes)
        self._parameters = mi.traverse(self._scene)
        self._moving_key = "moving.vertex_positions"
        self._last_poses: bytes | None = None
        self._lens_tables: dict[int, tuple[Lens, Any]] = {}

    def set_sky(self, sky: Sky) -> None:
        """Change the light."""
        self._sky = sky
        self._sky_map = F(sky.map.astype(np.float32).ravel())

    def _load_textures(self, textures: list[np.ndarray]) -> None:
        texels: list[np.ndarray] = [np.zeros(1, np.uint32)]
        sizes: list[tuple[int, int, int]] = []
        offset = 1
        for image in textures:
            height, width = image.shape[:2]
            packed = image.astype(np.uint32)
            texels.append((packed[..., 0] | packed[..., 1] << 8 | packed[..., 2] << 16 | packed[..., 3] << 24).ravel())
            sizes.append((offset, width, height))
            offset += width * height
        self._texels = U(np.concatenate(texels))
        self._texture_sizes = U(np.array(sizes or [(0, 1, 1)], np.uint32).ravel())

    def place(self, geoms: np.ndarray, p: np.ndarray, R: np.ndarray) -> None:
        """Move the geoms of actors."""
        if not len(self._moving_geom):
            return
        poses = p.tobytes() + R.tobytes()
        if poses == self._last_poses:
            return
        self._last_poses = poses
        corner, normal = np.empty_like(self._local_corner), np.empty_like(self._local_normal)
        row_of = {geom: row for row, geom in enumerate(geoms.tolist())}
        for geom, part in self._parts:
            row = row_of[geom]
            np.matmul(self._local_corner[part].reshape(-1, 3), R[row].T, out=corner[part].reshape(-1, 3))
            np.matmul(self._local_normal[part].reshape(-1, 3), R[row].T, out=normal[part].reshape(-1, 3))
            corner[part] += p[row]
        lanes = 9 * self._first_moving + dr.arange(U, corner.size)
        placed = F(corner.ravel())
        dr.scatter(self._corner, placed, lanes)
        dr.scatter(self._normal, F(normal.ravel()), lanes)
        self._parameters[self._moving_key] = placed
        self._parameters.update()

    def render(
        self, lens: Lens, exposure: Exposure, *, samples: int, seed: int, textures: bool, rows: tuple[int, int]
    ) -> Pictures:
        """Return the means of `samples` paths per pixel, for rows [from, to)."""
        n = lens.width * (rows[1] - rows[0])
        lane = dr.arange(U, n) + dr.opaque(U, rows[0] * lens.width)
        sums = self._paths(lens, exposure, lane, dr.opaque(U, samples), dr.opaque(U, seed & 0xFFFFFFFF), textures)
        dr.eval(sums)
        shape = (rows[1] - rows[0], lens.width, 3)
        light, albedo, normal = (np.ascontiguousarray(np.array(s).T.reshape(shape) / np.float32(samples)) for s in sums)
        return Pictures(light, albedo, normal)

    def surfaces(self, lens: Lens, exposure: Exposure) -> tuple[np.ndarray, np.ndarray]:
        """Return the geom (-1: none) and the distance along the ray [m] at the centre of each pixel."""
        lane = dr.arange(U, lens.width * lens.height)
        half = dr.full(F, 0.5, len(lane))
        origin, direction, start, reach = self._camera_ray(lens, exposure, lane, half, half, dr.zeros(U, len(lane)))
        ray = mi.Ray3f(origin + start * direction, direction)
        ray.maxt = reach
        found, distance, _, triangle, _ = self._meet(ray, dr.full(mi.Bool, True, len(lane)))
        geom = dr.select(found, dr.gather(mi.Int32, mi.Int32(self._geom), triangle, found), -1)
        shape = (lens.height, lens.width)
        far = dr.select(found, distance + start, float("inf"))
        return np.array(geom).reshape(shape), np.array(far).reshape(shape)

    # ---- the kernel ----

    def _camera_ray(self, lens: Lens, exposure: Exposure, lane: Any, jx: Any, jy: Any, moment: Any) -> Any:
        """Return origin, direction (unit), distance of the near plane and reach of the rays through pixels."""
        width = dr.opaque(U, lens.width)
        row = lane // width
        column = lane - row * width
        if lens.table is None:
            x = (F(column) + jx - dr.opaque(F, lens.c[0])) * dr.opaque(F, 1.0 / lens.f[0])
            y = (F(row) + jy - dr.opaque(F, lens.c[1])) * dr.opaque(F, 1.0 / lens.f[1])
            d_C = V(x, y, 1.0)
            length = dr.norm(d_C)
            d_C /= length
        else:
            table = self._table_of(lens)
            nodes, across = dr.opaque(F, lens.nodes), dr.opaque(U, lens.table.shape[1])
            x, y = (F(column) + jx) * nodes, (F(row) + jy) * nodes
            x0 = dr.minimum(U(x), across - 2)
            y0 = dr.minimum(U(y), dr.opaque(U, lens.table.shape[0] - 2))
            at, wx = y0 * across + x0, x - F(x0)
            upper = dr.lerp(dr.gather(V, table, at), dr.gather(V, table, at + 1), wx)
            lower = dr.lerp(dr.gather(V, table, at + across), dr.gather(V, table, at + across + 1), wx)
            d_C = dr.normalize(dr.lerp(upper, lower, y - F(y0)))
            length = F(1.0)
        band = dr.minimum(row // dr.opaque(U, exposure.band_rows), dr.opaque(U, exposure.bands - 1))
        at = moment * dr.opaque(U, exposure.bands) + band
        p, R = F(exposure.p_WC.astype(np.float32).ravel()), F(exposure.R_WC.astype(np.float32).ravel())
        origin = dr.gather(V, p, at)
        d = V(*(dr.dot(dr.gather(V, R, 3 * at + i), d_C) for i in range(3)))
        near, far = (dr.opaque(F, plane) * length for plane in lens.planes_m)
        return origin, d, near, far - near

    def _table_of(self, lens: Lens) -> Any:
        """Return the table of a lens in the kernel's memory, kept for all tiles and pictures."""
        if id(lens) not in self._lens_tables:  # the entry holds the lens, so that its id stays its own
            assert lens.table is not None
            self._lens_tables[id(lens)] = (lens, F(lens.table.astype(np.float32).ravel()))
        return self._lens_tables[id(lens)][1]

    @dr.syntax
    def _meet(self, ray: Any, active: Any) -> Any:
        """Return whether rays meet a surface (not a hole of one), distance, barycentrics, triangle and material row."""
        found = mi.Bool(False)
        distance = F(0.0)
        bary = mi.Point2f(0.0)
        triangle = U(0)
        if dr.hint(self._holes, mode="scalar"):
            going = mi.Bool(active)
            holes = U(0)
            o, reach = mi.Point3f(ray.o), F(ray.maxt)
            while going:
                step = mi.Ray3f(o, ray.d)
                step.maxt = reach
                hit, t, bary_here, here = self._nearest(step, going)
                opaque = hit & ~self._is_hole(here, bary_here, hit)
                distance = dr.select(going, distance + dr.select(hit, t, 0.0), distance)
                bary = dr.select(opaque, bary_here, bary)
                triangle = dr.select(opaque, here, triangle)
                found = found | opaque
                holes += 1
                going = going & hit & ~opaque & (holes < _MAX_HOLES)
                o = mi.Point3f(o + (t + _OFFSET_M) * ray.d)
                distance = dr.select(going, distance + _OFFSET_M, distance)
                reach = reach - t - _OFFSET_M
        else:
            found, distance, bary, triangle = self._nearest(ray, active)
        return found, distance, bary, triangle, dr.gather(U, self._geom, triangle, found) * self._columns

    def _nearest(self, ray: Any, active: Any) -> Any:
        pi = self._scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        hit = pi.is_valid() & active
        first = U(0)
        if len(self._meshes) == 2:
            moving = pi.shape == mi.ShapePtr(self._meshes["moving"])
            first = dr.select(moving, dr.opaque(U, self._first_moving), 0)
        elif "moving" in self._meshes:
            first = dr.opaque(U, self._first_moving)
        return hit, pi.t, pi.prim_uv, pi.prim_index + first

    def _corners(self, buffer: Any, triangle: Any, active: Any) -> tuple[Any, Any, Any]:
        return tuple(dr.gather(V, buffer, 3 * triangle + k, active) for k in range(3))

    def _uv_at(self, triangle: Any, bary: Any, active: Any) -> Any:
        a, b, c = (dr.gather(mi.Vector2f, self._uv, 3 * triangle + k, active) for k in range(3))
        return a + (b - a) * bary.x + (c - a) * bary.y

    def _is_hole(self, triangle: Any, bary: Any, active: Any) -> Any:
        row = dr.gather(U, self._geom, triangle, active) * self._columns
        masked = active & (dr.gather(F, self._tables[0], row + 9, active) > 0.0)
        texture = U(dr.gather(F, self._tables[0], row + 3, masked))
        offset, w, h = (dr.gather(U, self._texture_sizes, 3 * texture + i, masked) for i in range(3))
        uv = self._uv_at(triangle, bary, masked)
        x = dr.minimum(U((uv.x - dr.floor(uv.x)) * F(w)), w - 1)
        y = dr.minimum(U((uv.y - dr.floor(uv.y)) * F(h)), h - 1)
        return masked & (dr.gather(U, self._texels, offset + y * w + x, masked) < U(0x80000000))

    def _texture(self, texture: Any, uv: Any, active: Any, *, colour: bool = True) -> Any:
        """Return textures between the four nearest texels that are not holes; colours in linear light."""
        offset, w, h = (dr.gather(U, self._texture_sizes, 3 * texture + i, active) for i in range(3))
        x, y = (uv.x - dr.floor(uv.x)) * F(w) - 0.5, (uv.y - dr.floor(uv.y)) * F(h) - 0.5
        x0, y0 = dr.floor(x), dr.floor(y)
        wx, wy = x - x0, y - y0
        i0 = dr.select(x0 < 0.0, w - 1, U(dr.maximum(x0, 0.0)))
        j0 = dr.select(y0 < 0.0, h - 1, U(dr.maximum(y0, 0.0)))
        i0, j0 = dr.minimum(i0, w - 1), dr.minimum(j0, h - 1)
        i1, j1 = dr.select(i0 + 1 < w, i0 + 1, 0), dr.select(j0 + 1 < h, j0 + 1, 0)
        total, weight = V(0.0), F(0.0)
        for i, j, part in (
            (i0, j0, (1 - wx) * (1 - wy)),
            (i1, j0, wx * (1 - wy)),
            (i0, j1, (1 - wx) * wy),
            (i1, j1, wx * wy),
        ):
            texel = dr.gather(U, self._texels, offset + j * w + i, active)
            part = dr.select(texel >= U(0x80000000), part, 0.0) + 1e-6
            c = V(F(texel & 255), F((texel >> 8) & 255), F((texel >> 16) & 255)) * (1.0 / 255.0)
            total += part * (c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878) if colour else c)
            weight += part
        return total / weight

    def _relieved(self, relief: Any, triangle: Any, bary: Any, n: Any, ab: Any, ac: Any) -> Any:
        """Return normals bent by a texture of normals: n + (r_u / r_n) t_u + (r_v / r_n) t_v, with v upwards."""
        has = relief >= 0.0
        a, b, c = (dr.gather(mi.Vector2f, self._uv, 3 * triangle + k, has) for k in range(3))
        du, dv = b - a, c - a
        area = du.x * dv.y - du.y * dv.x
        per = dr.select(dr.abs(area) > 1e-20, 1.0 / area, 0.0)
        along_u, down_v = (ab * dv.y - ac * du.y) * per, (ac * du.x - ab * dv.x) * per
        texel = self._texture(U(dr.maximum(relief, 0.0)), a + du * bary.x + dv * bary.y, has, colour=False)
        r = texel * 2.0 - 1.0
        up = dr.maximum(r.z, 0.1)
        t_u = along_u * dr.rsqrt(dr.maximum(dr.squared_norm(along_u), 1e-20))
        t_v = -down_v * dr.rsqrt(dr.maximum(dr.squared_norm(down_v), 1e-20))
        return dr.normalize(n + t_u * (r.x / up) + t_v * (r.y / up))

    @dr.syntax
    def _paths(self, lens: Lens, exposure: Exposure, lane: Any, samples: Any, seed: Any, textures: bool) -> Any:
        table = self._tables[0 if textures else 1]
        sky = self._sky
        to_sun = V(*(dr.opaque(F, float(x)) for x in sky.to_sun))
        sun_x, sun_y = _frame(to_sun)
        sun = V(*(dr.opaque(F, float(x)) for x in sky.sun_rgb))
        sun_up = dr.opaque(F, float(max(sky.sun_rgb))) > 0.0
        disc = V(*(dr.opaque(F, float(x)) for x in sky.disc_rgb))
        haze, haze_m = dr.opaque(F, sky.extinction_per_m), dr.opaque(F, sky.haze_m)
        air_per_m = dr.opaque(F, sky.extinction_per_m + sky.clear_air_per_m)
        brightest = dr.opaque(F, _FIREFLY * sky.white)
        per_moment = dr.opaque(F, exposure.moments) / F(samples)
        moments = dr.opaque(U, exposure.moments)

        width = len(lane)
        sample, bounce = dr.zeros(U, width), dr.zeros(U, width)
        o, d = mi.Point3f(dr.zeros(V, width)), dr.zeros(V, width)
        reach = dr.zeros(F, width)
        beta, light = dr.zeros(V, width), dr.zeros(V, width)
        sum_light, sum_albedo, sum_normal = dr.zeros(V, width), dr.zeros(V, width), dr.zeros(V, width)
        key = _hash(lane ^ (seed * U(0x9E3779B1)))

        while sample < samples:
            # Random numbers of this bounce: three pairs of a rotated R2 sequence. Its order is shuffled per bounce.
            noise = _hash(key + (bounce + 1) * U(0x85EBCA6B))
            index = dr.select(bounce == 0, sample, (sample ^ (noise >> 9)) & U(1023))
            u0, u1 = _r2(index, noise)
            noise2 = _hash(noise)
            u2, u3 = _r2(index, noise2)
            noise3 = _hash(noise2)
            u4, u5 = _r2(index, noise3)

            start = bounce == 0
            if start:
                moment = dr.minimum(U((F(sample) + 0.5) * per_moment), moments - 1)
                origin, d_new, near, far = self._camera_ray(lens, exposure, lane, u4, u5, moment)
                d = d_new
                o = mi.Point3f(origin + near * d_new)
                reach = far
                beta, light = V(1.0), V(0.0)

            ray = mi.Ray3f(o, d)
            ray.maxt = reach
            found, t, bary, triangle, row = self._meet(ray, mi.Bool(True))
            done = mi.Bool(False)

            # Air in front of what the camera sees. The sky's model contains clear air.
            depth = dr.select(found, air_per_m * t, haze * haze_m / dr.maximum(d.z, 1e-3))
            through = dr.select(start, dr.exp(-depth), 1.0)
            air = self._sky_at(V(d.x, d.y, dr.maximum(d.z, 0.03)))
            light += beta * air * (1.0 - through)
            beta *= through

            if ~found:
                seen = self._sky_at(d)
                cosine = dr.dot(d, to_sun)
                seen += dr.select(start & (cosine > 0.999989), disc, V(0.0))
                light += beta * seen
                sum_albedo += dr.select(start, V(1.0), V(0.0))
                done = mi.Bool(True)
            else:
                a, b, c = self._corners(self._corner, triangle, found)
                ab, ac = b - a, c - a
                p = a + ab * bary.x + ac * bary.y
                ng = dr.normalize(dr.cross(ab, ac))
                na, nb, nc = self._corners(self._normal, triangle, found)
                n = na * (1.0 - bary.x - bary.y) + nb * bary.x + nc * bary.y
                n = dr.select(dr.squared_norm(n) > 1e-8, dr.normalize(n), ng)
                ng = dr.select(dr.dot(ng, d) > 0.0, -ng, ng)
                n = dr.select(dr.dot(n, ng) < 0.0, -n, n)
                colour = V(*(dr.gather(F, table, row + i, found) for i in range(3)))
                texture = dr.gather(F, table, row + 3, found)
                has_texture = texture >= 0.0
                uv = self._uv_at(triangle, bary, has_texture)
                texel = self._texture(U(dr.maximum(texture, 0.0)), uv, has_texture)
                colour = dr.select(has_texture, colour * texel, colour)
                f0_dielectric = dr.gather(F, table, row + 4, found)
                alpha = dr.gather(F, table, row + 5, found)
                metal = dr.gather(F, table, row + 6, found)
                emission = dr.gather(F, table, row + 7, found)
                kind = dr.gather(F, table, row + 8, found)
                leafy = kind == float(LEAFY)
                n = dr.select(kind == float(WATERY), _rippled(p, n), n)
                if dr.hint(self._relief, mode="scalar"):
                    relief = dr.gather(F, table, row + 10, found)
                    n = dr.select(relief >= 0.0, self._relieved(relief, triangle, bary, n, ab, ac), n)
                colour = dr.minimum(colour, 0.95)
                sum_albedo += dr.select(start, colour, V(0.0))
                sum_normal += dr.select(start, n, V(0.0))
                light += beta * emission * colour * sky.white

                v = -d
                # An interpolated normal may face away from the viewer: it is bent until it does not.
                n = dr.normalize(n + v * dr.maximum(_LEAST_FACING - dr.dot(n, v), 0.0))
                nv = dr.maximum(dr.dot(n, v), 1e-3)
                f0 = dr.lerp(V(f0_dielectric), colour, metal)
                has_coat = f0_dielectric + metal > 0.0
                # After a diffuse bounce a sharp highlight would be one bright dot.
                alpha = dr.select(start, alpha, dr.maximum(alpha, 0.25))
                Fv = dr.select(has_coat, f0 + (dr.maximum(V(1.0 - alpha), f0) - f0) * _fifth(1.0 - nv), V(0.0))
                base = colour * (1.0 - metal) * (1.0 - Fv)

                # Sunlight.
                r, phi = _SUN_HALF_RAD * dr.sqrt(u0), dr.two_pi * u1
                wl = dr.normalize(to_sun + r * (dr.cos(phi) * sun_x + dr.sin(phi) * sun_y))
                nl, gl = dr.dot(n, wl), dr.dot(ng, wl)
                from_behind = leafy & (nl < 0.0)
                lit = sun_up & ((nl > 0.0) & (gl > 0.0) | from_behind)
                side = dr.select(from_behind, -ng, ng)
                if lit:
                    shadow = mi.Ray3f(p + side * (_OFFSET_M * (1.0 + 0.02 * dr.max(dr.abs(p)))), wl)
                    blocked, _t, _b, _tri, _row = self._meet(shadow, lit)
                    nl_abs = dr.abs(nl)
                    coat = dr.select(from_behind | ~has_coat, V(0.0), _coat(n, v, wl, nv, nl_abs, alpha, f0))
                    leaf = dr.select(leafy, dr.select(from_behind, _LEAF_THROUGH, 1.0 - _LEAF_THROUGH), 1.0)
                    got = beta * sun * nl_abs * (base * (dr.inv_pi * leaf) + coat)
                    light += dr.select(blocked, V(0.0), got)

                # The next direction.
                strength = dr.mean(Fv)
                chance = dr.select(
                    has_coat, dr.clip(strength / dr.maximum(strength + dr.mean(base), 1e-4), 0.05, 0.95), 0.0
                )
                pick = F(noise >> 8) * (1.0 / 16777216.0)
                pick = pick + F(sample) * 0.6180339887
                pick = pick - dr.floor(pick)
                sx, sy = _frame(n)
                if pick < chance:
                    h_local = _visible_normal(V(dr.dot(v, sx), dr.dot(v, sy), nv), alpha, u2, u3)
                    h = sx * h_local.x + sy * h_local.y + n * h_local.z
                    mirrored = dr.normalize(2.0 * dr.dot(v, h) * h - v)
                    nwi = dr.dot(n, mirrored)
                    Fh = f0 + (1.0 - f0) * _fifth(1.0 - dr.maximum(dr.dot(v, h), 0.0))
                    beta *= dr.select(nwi > 0.0, Fh * (_masking(nwi, alpha) / chance), V(0.0))
                    d = mirrored
                    done = (nwi <= 0.0) | (dr.dot(ng, mirrored) <= 0.0)
                else:
                    across, turn = dr.sqrt(u2), dr.two_pi * u3
                    up = dr.sqrt(dr.maximum(1.0 - u2, 0.0))
                    flip = leafy & (u4 < _LEAF_THROUGH)
                    d = dr.normalize(
                        sx * (across * dr.cos(turn)) + sy * (across * dr.sin(turn)) + n * dr.select(flip, -up, up)
                    )
                    beta *= base / (1.0 - chance)
                    done = ~flip & (dr.dot(ng, d) <= 0.0)
                outside = dr.select(dr.dot(ng, d) < 0.0, -ng, ng)
                o = mi.Point3f(p + outside * (_OFFSET_M * (1.0 + 0.02 * dr.max(dr.abs(p)))))
                reach = F(1e6)
                bounce += 1
                # Paths with little left end early (Russian roulette).
                left = dr.max(beta)
                survive = dr.select(bounce >= 2, dr.clip(left * 1.5, 0.1, 1.0), 1.0)
                lucky = F(noise3 >> 8) * (1.0 / 16777216.0) < survive
                beta /= survive
                done = done | (bounce >= MAX_BOUNCES) | (left <= 0.0) | ~lucky

            if done:
                brightness = dr.max(light)
                limited = light * dr.select(brightness > brightest, brightest / brightness, 1.0)
                sum_light += dr.select(dr.isfinite(brightness), limited, V(0.0))
                sample += 1
                bounce = U(0)
        return sum_light, sum_albedo, sum_normal

    def _sky_at(self, d: Any) -> Any:
        """Return the radiance of the sky; below the horizon that of far ground."""
        rows, columns = self._sky.map.shape[:2]
        # Rows are equally spaced in the square root of the elevation's sine, as the horizon has the most detail.
        y = dr.sqrt(dr.clip(d.z, 0.0, 1.0)) * (rows - 1)
        x = (dr.atan2(d.y, d.x) * dr.inv_two_pi + 0.5) * columns
        y0, x0 = dr.minimum(dr.floor(y), rows - 2.0), dr.floor(x)
        wy, wx = y - y0, x - x0
        i0 = U(dr.clip(x0, 0.0, columns - 1.0))
        i1 = dr.select(i0 + 1 < columns, i0 + 1, 0)
        low = U(y0) * columns
        up = low + columns
        lower = dr.lerp(dr.gather(V, self._sky_map, low + i0), dr.gather(V, self._sky_map, low + i1), wx)
        upper = dr.lerp(dr.gather(V, self._sky_map, up + i0), dr.gather(V, self._sky_map, up + i1), wx)
        ground = V(*(dr.opaque(F, float(x)) for x in self._sky.ground_rgb))
        return dr.lerp(dr.lerp(lower, upper, wy), ground, dr.clip(-_PER_HORIZON * d.z, 0.0, 1.0))


def _mesh(name: str, corner: np.ndarray) -> Any:
    mesh = mi.Mesh(name, 3 * len(corner), len(corner), has_vertex_normals=False, has_vertex_texcoords=False)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = F(corner.ravel())
    parameters["faces"] = U(np.arange(3 * len(corner), dtype=np.uint32))
    parameters.update()
    return mesh


def _hash(x: Any) -> Any:
    """Mix 32 bits (Wellons, hash-prospector: lowbias32)."""
    x = U(x)
    x = (x ^ (x >> 16)) * U(0x7FEB352D)
    x = (x ^ (x >> 15)) * U(0x846CA68B)
    return x ^ (x >> 16)


def _r2(index: Any, noise: Any) -> tuple[Any, Any]:
    """Return point `index` of the R2 sequence (Roberts 2018), rotated by `noise`; in fixed point, so exact."""
    unit = 1.0 / 16777216.0
    x = index * U(0xC13FA9A9) + noise
    y = index * U(0x91E10DA5) + noise * U(0x9E3779B1)
    return F(x >> 8) * unit, F(y >> 8) * unit


def _frame(n: Any) -> tuple[Any, Any]:
    """Return two unit vectors across n (Duff et al., JCGT 2017)."""
    sign = dr.select(n.z >= 0.0, F(1.0), F(-1.0))
    a = -1.0 / (sign + n.z)
    b = n.x * n.y * a
    return V(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), V(b, sign + n.y * n.y * a, -n.y)


def _fifth(x: Any) -> Any:
    square = x * x
    return square * square * x


def _masking(cosine: Any, alpha: Any) -> Any:
    """Return Smith's masking of GGX in one direction."""
    square = cosine * cosine
    tan2 = (1.0 - square) / dr.maximum(square, 1e-6)
    return 2.0 / (1.0 + dr.sqrt(1.0 + alpha * alpha * dr.maximum(tan2, 0.0)))


def _coat(n: Any, v: Any, wl: Any, nv: Any, nl: Any, alpha: Any, f0: Any) -> Any:
    """Return the reflectance of the coat from wl to v [1/sr]."""
    h = dr.normalize(v + wl)
    nh, vh = dr.dot(n, h), dr.maximum(dr.dot(v, h), 0.0)
    a2 = alpha * alpha
    k = nh * nh * (a2 - 1.0) + 1.0
    D = a2 / (dr.pi * dr.maximum(k * k, 1e-12))
    fresnel = f0 + (1.0 - f0) * _fifth(1.0 - vh)
    return fresnel * (D * _masking(nv, alpha) * _masking(nl, alpha) / (4.0 * nv * dr.maximum(nl, 1e-3)))


def _visible_normal(v: Any, alpha: Any, u0: Any, u1: Any) -> Any:
    """Draw a normal of the GGX surface that v sees, in local axes (Heitz, JCGT 2018)."""
    stretched = dr.normalize(V(alpha * v.x, alpha * v.y, v.z))
    length2 = stretched.x * stretched.x + stretched.y * stretched.y
    per = dr.rsqrt(dr.maximum(length2, 1e-12))
    t1 = dr.select(length2 > 1e-7, V(-stretched.y * per, stretched.x * per, 0.0), V(1.0, 0.0, 0.0))
    t2 = dr.cross(stretched, t1)
    r, phi = dr.sqrt(u0), dr.two_pi * u1
    p1 = r * dr.cos(phi)
    s = 0.5 * (1.0 + stretched.z)
    p2 = dr.lerp(dr.safe_sqrt(1.0 - p1 * p1), r * dr.sin(phi), s)
    n = t1 * p1 + t2 * p2 + stretched * dr.safe_sqrt(1.0 - p1 * p1 - p2 * p2)
    return dr.normalize(V(alpha * n.x, alpha * n.y, dr.maximum(n.z, 1e-6)))


_RIPPLES = ((1.7, 0.6, 0.011), (-0.9, 2.3, 0.010), (4.1, -2.9, 0.006), (3.3, 5.7, 0.004), (-9.1, 6.3, 0.0025))


def _rippled(p: Any, n: Any) -> Any:
    """Return the normal of water with small waves: wave vectors [rad/m] and slopes of a light breeze."""
    slope_x, slope_y = F(0.0), F(0.0)
    for kx, ky, slope in _RIPPLES:
        wave = slope * dr.cos(kx * p.x + ky * p.y + 3.0 * dr.sin(0.31 * ky * p.x - 0.27 * kx * p.y))
        per = 1.0 / float(np.hypot(kx, ky))
        slope_x += kx * per * wave
        slope_y += ky * per * wave
    return dr.normalize(V(n.x - slope_x, n.y - slope_y, n.z))
