// The inner loops that make channels of visible surfaces. See resolve.hpp.
#include "lane_exp.hpp"
#include "resolve.hpp"
#include "shapes.hpp"

namespace hil::sim::frame::HIL_ISA {

namespace {

struct Surface {  // what the pixels of one geom see within a block
    F t;
    I mask;
    Vec<F> d;   // ray in C
    Vec<F> local, gradient;  // point and outward direction in the local frame of the geom (DrawnGeom)
    Vec<F> normal;           // unit, in C, towards the camera
};

HIL_INLINE Vec<F> rays_of(const RayTable &rays, int row, int column, int block) {
    if (rays.projection == Projection::kTable) {
        const float *xyz = rays.xyz.data() + 48 * block;
        return {load<F>(xyz), load<F>(xyz + 16), load<F>(xyz + 32)};
    }
    return {load<F>(rays.x.data() + 16 * column), load<F>(rays.y.data() + 16 * row), splat<F>(1)};
}

HIL_INLINE F length_of(const Vec<F> &v) { return sqrt(max(dot(v, v), splat<F>(1e-30f))); }

// Outward direction of a primitive at a point of its surface, in its local frame; any length.
HIL_INLINE Vec<F> gradient(const DrawnGeom &g, const Vec<F> &p) {
    const F zero = splat<F>(0), one = splat<F>(1);
    switch (g.shape) {
        case Shape::kBox: {
            // The face that the point is nearest to, from inside or outside.
            const F x = abs(p.x) - g.half[0], y = abs(p.y) - g.half[1], z = abs(p.z) - g.half[2];
            const I is_x = (x >= y) & (x >= z), is_y = ~is_x & (y >= z), is_z = ~is_x & ~is_y;
            return {select(is_x, copysign(one, p.x), zero), select(is_y, copysign(one, p.y), zero),
                    select(is_z, copysign(one, p.z), zero)};
        }
        case Shape::kCylinder: {
            const F end = abs(abs(p.z) - g.half[2]), side = abs(sqrt(p.x * p.x + p.y * p.y) - g.radius);
            const I cap = end < side;
            return {select(cap, zero, p.x), select(cap, zero, p.y), select(cap, copysign(one, p.z), zero)};
        }
        case Shape::kCapsule: {
            const F end = splat<F>(g.half[2]);
            return {p.x, p.y, p.z - min(max(p.z, -end), end)};
        }
        case Shape::kPlane: return {zero, zero, one};
        default: return p;
    }
}

struct MeshPoint {
    Vec<F> flat, smooth;  // normals in the local frame; smooth only where the mesh has normals of its own
    F u, v;
};

// Triangle by triangle: its normal and, if `look`, what is interpolated over it.
HIL_INLINE MeshPoint mesh_point(const DrawnGeom &g, const std::int32_t *triangles, const I &mask, const Vec<F> &p, bool look) {
    const F zero = splat<F>(0);
    const Mesh &mesh = *g.mesh;
    const bool smooth = look && !mesh.corner_normal.empty(), textured = look && !mesh.uv.empty();
    const I index = load<I>(triangles);
    MeshPoint found{{zero, zero, zero}, {zero, zero, zero}, zero, zero};
    for (unsigned lanes = bits(mask); lanes != 0;) {
        const std::int32_t triangle = triangles[__builtin_ctz(lanes)];
        const I here = mask & (index == splat<I>(triangle));
        lanes &= ~bits(here);
        const long t = triangle;
        const float *flat = mesh.normal.data() + 3 * t;
        found.flat = {select(here, splat<F>(flat[0]), found.flat.x), select(here, splat<F>(flat[1]), found.flat.y),
                      select(here, splat<F>(flat[2]), found.flat.z)};
        if (!smooth && !textured) continue;
        const std::int32_t *corner = mesh.triangle.data() + 3 * t;
        const float *a = mesh.vertex.data() + 3 * (long)corner[0], *grad = mesh.barycentric.data() + 6 * t;
        const F x = p.x - a[0], y = p.y - a[1], z = p.z - a[2];
        const F wb = x * grad[0] + y * grad[1] + z * grad[2], wc = x * grad[3] + y * grad[4] + z * grad[5];
        const auto between = [&](const float *from, int stride, int i) {
            return from[i] + wb * (from[stride + i] - from[i]) + wc * (from[2 * stride + i] - from[i]);
        };
        if (textured) {
            const float *from = mesh.uv.data() + 6 * t;
            found.u = select(here, between(from, 2, 0), found.u);
            found.v = select(here, between(from, 2, 1), found.v);
        }
        if (smooth) {
            const float *from = mesh.corner_normal.data() + 9 * t;
            found.smooth = {select(here, between(from, 3, 0), found.smooth.x), select(here, between(from, 3, 1), found.smooth.y),
                            select(here, between(from, 3, 2), found.smooth.z)};
        }
    }
    return found;
}

struct Rgb {
    F r, g, b;
};

// sRGB code / 255 to linear, by a cubic (within 1.2e-3 of the curve of IEC 61966-2-1 up to 1).
HIL_INLINE float decode(float c) { return c * (c * (c * 0.305306011f + 0.682171111f) + 0.012522878f); }

// Linear to sRGB codes 0..255 in three bytes, with s = sqrt(x): a rational fit, within 0.7 of a code of the curve. The
// three quotients share one division.
HIL_INLINE I encode(const Rgb &c) {
    const F zero = splat<F>(0), one = splat<F>(1);
    const auto root = [&](const F &x) { return sqrt(min(max(x, zero), one)); };
    const auto over = [](const F &s) { return s * (s * (s * 74.8932967f + 20.5008569f) - 0.0527410168f); };
    const auto under = [](const F &s) { return s * (s * 84.3211935f + 9.77384834f) + 1.0f; };
    const F r = root(c.r), g = root(c.g), b = root(c.b), ur = under(r), ug = under(g), ub = under(b);
    const F rg = ur * ug, per = 255.0f / (rg * ub);
    const auto code = [&](const F &x) { return truncate(min(x + 0.5f, splat<F>(255))); };
    return code(over(r) * (ug * ub * per)) | shift_left(code(over(g) * (ur * ub * per)), 8) |
           shift_left(code(over(b) * (rg * per)), 16);
}

// Place of a texel in an image 2^power wide: images are stored in squares of 4 x 4, a cache line each.
HIL_INLINE I texel_at(const I &row, const I &column, const I &power) {
    return shift_left(shift_left(shift_right(row, 2), power - (std::int32_t)2) + shift_right(column, 2), 4) +
           shift_left(row & (std::int32_t)3, 2) + (column & (std::int32_t)3);
}

// Colour of the surface, linear.
HIL_INLINE Rgb albedo(const DrawnGeom &g, const Appearance &look, const Scenery &scenery, const Surface &s, float pixel_angle_rad,
                      const F &mesh_u, const F &mesh_v, bool mesh_uv) {
    const float base[3] = {look.rgb[0], look.rgb[1], look.rgb[2]};
    if (look.texture < 0) return {splat<F>(decode(base[0])), splat<F>(decode(base[1])), splat<F>(decode(base[2]))};
    const Texture &texture = scenery.textures.data()[look.texture];
    // Along which axis of the geom the surface looks, and the two others as coordinates [m].
    const F nx = abs(s.gradient.x), ny = abs(s.gradient.y), nz = abs(s.gradient.z);
    const I along_z = (nz >= nx) & (nz >= ny), along_x = ~along_z & (nx >= ny);
    Vec<F> p = s.local;
    float edge[3] = {2.0f * g.half[0], 2.0f * g.half[1], 2.0f * g.half[2]};
    if (g.shape == Shape::kEllipsoid) {
        p = {p.x * g.half[0], p.y * g.half[1], p.z * g.half[2]};
    } else if (g.shape == Shape::kSphere) {
        edge[0] = edge[1] = edge[2] = 2.0f * g.radius;
    } else if (g.shape == Shape::kCapsule || g.shape == Shape::kCylinder) {
        edge[0] = edge[1] = 2.0f * g.radius;
    } else if (g.shape == Shape::kMesh) {
        for (int i = 0; i < 3; ++i) edge[i] = g.mesh->box.hi[i] - g.mesh->box.lo[i];
    }
    I cube_face = splat<I>(0);
    F u, v, du = splat<F>(1), dv = du;  // du, dv: copies of the texture per metre
    if (mesh_uv) {
        u = mesh_u * look.repeat[0];
        v = mesh_v * look.repeat[1];
        du = splat<F>(look.repeat[0] * g.mesh->uv_per_m);
        dv = splat<F>(look.repeat[1] * g.mesh->uv_per_m);
    } else if (texture.cube) {
        // By direction from the middle of the geom's box, faces and their axes as OpenGL has them.
        const auto per_half = [&](const F &x, int i) { return x * (edge[i] > 0.0f && edge[i] < 1e6f ? 2.0f / edge[i] : 1.0f); };
        const F qx = per_half(p.x, 0), qy = per_half(p.y, 1), qz = per_half(p.z, 2);
        const F ax = abs(qx), ay = abs(qy), az = abs(qz);
        const I face_z = (az >= ax) & (az >= ay), face_x = ~face_z & (ax >= ay);
        const F major = select(face_x, qx, select(face_z, qz, qy));
        const F half_per = 0.5f / max(abs(major), splat<F>(1e-20f));
        u = select(face_x, -copysign(splat<F>(1), qx) * qz, select(face_z, copysign(splat<F>(1), qz) * qx, qx));
        v = select(face_x | face_z, qy, -copysign(splat<F>(1), qy) * qz);
        u = u * half_per + 0.5f;
        v = v * half_per + 0.5f;
        // The far rim of a face is its own, not the near rim of the next copy.
        u = min(u, splat<F>(0.99999f));
        v = min(v, splat<F>(0.99999f));
        const float largest = edge[0] > edge[1] ? (edge[0] > edge[2] ? edge[0] : edge[2]) : (edge[1] > edge[2] ? edge[1] : edge[2]);
        du = splat<F>(largest > 0.0f && largest < 1e6f ? 1.0f / largest : 1.0f);
        dv = du;
        cube_face = select(face_x, splat<I>(0), select(face_z, splat<I>(4), splat<I>(2))) + ((major < splat<F>(0)) & splat<I>(1));
    } else {
        u = select(along_x, p.y, p.x);
        v = select(along_z, p.y, p.z);
        const F ex = splat<F>(edge[0] > 0.0f && edge[0] < 1e6f ? 1.0f / edge[0] : 1.0f);
        const F ey = splat<F>(edge[1] > 0.0f && edge[1] < 1e6f ? 1.0f / edge[1] : 1.0f);
        const F ez = splat<F>(edge[2] > 0.0f && edge[2] < 1e6f ? 1.0f / edge[2] : 1.0f);
        if (look.per_metre) {
            // MuJoCo's unit of length for this is 2 m.
            du = splat<F>(0.5f * look.repeat[0]);
            dv = splat<F>(0.5f * look.repeat[1]);
        } else {
            du = select(along_x, ey, ex) * look.repeat[0];
            dv = select(along_z, ey, ez) * look.repeat[1];
        }
        // The first image begins at the corner of least u and greatest v.
        const auto half = [&](int i) { return splat<F>(edge[i] < 1e6f ? 0.5f * edge[i] : 0.0f); };
        u = (u + select(along_x, half(1), half(0))) * du;
        v = (v - select(along_z, half(1), half(2))) * dv;
    }
    const int width = texture.width, height = texture.cube ? texture.width : texture.height;
    // Texels that one pixel covers, across: the finest level that has no more than about one and a half.
    const F length = length_of(s.d), range = s.t * length;
    const F facing = max(abs(dot(s.normal, s.d)) * (1.0f / length), splat<F>(0.15f));
    const F covered = range * pixel_angle_rad * max(du * (float)width, dv * (float)height) / facing * 0.7f;
    I level = shift_right(as<I>(max(covered, splat<F>(1))), 23) - (std::int32_t)126;
    level = select(covered < splat<F>(1), splat<I>(0), level);
    level = select(level > splat<I>(texture.levels - 1), splat<I>(texture.levels - 1), level);
    // What no int holds (a mesh may come with any numbers) would be another texel on another machine.
    u = select(abs(u) < splat<F>(1e6f), u - floor(u), splat<F>(0));
    v = select(abs(v) < splat<F>(1e6f), v - floor(v), splat<F>(0));
    const I one = splat<I>(1), w = shift_right(splat<I>(width), level), h = shift_right(splat<I>(height), level);
    const I column = truncate(u * to_float(w)) & (w - one);
    I row = h - one - (truncate(v * to_float(h)) & (h - one));
    if (texture.cube) row = row + h * cube_face;
    const I zero = splat<I>(0);
    const I at = select(s.mask, look_up(texture.offset, select(s.mask, level, zero)) + texel_at(row, column, splat<I>(__builtin_ctz((unsigned)width)) - level), zero);
    const I packed = gather(texture.texel.data(), at);
    const auto channel = [&](int shift, float tint) {
        const F root = to_float(shift_right(packed, shift) & (std::int32_t)1023);
        return root * root * (decode(tint) * (1.0f / (1023.0f * 1023.0f)));
    };
    return {channel(0, base[0]), channel(10, base[1]), channel(20, base[2])};
}

HIL_INLINE bool convex(Shape shape) { return shape != Shape::kMesh; }

// Whether a ray towards the sun (-z of the sun's camera) from p meets one triangle of a mesh; all in that camera's frame.
HIL_INLINE I meets_triangle(const DrawnGeom &g, std::int32_t triangle, const Vec<F> &p, float near) {
    const float *m = g.m;
    float v[3][3];
    for (int corner = 0; corner < 3; ++corner) {
        const float *from = g.mesh->vertex.data() + 3 * (long)g.mesh->triangle.data()[3 * (long)triangle + corner];
        const float q[3] = {from[0] - g.o[0], from[1] - g.o[1], from[2] - g.o[2]};
        for (int i = 0; i < 3; ++i) v[corner][i] = q[0] * m[i] + q[1] * m[3 + i] + q[2] * m[6 + i];
    }
    const auto side = [&](const float *a, const float *b) { return (p.x - a[0]) * (b[1] - a[1]) - (p.y - a[1]) * (b[0] - a[0]); };
    const F e0 = side(v[0], v[1]), e1 = side(v[1], v[2]), e2 = side(v[2], v[0]), zero = splat<F>(0);
    const I in = ((e0 >= zero) & (e1 >= zero) & (e2 >= zero)) | ((e0 <= zero) & (e1 <= zero) & (e2 <= zero));
    const float ab[3] = {v[1][0] - v[0][0], v[1][1] - v[0][1], v[1][2] - v[0][2]};
    const float ac[3] = {v[2][0] - v[0][0], v[2][1] - v[0][1], v[2][2] - v[0][2]};
    const float n[3] = {ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]};
    if (n[2] == 0.0f) return zero != zero;
    const F z = v[0][2] - ((p.x - v[0][0]) * n[0] + (p.y - v[0][1]) * n[1]) * (1.0f / n[2]);
    return in & (p.z - z > splat<F>(near));
}

// Whether a ray towards the sun meets a primitive.
HIL_INLINE I meets(const DrawnGeom &g, const Vec<F> &p, float near) {
    const float *m = g.m;
    const Vec<F> o{g.o[0] + (p.x * m[0] + p.y * m[1] + p.z * m[2]), g.o[1] + (p.x * m[3] + p.y * m[4] + p.z * m[5]),
                   g.o[2] + (p.x * m[6] + p.y * m[7] + p.z * m[8])};
    const Vec<F> d{splat<F>(-m[2]), splat<F>(-m[5]), splat<F>(-m[8])};
    const F t_min = splat<F>(near), inf = splat<F>(LaneTraits<F>::kInf);
    switch (g.shape) {
        case Shape::kSphere: return ray_sphere(o, d, g.radius, t_min) < inf;
        case Shape::kBox: return ray_box(o, d, g.half, t_min) < inf;
        case Shape::kCapsule: return ray_capsule(o, d, g.radius, g.half[2], t_min) < inf;
        case Shape::kCylinder: return ray_cylinder(o, d, g.radius, g.half[2], t_min) < inf;
        case Shape::kEllipsoid: return ray_ellipsoid(o, d, t_min) < inf;
        default: return inf < inf;
    }
}

struct Caster {
    std::int32_t geom, triangle;  // triangle < 0: all of it
};

HIL_INLINE std::int32_t triangles_of(const DrawnGeom &g) { return (std::int32_t)(g.mesh->triangle.size() / 3); }

// 1 where the sun is seen, 0 where not. The four pixels of the sun's picture around a point decide where they name the
// same geom, and not the point's own mesh; elsewhere the point's own ray is tried against the shapes and triangles that they
// name, so the edge of a shadow is as sharp as the shape, whatever the resolution of the sun's picture.
HIL_INLINE F sunlight(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles, const I &wanted) {
    constexpr int kMost = 64;   // casters asked in one block
    constexpr int kWhole = 32;  // triangles of a mesh that is asked as a whole
    F light = splat<F>(1);
    const float *m = job.camera_to_sun;
    const Vec<F> c{s.d.x * s.t, s.d.y * s.t, s.d.z * s.t};
    const Vec<F> p{job.camera_in_sun[0] + (c.x * m[0] + c.y * m[1] + c.z * m[2]),
                   job.camera_in_sun[1] + (c.x * m[3] + c.y * m[4] + c.z * m[5]),
                   job.camera_in_sun[2] + (c.x * m[6] + c.y * m[7] + c.z * m[8])};
    const bool is_convex = convex(g.shape);
    for (int k = 0; k < job.shadows; ++k) {
        const ShadowMap &map = job.shadow[k];
        const VisibilityBuffer &buffer = *map.buffer;
        const F fx = p.x * map.rays->fx + (map.rays->cx - 0.5f), fy = p.y * map.rays->fy + (map.rays->cy - 0.5f);
        const I inside = wanted & (fx >= splat<F>((float)map.x0)) & (fy >= splat<F>((float)map.y0)) &
                         (fx < splat<F>((float)map.x1)) & (fy < splat<F>((float)map.y1));
        if (!any(inside)) continue;
        const I nowhere = splat<I>(0), column = select(inside, truncate(fx), nowhere), row = select(inside, truncate(fy), nowhere);
        const F limit = p.z - 0.02f;
        // Most points have nothing before them in any of the four.
        I before = nowhere, taps[4];
        for (int tap = 0; tap < 4; ++tap) {
            const I tx = column + (tap & 1), ty = row + (tap >> 1);
            taps[tap] = shift_left(shift_right(ty, 2) * (std::int32_t)buffer.blocks_x + shift_right(tx, 2), 4) +
                        shift_left(ty & 3, 2) + (tx & 3);
            before |= inside & (gather(buffer.t.data(), taps[tap]) < limit);
        }
        unsigned lanes = bits(before);
        if (lanes == 0) continue;
        std::int32_t places[4][16], blocked[16] = {};
        float z[16];
        for (int tap = 0; tap < 4; ++tap) store(places[tap], taps[tap]);
        store(z, limit);
        Caster casters[kMost];
        int count = 0;
        unsigned doubtful = 0;
        for (; lanes != 0; lanes &= lanes - 1) {
            const int lane = __builtin_ctz(lanes);
            int hits = 0;
            bool own = false, one = true;
            Caster found[4];
            for (int tap = 0; tap < 4; ++tap) {
                const long at = places[tap][lane];
                if (!(buffer.t.data()[at] < z[lane])) continue;
                const std::int32_t caster = buffer.geom.data()[at];
                // A convex shape shades no point of itself that faces the sun.
                if (caster < 0 || (caster == g.geom && is_convex)) continue;
                own = own || caster == g.geom;
                found[hits++] = {caster, buffer.triangle.data()[at]};
                one = one && caster == found[0].geom;
            }
            if (hits == 4 && one && !own) {
                blocked[lane] = -1;
            } else if (hits > 0) {
                doubtful |= 1u << lane;
                for (int i = 0; i < hits && count < kMost; ++i) {
                    const DrawnGeom &caster = map.drawn[map.drawn_of_geom[found[i].geom]];
                    if (caster.shape != Shape::kMesh || triangles_of(caster) <= kWhole) found[i].triangle = -1;
                    bool known = false;
                    for (int j = 0; j < count; ++j) {
                        known = known || (casters[j].geom == found[i].geom && casters[j].triangle == found[i].triangle);
                    }
                    if (!known) casters[count++] = found[i];
                }
            }
        }
        I shade = load<I>(blocked);
        if (doubtful != 0) {
            std::int32_t open[16];
            for (int lane = 0; lane < 16; ++lane) open[lane] = doubtful >> lane & 1 ? -1 : 0;
            const I ask = load<I>(open), own_triangle = load<I>(triangles);
            for (int i = 0; i < count; ++i) {
                const DrawnGeom &caster = map.drawn[map.drawn_of_geom[casters[i].geom]];
                if (caster.shape != Shape::kMesh) {
                    shade |= ask & meets(caster, p, 1e-3f);
                    continue;
                }
                const bool whole = casters[i].triangle < 0;
                const std::int32_t from = whole ? 0 : casters[i].triangle, to = whole ? triangles_of(caster) : from + 1;
                for (std::int32_t t = from; t < to; ++t) {
                    I hit = ask & meets_triangle(caster, t, p, 1e-3f);
                    if (casters[i].geom == g.geom) hit &= own_triangle != splat<I>(t);
                    shade |= hit;
                }
            }
        }
        light = select(shade, splat<F>(0), light);
    }
    return light;
}

HIL_INLINE Rgb sky(const Daylight &light, const F &up) {
    const F w = min(max(up, splat<F>(0)), splat<F>(1)), k = w * (2.0f - w);
    const auto mix = [&](int i) { return light.horizon_rgb[i] + k * (light.zenith_rgb[i] - light.horizon_rgb[i]); };
    return {mix(0), mix(1), mix(2)};
}

// What haze leaves of the light of a block, and what the air between adds. Not inlined: in clear air, which is most
// pictures, its registers would be missing elsewhere.
__attribute__((noinline)) void put_haze(const ResolveJob &job, const Vec<F> &d, const F &t, const I &seen, Rgb &c) {
    const Daylight &light = *job.light;
    const F length = length_of(d);
    const F up = (d.x * job.up_C[0] + d.y * job.up_C[1] + d.z * job.up_C[2]) / length;
    const F range = select(seen, t * length, light.haze_m / max(up, splat<F>(1e-3f)));
    const F through = exp_of_minus(range * light.extinction_per_m);
    const auto mixed = [&](const F &x, int i) { return light.air_rgb[i] + through * (x - light.air_rgb[i]); };
    c = {mixed(c.r, 0), mixed(c.g, 1), mixed(c.b, 2)};
}

HIL_INLINE Rgb shade(const ResolveJob &job, const DrawnGeom &g, const Surface &s, const std::int32_t *triangles,
                     const Vec<F> &normal, const F &u, const F &v, bool mesh_uv) {
    const Daylight &light = *job.light;
    const Appearance &look = job.scenery->geoms.data()[g.geom];
    const Rgb c = albedo(g, look, *job.scenery, s, job.pixel_angle_rad, u, v, mesh_uv);
    const F zero = splat<F>(0);
    F sun = normal.x * job.sun_C[0] + normal.y * job.sun_C[1] + normal.z * job.sun_C[2];
    const F up = normal.x * job.up_C[0] + normal.y * job.up_C[1] + normal.z * job.up_C[2];
    // Shadow by the true normal: an interpolated one may face a sun that the surface does not.
    const I faces = s.mask & (s.normal.x * job.sun_C[0] + s.normal.y * job.sun_C[1] + s.normal.z * job.sun_C[2] > zero);
    sun = select(faces, max(sun, zero), zero);
    if (job.shadows > 0 && any(faces)) sun = sun * sunlight(job, g, s, triangles, faces);
    const F above = up * 0.5f + 0.5f;
    const auto lit = [&](const F &a, int i) {
        const F ambient = light.ground_rgb[i] + above * (light.sky_rgb[i] - light.ground_rgb[i]);
        return a * (ambient + sun * light.sun_rgb[i] + look.emission);
    };
    return {lit(c.r, 0), lit(c.g, 1), lit(c.b, 2)};
}

// Writes the lanes of one block to a row-major picture.
template <class T, class V>
HIL_INLINE void put(T *picture, int width, int x, int y, int columns, int rows, const V *lanes) {
    for (int r = 0; r < rows; ++r) {
        T *to = picture + (long)(y + r) * width + x;
        if (columns == 4) {
            for (int c = 0; c < 4; ++c) to[c] = (T)lanes[4 * r + c];
        } else {
            for (int c = 0; c < columns; ++c) to[c] = (T)lanes[4 * r + c];
        }
    }
}

// The same value for all of a block that is four columns wide.
template <class T>
HIL_INLINE void put_one(T *picture, int width, int x, int y, int rows, int value) {
    const T four[4] = {(T)value, (T)value, (T)value, (T)value};
    for (int r = 0; r < rows; ++r) __builtin_memcpy(picture + (long)(y + r) * width + x, four, sizeof four);
}

HIL_INLINE void put3(float *picture, int width, int x, int y, int columns, int rows, const Vec<F> &lanes) {
    float *to = picture + 3 * ((long)y * width + x);
    if (columns == 4 && rows == 4) return store_triples(to, 3L * width, lanes);
    float all[48];
    store_triples(all, 12, lanes);
    for (int r = 0; r < rows; ++r) __builtin_memcpy(to + 3L * r * width, all + 12 * r, 3 * sizeof(float) * (unsigned long)columns);
}

HIL_INLINE void put_rgb(std::uint8_t *picture, int width, int x, int y, int columns, int rows, const I &packed) {
    std::uint8_t *to = picture + 3 * ((long)y * width + x);
    if (columns == 4 && rows == 4) return store_triples(to, 3L * width, packed);
    std::uint8_t all[48];
    store_triples(all, 12, packed);
    for (int r = 0; r < rows; ++r) __builtin_memcpy(to + 3L * r * width, all + 12 * r, (unsigned long)(3 * columns));
}

void resolve(const ResolveJob &job) {
    const VisibilityBuffer &b = *job.buffer;
    const RayTable &rays = *job.rays;
    const ChannelOutputs &out = job.out;
    const F zero = splat<F>(0), inf = splat<F>(LaneTraits<F>::kInf);
    const bool labels = out.segmentation || out.material || out.instance;
    const bool wants_normal = out.normal || out.rgb;
    for (int row = job.row0; row < job.row1; ++row) {
        for (int column = 0; column < b.blocks_x; ++column) {
            const int block = row * b.blocks_x + column, x = 4 * column, y = 4 * row;
            const int columns = b.width - x < 4 ? b.width - x : 4, rows = b.height - y < 4 ? b.height - y : 4;
            const std::int32_t *ids = b.geom.data() + 16 * block;
            const I id = load<I>(ids);
            const F t = load<F>(b.t.data() + 16 * block);
            const I seen = id >= splat<I>(0);
            const Vec<F> d = rays_of(rays, row, column, block);
            if (out.geom) put(out.geom, b.width, x, y, columns, rows, ids);
            if (out.depth) {
                float lanes[16];
                store(lanes, select(seen, rays.projection == Projection::kTable ? t * d.z : t, inf));
                put(out.depth, b.width, x, y, columns, rows, lanes);
            }
            if (out.range) {
                float lanes[16];
                store(lanes, select(seen, t * length_of(d), inf));
                put(out.range, b.width, x, y, columns, rows, lanes);
            }
            if (labels) {
                std::int32_t cls[16], mat[16], ins[16];
                const bool uniform = columns == 4 && !any(id != splat<I>(ids[0]));
                if (uniform) {
                    const bool nothing = ids[0] < 0;
                    const Geom *g = job.geoms + (nothing ? 0 : ids[0]);
                    if (out.segmentation) put_one(out.segmentation, b.width, x, y, rows, nothing ? 0 : g->class_id);
                    if (out.material) put_one(out.material, b.width, x, y, rows, nothing ? 0 : g->surface);
                    if (out.instance) put_one(out.instance, b.width, x, y, rows, nothing ? 0 : g->instance);
                } else {
                    for (int lane = 0; lane < 16; ++lane) {
                        const std::int32_t geom = ids[lane];
                        cls[lane] = geom < 0 ? 0 : job.geoms[geom].class_id;
                        mat[lane] = geom < 0 ? 0 : job.geoms[geom].surface;
                        ins[lane] = geom < 0 ? 0 : job.geoms[geom].instance;
                    }
                }
                if (out.segmentation && !uniform) put(out.segmentation, b.width, x, y, columns, rows, cls);
                if (out.material && !uniform) put(out.material, b.width, x, y, columns, rows, mat);
                if (out.instance && !uniform) put(out.instance, b.width, x, y, columns, rows, ins);
            }
            if (!wants_normal && !out.radial_velocity) continue;
            const F per_length = out.radial_velocity ? 1.0f / length_of(d) : zero;  // one for all geoms of the block
            Vec<F> normals{zero, zero, zero};
            F velocity = zero;
            Rgb colour{zero, zero, zero};
            for (unsigned left = bits(seen); left != 0;) {
                const std::int32_t geom = ids[__builtin_ctz(left)];
                const DrawnGeom &g = job.drawn[job.drawn_of_geom[geom]];
                Surface s;
                s.mask = id == splat<I>(geom);
                left &= ~bits(s.mask);
                s.t = t;
                s.d = d;
                if (out.radial_velocity) {
                    const F along = (d.x * g.velocity_C[0] + d.y * g.velocity_C[1] + d.z * g.velocity_C[2]) * per_length;
                    velocity = select(s.mask, along, velocity);
                }
                if (!wants_normal) continue;
                const float *m = g.m;
                s.local = {g.o[0] + t * (d.x * m[0] + d.y * m[1] + d.z * m[2]),
                           g.o[1] + t * (d.x * m[3] + d.y * m[4] + d.z * m[5]),
                           g.o[2] + t * (d.x * m[6] + d.y * m[7] + d.z * m[8])};
                MeshPoint on_mesh;
                bool mesh_uv = false, smooth = false;
                if (g.shape == Shape::kMesh) {
                    mesh_uv = out.rgb && !g.mesh->uv.empty() && job.scenery->geoms.data()[geom].texture >= 0;
                    smooth = out.rgb && !g.mesh->corner_normal.empty();
                    on_mesh = mesh_point(g, b.triangle.data() + 16 * block, s.mask, s.local, mesh_uv || smooth);
                    s.gradient = on_mesh.flat;
                } else {
                    on_mesh.u = on_mesh.v = zero;
                    s.gradient = gradient(g, s.local);
                }
                const auto into_camera = [&](const Vec<F> &q, bool unit) {
                    // Normals go by the transpose of what points go by, which also undoes an ellipsoid's scaling.
                    const Vec<F> n{q.x * m[0] + q.y * m[3] + q.z * m[6], q.x * m[1] + q.y * m[4] + q.z * m[7],
                                   q.x * m[2] + q.y * m[5] + q.z * m[8]};
                    if (unit) return n;
                    const F scale = 1.0f / length_of(n);
                    return Vec<F>{n.x * scale, n.y * scale, n.z * scale};
                };
                const auto facing = [&](const Vec<F> &n, const I &away) {
                    return Vec<F>{select(away, -n.x, n.x), select(away, -n.y, n.y), select(away, -n.z, n.z)};
                };
                const bool unit = g.shape == Shape::kBox || g.shape == Shape::kPlane || g.shape == Shape::kMesh;
                const Vec<F> outward = into_camera(s.gradient, unit);
                const I away = dot(outward, d) > zero;  // seen from within, or the back of a triangle
                s.normal = facing(outward, away);
                if (out.normal) {
                    normals = {select(s.mask, s.normal.x, normals.x), select(s.mask, s.normal.y, normals.y),
                               select(s.mask, s.normal.z, normals.z)};
                }
                if (!out.rgb) continue;
                Vec<F> shading = s.normal;
                if (smooth) shading = facing(into_camera(on_mesh.smooth, false), away);
                const Rgb c = shade(job, g, s, b.triangle.data() + 16 * block, shading, on_mesh.u, on_mesh.v, mesh_uv);
                colour = {select(s.mask, c.r, colour.r), select(s.mask, c.g, colour.g), select(s.mask, c.b, colour.b)};
            }
            if (out.radial_velocity) {
                float lanes[16];
                store(lanes, velocity);
                put(out.radial_velocity, b.width, x, y, columns, rows, lanes);
            }
            if (out.normal) put3(out.normal, b.width, x, y, columns, rows, normals);
            if (out.rgb) {
                if (bits(seen) != 0xffffu) {
                    const F up = (d.x * job.up_C[0] + d.y * job.up_C[1] + d.z * job.up_C[2]) * (1.0f / length_of(d));
                    const Rgb above = sky(*job.light, up);
                    colour = {select(seen, colour.r, above.r), select(seen, colour.g, above.g), select(seen, colour.b, above.b)};
                }
                if (job.light->extinction_per_m > 0.0f) put_haze(job, d, t, seen, colour);
                put_rgb(out.rgb, b.width, x, y, columns, rows, encode(colour));
            }
        }
    }
}

}  // namespace

extern const ResolveKernels resolve_kernels_of_isa;
const ResolveKernels resolve_kernels_of_isa{resolve};

}  // namespace hil::sim::frame::HIL_ISA
