// Inner loops of the raster: one geom against the blocks it may touch. Contract: raster.hpp.
#include "alpha_mask.hpp"
#include "raster.hpp"
#include "shapes.hpp"

namespace hil::sim::frame::HIL_ISA {

namespace {

constexpr int kTile = 8;  // blocks

struct Block {
    int index, tile;
    F x, y, z;  // pinhole: direction (x, y, 1); table: direction; parallel: origin (x, y)
};

HIL_INLINE bool cones_meet(const float *a, const float *b) {
    // angle(a, b) <= alpha + beta, with a margin of 1e-3; cones with alpha + beta of a half turn or more always overlap.
    if (a[3] < -1.0f || b[3] < -1.0f || a[3] + b[3] <= 0.0f) return true;
    const float sine2 = (1.0f - a[3] * a[3]) * (1.0f - b[3] * b[3]);
    const float sine = sine2 > 0.0f ? __builtin_sqrtf(sine2) : 0.0f;
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] >= a[3] * b[3] - sine - 1e-3f;
}

// Calls f(block) for each block of the rectangle that is not hidden.
template <Projection P, class Function>
HIL_INLINE void each_block(const DrawnGeom &g, const RayTable &rays, const VisibilityBuffer &buffer, bool occlusion,
                           float nearest, int x0, int x1, int y0, int y1, Function &&f) {
    const float *farthest = buffer.farthest.data();
    for (int row = y0; row < y1; ++row) {
        Block block;
        if constexpr (P != Projection::kTable) block.y = load<F>(rays.y.data() + 16 * row);
        for (int column = x0; column < x1; ++column) {
            block.index = row * buffer.blocks_x + column;
            block.tile = (row / kTile) * buffer.tiles_x + column / kTile;
            if constexpr (P == Projection::kTable) {
                if (column % kTile == 0 || column == x0) {
                    if (!cones_meet(g.cone, rays.tile_cone.data() + 4 * block.tile)) {
                        column |= kTile - 1;
                        continue;
                    }
                }
            }
            if (occlusion && nearest > farthest[block.index]) continue;
            if constexpr (P == Projection::kTable) {
                if (!cones_meet(g.cone, rays.block_cone.data() + 4 * block.index)) continue;
                const float *xyz = rays.xyz.data() + 48 * block.index;
                block.x = load<F>(xyz);
                block.y = load<F>(xyz + 16);
                block.z = load<F>(xyz + 32);
            } else {
                block.x = load<F>(rays.x.data() + 16 * column);
            }
            f(block);
        }
    }
}

HIL_INLINE void note_farthest(VisibilityBuffer &buffer, const Block &block, const F &t) {
    const float farthest = greatest(t);
    if (farthest < buffer.farthest[block.index]) {
        buffer.farthest[block.index] = farthest;
        buffer.tile_stale[block.tile] = 1;
    }
}

// Stores the hits that are nearer than the stored ones, or as near and of a geom with a lower index.
HIL_INLINE void keep(VisibilityBuffer &buffer, const Block &block, const F &t, std::int32_t geom) {
    float *const at = buffer.t.data() + 16 * block.index;
    std::int32_t *const ids = buffer.geom.data() + 16 * block.index;
    const F old = load<F>(at);
    I closer = t < old;
    const I equal = t == old;
    if (any(equal)) closer |= equal & (splat<I>(geom) < load<I>(ids));
    if (!any(closer)) return;
    const F now = select(closer, t, old);
    store(at, now);
    store(ids, select(closer, splat<I>(geom), load<I>(ids)));
    note_farthest(buffer, block, now);
}

// Stores the hits of a block that holds anything; pixels without one see nothing.
HIL_INLINE void begin(VisibilityBuffer &buffer, const Block &block, const F &t, std::int32_t geom, float far_t) {
    const F far = splat<F>(far_t);
    const I hit = t < far;
    const F now = select(hit, t, far);
    store(buffer.t.data() + 16 * block.index, now);
    store(buffer.geom.data() + 16 * block.index, select(hit, splat<I>(geom), splat<I>(-1)));
    buffer.farthest[block.index] = greatest(now);
}

// Origin and direction of a block's rays in the geom's local frame.
template <Projection P>
HIL_INLINE void local_ray(const DrawnGeom &g, const Block &b, Vec<F> &o, Vec<F> &d) {
    const float *m = g.m;
    if constexpr (P == Projection::kPinhole) {
        o = {splat<F>(g.o[0]), splat<F>(g.o[1]), splat<F>(g.o[2])};
        d = {b.x * m[0] + (b.y * m[1] + m[2]), b.x * m[3] + (b.y * m[4] + m[5]), b.x * m[6] + (b.y * m[7] + m[8])};
    } else if constexpr (P == Projection::kTable) {
        o = {splat<F>(g.o[0]), splat<F>(g.o[1]), splat<F>(g.o[2])};
        d = {b.x * m[0] + b.y * m[1] + b.z * m[2], b.x * m[3] + b.y * m[4] + b.z * m[5],
             b.x * m[6] + b.y * m[7] + b.z * m[8]};
    } else {
        o = {g.o[0] + (b.x * m[0] + b.y * m[1]), g.o[1] + (b.x * m[3] + b.y * m[4]), g.o[2] + (b.x * m[6] + b.y * m[7])};
        d = {splat<F>(m[2]), splat<F>(m[5]), splat<F>(m[8])};
    }
}

template <Projection P, Shape S>
void draw_primitive(const DrawnGeom &g, const RayTable &rays, VisibilityBuffer &buffer, const RasterOptions &options,
                    int y0, int y1) {
    const F near = splat<F>(options.near_t);
    const auto draw_block = [&](const Block &block) {
        Vec<F> o, d;
        local_ray<P>(g, block, o, d);
        F t;
        if constexpr (S == Shape::kSphere) t = ray_sphere(o, d, g.radius, near);
        if constexpr (S == Shape::kBox) t = ray_box(o, d, g.half, near);
        if constexpr (S == Shape::kCapsule) t = ray_capsule(o, d, g.radius, g.half[2], near);
        if constexpr (S == Shape::kCylinder) t = ray_cylinder(o, d, g.radius, g.half[2], near);
        if constexpr (S == Shape::kEllipsoid) t = ray_ellipsoid(o, d, near);
        if constexpr (S == Shape::kPlane) t = ray_plane(o, d, g.half, near);
        t = max(splat<F>(g.t_min_bound), t);  // NaN stays, as the second operand of max: no hit
        if (S == Shape::kPlane && g.first) return begin(buffer, block, t, g.geom, options.far_t);
        keep(buffer, block, t, g.geom);
    };
    const std::int32_t *spans = S == Shape::kBox ? g.spans : nullptr;
    for (int row = y0; row < y1; ++row) {
        const int x0 = spans ? spans[2 * (row - g.y0)] : g.x0, x1 = spans ? spans[2 * (row - g.y0) + 1] : g.x1;
        each_block<P>(g, rays, buffer, options.occlusion_culling && !g.first, g.t_min_bound, x0, x1, row, row + 1, draw_block);
    }
}

struct Packet {  // 16 triangles in the camera frame, ready to be drawn one by one
    float edge[3][3][16], n[3][16], volume[16];  // edge functions of each triangle
    std::int32_t x0[16], x1[16], y0[16], y1[16];  // blocks whose pixels they may hold, ends included
    float nearest[16];  // lower bound of t
    float middle[3][16], reach[16];                                    // bounding spheres
};

HIL_INLINE void store3(float (*to)[16], const Vec<F> &v) {
    store(to[0], v.x);
    store(to[1], v.y);
    store(to[2], v.z);
}

// Mask of the triangles that may cover the centre of pixel (left, top) or of its right, lower or diagonal neighbour. The
// limit is far above the rounding of the edge functions. No setting turns this off: a triangle that covers no centre draws
// nothing.
HIL_INLINE I covers_one_of_four(const Vec<F> *e, const RayTable &rays, int width, int height, const F &left, const F &top) {
    const auto farther = [](float a, float b) { return a > b ? a : b; };
    const float step_x = 1.0f / rays.fx, step_y = 1.0f / rays.fy;
    const float far_x = farther(__builtin_fabsf(rays.cx), __builtin_fabsf((float)width - rays.cx)) * step_x;
    const float far_y = farther(__builtin_fabsf(rays.cy), __builtin_fabsf((float)height - rays.cy)) * step_y;
    F limit = splat<F>(0);
    for (int i = 0; i < 3; ++i) limit = limit + (abs(e[i].x) * far_x + abs(e[i].y) * far_y + abs(e[i].z));
    limit = limit * 1e-6f;
    const F x = (left + (0.5f - rays.cx)) * step_x, y = (top + (0.5f - rays.cy)) * step_y;
    I covers = splat<I>(0);
    for (int k = 0; k < 4; ++k) {
        F low = splat<F>(LaneTraits<F>::kInf), high = -low;
        for (int i = 0; i < 3; ++i) {
            const F at = (x + (k & 1 ? step_x : 0.0f)) * e[i].x + (y + (k >> 1 ? step_y : 0.0f)) * e[i].y + e[i].z;
            low = min(low, at);
            high = max(high, at);
        }
        covers |= (low >= -limit) | (high <= limit);
    }
    return covers;
}

// Returns the lanes whose triangle has an area and may cover the centre of a pixel.
template <Projection P>
HIL_INLINE unsigned prepare(const DrawnGeom &g, const RayTable &rays, float near_t, int width, int height,
                            const float *packed, Packet &packet) {
    Vec<F> v[3], low, high;  // bounds relative to the camera, in the frame of the geom
    I some = splat<I>(-1);
    for (int corner = 0; corner < 3; ++corner) {
        const float *from = packed + 48 * corner;
        const F x = load<F>(from) - g.o[0], y = load<F>(from + 16) - g.o[1], z = load<F>(from + 32) - g.o[2];
        if constexpr (P == Projection::kTable) {
            low = corner == 0 ? Vec<F>{x, y, z} : Vec<F>{min(low.x, x), min(low.y, y), min(low.z, z)};
            high = corner == 0 ? Vec<F>{x, y, z} : Vec<F>{max(high.x, x), max(high.y, y), max(high.z, z)};
        }
        v[corner] = {x * g.m[0] + y * g.m[3] + z * g.m[6], x * g.m[1] + y * g.m[4] + z * g.m[7],
                     x * g.m[2] + y * g.m[5] + z * g.m[8]};
    }
    const Vec<F> n = triangle_normal(v[0], v[1], v[2]);
    const F volume = dot(v[0], n), zero = splat<F>(0);
    some &= dot(n, n) > zero;
    if (g.backs_hidden) some &= P == Projection::kParallel ? n.z < zero : volume < zero;
    if (!any(some)) return 0;
    F left{}, right{}, top{}, bottom{};  // pixels that it may cover, ends included
    const F z_low = min(min(v[0].z, v[1].z), v[2].z);
    if constexpr (P == Projection::kTable) {
        const float third = 1.0f / 3.0f;
        const Vec<F> middle{(v[0].x + v[1].x + v[2].x) * third, (v[0].y + v[1].y + v[2].y) * third,
                            (v[0].z + v[1].z + v[2].z) * third};
        F reach2 = splat<F>(0);
        for (const auto &corner : v) {
            const Vec<F> r{corner.x - middle.x, corner.y - middle.y, corner.z - middle.z};
            reach2 = max(reach2, dot(r, r));
        }
        store3(packet.middle, middle);
        store(packet.reach, sqrt(reach2));
        const Vec<F> outside{max(max(low.x, -high.x), zero), max(max(low.y, -high.y), zero), max(max(low.z, -high.z), zero)};
        store(packet.nearest, sqrt(dot(outside, outside)) * 0.99999f);
    } else {
        // A margin of 1/64 pixel covers rays that hit slightly beyond an edge by rounding. A triangle that extends
        // behind the camera is clipped at z = near.
        const float far = 1e9f;
        const F z_near = splat<F>(P == Projection::kParallel ? -far : 0.5f * near_t);
        F low_x = splat<F>(far), high_x = splat<F>(-far), low_y = low_x, high_y = high_x;
        const auto take = [&](const I &counts, const F &x, const F &y, const F &z) {
            const F scale = P == Projection::kParallel ? splat<F>(1) : 1.0f / z;
            const F u = x * scale * rays.fx + rays.cx, w = y * scale * rays.fy + rays.cy;
            low_x = select(counts, min(low_x, u), low_x);
            high_x = select(counts, max(high_x, u), high_x);
            low_y = select(counts, min(low_y, w), low_y);
            high_y = select(counts, max(high_y, w), high_y);
        };
        I front[3];
        for (int i = 0; i < 3; ++i) {
            front[i] = v[i].z > z_near;
            take(front[i], v[i].x, v[i].y, v[i].z);
        }
        if (any(~(front[0] & front[1] & front[2]))) {
            for (int i = 0; i < 3; ++i) {
                const Vec<F> &a = v[i], &b = v[(i + 1) % 3];
                const I crosses = front[i] ^ front[(i + 1) % 3];
                const F s = (z_near - a.z) / (b.z - a.z);
                take(crosses, a.x + s * (b.x - a.x), a.y + s * (b.y - a.y), z_near);
            }
        }
        // Pixels whose centres are inside: ceil(low - 1/2) to floor(high - 1/2), limited to the blocks of the picture.
        const float margin = 1.0f / 64.0f;
        const auto limited = [](const F &x, int most) { return min(max(x, splat<F>(-8.0f)), splat<F>((float)most + 8.0f)); };
        left = floor(limited(low_x - margin, width) + 0.5f), right = floor(limited(high_x + margin, width) - 0.5f);
        top = floor(limited(low_y - margin, height) + 0.5f), bottom = floor(limited(high_y + margin, height) - 0.5f);
        some &= (left <= right) & (top <= bottom);
        if (!any(some)) return 0;
        store(packet.x0, shift_right(truncate(left), 2));
        store(packet.x1, shift_right(truncate(right), 2));
        store(packet.y0, shift_right(truncate(top), 2));
        store(packet.y1, shift_right(truncate(bottom), 2));
        store(packet.nearest, z_low - 1e-5f * abs(z_low));
    }
    // Edge functions (shapes.hpp). For parallel rays: signed areas of (p, vb, vc) etc. in the image plane.
    const auto edge = [](const Vec<F> &b, const Vec<F> &c) {
        return P == Projection::kParallel ? Vec<F>{b.y - c.y, c.x - b.x, b.x * c.y - b.y * c.x} : cross(b, c);
    };
    const Vec<F> e[3] = {edge(v[1], v[2]), edge(v[2], v[0]), edge(v[0], v[1])};
    if constexpr (P != Projection::kTable) {
        const I small = some & (right - left < splat<F>(2)) & (bottom - top < splat<F>(2));
        if (any(small)) {
            some &= ~small | covers_one_of_four(e, rays, width, height, left, top);
            if (!any(some)) return 0;
        }
    }
    for (int i = 0; i < 3; ++i) store3(packet.edge[i], e[i]);
    store3(packet.n, n);
    store(packet.volume, volume);
    return bits(some);
}

// Columns of blocks, ends excluded, of each of 16 rows of blocks.
struct Spans {
    std::int32_t x0[16], x1[16];
};

// A triangle within a rectangle of blocks, ready for `find_spans`.
//
// A pixel counts as inside if the three edge functions e_i = a_i x + b_i y + c_i have no two opposite signs. Rounding is
// less than `error`. If their sum exceeds 4 `error` in all of the rectangle (3, and one for the rounding of the sum itself),
// no pixel there has the opposite sign: `sign` is then the one that can belong to the inside, else 0.
struct SpanEdges {
    float a[3], b[3], c[3], error, far_x, left, right, sign;
};

HIL_INLINE SpanEdges span_edges(const Packet &packet, int lane, const RayTable &rays, int x0, int x1, int row0, int row1) {
    constexpr float kRounding = 1e-6f;  // share of the greatest sum of terms
    SpanEdges s;
    s.left = rays.x.data()[16 * x0], s.right = rays.x.data()[16 * x1 - 1];
    const float top = rays.y.data()[16 * row0], bottom = rays.y.data()[16 * row1 - 1];
    const auto magnitude = [](float a, float b) { return __builtin_fabsf(a) > __builtin_fabsf(b) ? __builtin_fabsf(a) : __builtin_fabsf(b); };
    const float far_y = magnitude(top, bottom);
    s.far_x = magnitude(s.left, s.right);
    float sum[3] = {0, 0, 0}, error = 0.0f;
    for (int i = 0; i < 3; ++i) {
        const auto &e = packet.edge[i];
        s.a[i] = e[0][lane], s.b[i] = e[1][lane], s.c[i] = e[2][lane];
        for (int k = 0; k < 3; ++k) sum[k] += e[k][lane];
        error += __builtin_fabsf(s.a[i]) * s.far_x + __builtin_fabsf(s.b[i]) * far_y + __builtin_fabsf(s.c[i]);
    }
    s.error = error * kRounding;
    const float middle = 0.5f * (sum[0] * (s.left + s.right) + sum[1] * (top + bottom)) + sum[2];
    const float swing = 0.5f * (__builtin_fabsf(sum[0]) * (s.right - s.left) + __builtin_fabsf(sum[1]) * (bottom - top));
    s.sign = !(__builtin_fabsf(middle) - swing > 4.0f * s.error) ? 0.0f : middle > 0.0f ? 1.0f : -1.0f;
    return s;
}

// Finds the columns in which the edge functions may all have `sign`, for block rows `row` and the following: each edge bounds
// x, because on the best line of pixels of a row sign e_i >= -error.
HIL_INLINE void find_spans(const SpanEdges &s, float sign, const RayTable &rays, int x0, int x1, int row, Spans &spans) {
    constexpr float kMargin = 1.0f / 64.0f;  // pixels
    const F first = load<F>(rays.first_y.data() + row), last = load<F>(rays.last_y.data() + row);
    F low = splat<F>(s.left), high = splat<F>(s.right);
    for (int i = 0; i < 3; ++i) {
        const float a = sign * s.a[i], b = sign * s.b[i], c = sign * s.c[i];
        const F rest = max(first * b, last * b) + (c + s.error);
        if (__builtin_fabsf(a) * s.far_x <= s.error) {
            low = select(rest + s.error < splat<F>(0), splat<F>(1e9f), low);
        } else {
            const F bound = rest * (-1.0f / a);
            if (a > 0.0f) low = max(low, bound);
            else high = min(high, bound);
        }
    }
    const auto pixel = [&](const F &x, float margin) { return x * rays.fx + (rays.cx - 0.5f + margin); };
    const auto column = [&](const F &u) { return shift_right(truncate(floor(min(max(u, splat<F>(-8.0f)), splat<F>(65536.0f)))), 2); };
    const I x_first = column(pixel(low, -kMargin)), x_last = column(pixel(high, kMargin)) + (std::int32_t)1;
    const I from = splat<I>(x0), to = splat<I>(x1);
    store(spans.x0, select(x_first > from, x_first, from));
    store(spans.x1, select(x_last < to, x_last, to));
}

// Bounds of a small mesh are a quarter of a pixel wider than the mesh along each axis of the picture, as in view.hpp.
HIL_INLINE float quarter_pixel(const DrawnGeom &g, const RayTable &rays) {
    float far2 = 0.0f;
    for (int i = 0; i < 3; ++i) {
        const float a = __builtin_fabsf(g.mesh->box.lo[i] - g.o[i]), b = __builtin_fabsf(g.mesh->box.hi[i] - g.o[i]);
        far2 += a > b ? a * a : b * b;
    }
    return __builtin_sqrtf(far2) * (0.36f / (rays.fx < rays.fy ? rays.fx : rays.fy) + 1e-5f);
}

// Returns false if no ray passes through the box of a mesh in a pixel where the mesh may be nearest.
HIL_INLINE bool may_show(const DrawnGeom &g, const RayTable &rays, const VisibilityBuffer &buffer, int y0, int y1) {
    const auto inverse = [](const F &d) {
        const F tiny = splat<F>(LaneTraits<F>::kTiny);
        return 1.0f / select(abs(d) < tiny, copysign(tiny, d), d);
    };
    const float pad = quarter_pixel(g, rays);
    float lo[3], hi[3];
    for (int i = 0; i < 3; ++i) lo[i] = g.mesh->box.lo[i] - pad - g.o[i], hi[i] = g.mesh->box.hi[i] + pad - g.o[i];
    for (int row = y0; row < y1; ++row) {
        for (int column = g.x0; column < g.x1; ++column) {
            Block block{};
            block.x = load<F>(rays.x.data() + 16 * column);
            block.y = load<F>(rays.y.data() + 16 * row);
            Vec<F> o, d;
            local_ray<Projection::kPinhole>(g, block, o, d);
            const F per_x = inverse(d.x), per_y = inverse(d.y), per_z = inverse(d.z);
            const F ax = per_x * lo[0], bx = per_x * hi[0], ay = per_y * lo[1], by = per_y * hi[1], az = per_z * lo[2], bz = per_z * hi[2];
            const F enter = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), splat<F>(0)));
            const F leave = min(min(max(ax, bx), max(ay, by)), max(az, bz));
            const F drawn = load<F>(buffer.t.data() + 16 * (row * buffer.blocks_x + column));
            if (any((enter <= leave) & (splat<F>(g.t_min_bound) <= drawn))) return true;
        }
    }
    return false;
}

template <Projection P>
void draw_mesh(const DrawnGeom &g, const RayTable &rays, VisibilityBuffer &buffer, const RasterOptions &options, int y0,
               int y1, const std::int32_t *packets, int packet_count) {
    const F near = splat<F>(options.near_t), inf = splat<F>(LaneTraits<F>::kInf), zero = splat<F>(0);
    const int triangles = (int)(g.mesh->triangle.size() / 3);
    DrawnGeom part = g;  // table: with the cone of one triangle
    Packet packet;
    Spans spans;
    // A ray of each pixel decides for a small mesh: most of what is far away covers no pixel's centre, or is hidden there.
    if (P == Projection::kPinhole && options.frustum_culling && options.occlusion_culling && (g.x1 - g.x0) * (y1 - y0) <= kFewBlocks &&
        !may_show(g, rays, buffer, y0, y1)) {
        return;
    }
    for (int k = 0; k < packet_count; ++k) {
        if (k + 1 < packet_count) {
            const float *next = g.mesh->packed.data() + 144 * (long)packets[k + 1];
            for (int line = 0; line < 9; ++line) __builtin_prefetch(next + 16 * line);
        }
        unsigned alive = prepare<P>(g, rays, options.near_t, buffer.width, buffer.height, g.mesh->packed.data() + 144 * (long)packets[k], packet);
        for (; alive != 0; alive &= alive - 1) {
            const int lane = __builtin_ctz(alive);
            const int triangle = 16 * packets[k] + lane;
            if (triangle >= triangles) break;
            int x0 = g.x0, x1 = g.x1, row0 = y0, row1 = y1;
            const float nearest = packet.nearest[lane] > g.t_min_bound ? packet.nearest[lane] : g.t_min_bound;
            if constexpr (P == Projection::kTable) {
                const float *mx = packet.middle[0], *my = packet.middle[1], *mz = packet.middle[2];
                const float distance2 = mx[lane] * mx[lane] + my[lane] * my[lane] + mz[lane] * mz[lane];
                const float distance = __builtin_sqrtf(distance2), reach = packet.reach[lane] * 1.001f + 1e-4f;
                if (distance > reach) {
                    const float sine = reach / distance;
                    part.cone[0] = mx[lane] / distance;
                    part.cone[1] = my[lane] / distance;
                    part.cone[2] = mz[lane] / distance;
                    part.cone[3] = __builtin_sqrtf(1.0f - sine * sine);
                } else {
                    part.cone[3] = -2.0f;
                }
            } else {
                x0 = x0 > packet.x0[lane] ? x0 : packet.x0[lane];
                x1 = x1 < packet.x1[lane] + 1 ? x1 : packet.x1[lane] + 1;
                row0 = row0 > packet.y0[lane] ? row0 : packet.y0[lane];
                row1 = row1 < packet.y1[lane] + 1 ? row1 : packet.y1[lane] + 1;
            }
            const auto one = [&](const float (*e)[16], const Block &b) {
                if constexpr (P == Projection::kTable) return b.x * e[0][lane] + b.y * e[1][lane] + b.z * e[2][lane];
                else return b.x * e[0][lane] + b.y * e[1][lane] + e[2][lane];
            };
            constexpr int kWorthwhile = 6;  // blocks: the spans of fewer cost more than they save
            const bool narrow = P != Projection::kTable && options.frustum_culling && x1 - x0 > 1 && (x1 - x0) * (row1 - row0) >= kWorthwhile;
            SpanEdges edges;
            if (narrow) edges = span_edges(packet, lane, rays, x0, x1, row0, row1);
            // A triangle that extends behind the camera can have both signs: on either side of its plane's horizon.
            const int turns = narrow && edges.sign == 0.0f ? 2 : 1;
            for (int step = 0; step < turns * (row1 - row0); ++step) {
                const bool again = step >= row1 - row0;
                const int rows = again ? step - (row1 - row0) : step, row = row0 + rows, line = rows % 16;
                int from = x0, to = x1;
                if (narrow && line == 0) find_spans(edges, edges.sign != 0.0f ? edges.sign : again ? -1.0f : 1.0f, rays, x0, x1, row, spans);
                if (narrow) from = spans.x0[line], to = spans.x1[line];
                each_block<P>(part, rays, buffer, options.occlusion_culling, nearest, from, to, row, row + 1, [&](const Block &b) {
                    const F e0 = one(packet.edge[0], b), e1 = one(packet.edge[1], b), e2 = one(packet.edge[2], b);
                    const I in = ((e0 >= zero) & (e1 >= zero) & (e2 >= zero)) | ((e0 <= zero) & (e1 <= zero) & (e2 <= zero));
                    if (!any(in)) return;
                    F over, under;
                    if constexpr (P == Projection::kParallel) {
                        over = packet.volume[lane] - (b.x * packet.n[0][lane] + b.y * packet.n[1][lane]);
                        under = splat<F>(packet.n[2][lane]);
                    } else {
                        over = splat<F>(packet.volume[lane]);
                        under = one(packet.n, b);
                    }
                    const F at = over / under;
                    // A triangle that is long for its distance, or seen edge-on, gets hits before all of its points by
                    // rounding. At its bound they are the same whatever was skipped.
                    const F t = select(in & (under != zero) & (at >= near), max(at, splat<F>(nearest)), inf);
                    float *const ts = buffer.t.data() + 16 * b.index;
                    std::int32_t *const ids = buffer.geom.data() + 16 * b.index;
                    std::int32_t *const parts = buffer.triangle.data() + 16 * b.index;
                    const F old = load<F>(ts);
                    const I geom = splat<I>(g.geom), index = splat<I>(triangle), old_geom = load<I>(ids);
                    I closer = t < old;
                    const I equal = t == old;
                    if (any(equal)) {
                        closer |= equal & ((geom < old_geom) | ((geom == old_geom) & (index < load<I>(parts))));
                    }
                    if (!any(closer)) return;
                    if (g.mask != nullptr) {
                        closer &= opaque(*g.mask, g.mesh->uv.data() + 6 * (long)triangle, e0, e1, e2, closer);
                        if (!any(closer)) return;
                    }
                    const F now = select(closer, t, old);
                    store(ts, now);
                    store(ids, select(closer, geom, old_geom));
                    store(parts, select(closer, index, load<I>(parts)));
                    note_farthest(buffer, b, now);
                });
            }
        }
    }
}

template <Projection P>
void draw_any(const DrawnGeom &g, const RayTable &rays, VisibilityBuffer &buffer, const RasterOptions &options, int y0,
              int y1, const std::int32_t *packets, int packet_count) {
    switch (g.shape) {
        case Shape::kPlane: return draw_primitive<P, Shape::kPlane>(g, rays, buffer, options, y0, y1);
        case Shape::kSphere: return draw_primitive<P, Shape::kSphere>(g, rays, buffer, options, y0, y1);
        case Shape::kCapsule: return draw_primitive<P, Shape::kCapsule>(g, rays, buffer, options, y0, y1);
        case Shape::kEllipsoid: return draw_primitive<P, Shape::kEllipsoid>(g, rays, buffer, options, y0, y1);
        case Shape::kCylinder: return draw_primitive<P, Shape::kCylinder>(g, rays, buffer, options, y0, y1);
        case Shape::kBox: return draw_primitive<P, Shape::kBox>(g, rays, buffer, options, y0, y1);
        case Shape::kMesh: return draw_mesh<P>(g, rays, buffer, options, y0, y1, packets, packet_count);
    }
}

void draw(const DrawnGeom &g, const RayTable &rays, VisibilityBuffer &buffer, const RasterOptions &options, int row0,
          int row1, const std::int32_t *packets, int packet_count) {
    const int y0 = g.y0 > row0 ? g.y0 : row0, y1 = g.y1 < row1 ? g.y1 : row1;
    switch (rays.projection) {
        case Projection::kPinhole:
            return draw_any<Projection::kPinhole>(g, rays, buffer, options, y0, y1, packets, packet_count);
        case Projection::kTable:
            return draw_any<Projection::kTable>(g, rays, buffer, options, y0, y1, packets, packet_count);
        case Projection::kParallel:
            return draw_any<Projection::kParallel>(g, rays, buffer, options, y0, y1, packets, packet_count);
    }
}

}  // namespace

extern const RasterKernels raster_kernels_of_isa;
const RasterKernels raster_kernels_of_isa{draw};

}  // namespace hil::sim::frame::HIL_ISA
