// Ray casting through the trees of a scene, eight rays at once. Contract: ray_cast.hpp.
#include "alpha_mask.hpp"
#include "beam.hpp"
#include "ray_cast.hpp"
#include "shapes.hpp"
#include "surface_normal.hpp"
#include "triples.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

constexpr double kBeyond = 1e30;     // stands for an infinite t: finite, so that its product with 0 is 0
constexpr double kFarthest = 1e7;    // as in geometry.cpp
constexpr int kFewBlocks = 16;       // a mesh with so few blocks is tested without its tree
constexpr double kLaneNumber[kLanes] = {0, 1, 2, 3, 4, 5, 6, 7};
constexpr int kTogether = 8;         // packets that traverse the trees of the scene as one beam

// Eight rays and their nearest hits so far.
struct Packet {
    Vec<D> o, d, inverse;  // 1 / d
    D t_min;
    D t, geom, part;  // geom and part are integers: ties are decided by comparing them
    double far;       // no hit beyond it can be the nearest of any ray
};

HIL_INLINE Beam beam_of(const Packet *const *packets, int count, double t_min) {
    const Packet &a = *packets[0];
    Span o[3]{only(a.o.x), only(a.o.y), only(a.o.z)}, d[3]{only(a.d.x), only(a.d.y), only(a.d.z)};
    for (int i = 1; i < count; ++i) {
        const Packet &p = *packets[i];
        o[0] = both(o[0], p.o.x), o[1] = both(o[1], p.o.y), o[2] = both(o[2], p.o.z);
        d[0] = both(d[0], p.d.x), d[1] = both(d[1], p.d.y), d[2] = both(d[2], p.d.z);
    }
    Beam b;
    b.both_ways = 0;
    for (int axis = 0; axis < 3; ++axis) bound(o[axis], d[axis], axis, b);
    b.t_min = t_min;
    return b;
}

// Replaces the hits that are farther, or as far and of a higher number; returns true if any was replaced.
HIL_INLINE bool take(Packet &p, const D &t, double geom, double part) {
    if (!any(t <= p.t)) return false;
    const D g = splat<D>(geom), k = splat<D>(part);
    const auto first = (g < p.geom) | ((g == p.geom) & (k < p.part));
    const auto better = (t < splat<D>(kInf)) & ((t < p.t) | ((t == p.t) & first));
    if (!any(better)) return false;
    p.t = select(better, t, p.t);
    p.geom = select(better, g, p.geom);
    p.part = select(better, k, p.part);
    return true;
}

HIL_INLINE Vec<D> into(const double *R, const Vec<D> &v) {
    return {v.x * R[0] + v.y * R[3] + v.z * R[6], v.x * R[1] + v.y * R[4] + v.z * R[7],
            v.x * R[2] + v.y * R[5] + v.z * R[8]};
}

// The interval of each ray within a box.
HIL_INLINE Interval<D> within(const Vec<D> &o, const Vec<D> &inverse, const float *lo, const float *hi) {
    const D ax = ((double)lo[0] - o.x) * inverse.x, bx = ((double)hi[0] - o.x) * inverse.x;
    const D ay = ((double)lo[1] - o.y) * inverse.y, by = ((double)hi[1] - o.y) * inverse.y;
    const D az = ((double)lo[2] - o.z) * inverse.z, bz = ((double)hi[2] - o.z) * inverse.z;
    return {max(max(min(ax, bx), min(ay, by)), min(az, bz)), min(min(max(ax, bx), max(ay, by)), max(az, bz))};
}

HIL_INLINE D inverse_of(const D &d) {
    const D tiny = splat<D>(LaneTraits<D>::kTiny);
    return 1.0 / select(abs(d) < tiny, copysign(tiny, d), d);
}

// Rays of a packet in the frame of a mesh, and their nearest hits.
struct Lanes {
    double o[3][kLanes], d[3][kLanes];
    double t[kLanes], geom[kLanes], part[kLanes];
};

// Holes of one geom's mesh.
struct Holes {
    const AlphaMask *mask;  // null: none
    const float *uv;
};

// Removes the hits in holes. Lane i hits the triangle first + i * step, whose corners relative to the ray are `v`.
HIL_NOINLINE void remove_holes(const Holes &holes, const Vec<D> *v, const Vec<D> &d, long first, long step, D &t) {
    double e[3][kLanes], at[kLanes];
    store(e[0], dot(cross(v[1], v[2]), d)), store(e[1], dot(cross(v[2], v[0]), d)), store(e[2], dot(cross(v[0], v[1]), d));
    store(at, t);
    for (int i = 0; i < kLanes; ++i) {
        if (at[i] < kInf && !opaque_at(*holes.mask, holes.uv + 6 * (first + i * step), e[0][i], e[1][i], e[2][i])) at[i] = kInf;
    }
    t = load<D>(at);
}

// Intersects one ray with eight triangles; returns true if a hit is nearer than before.
HIL_INLINE bool meet_block(const TriangleBlock &block, const Holes &holes, double index, double t_min, int lane, Lanes &rays) {
    Vec<D> v[3];
    for (int c = 0; c < 3; ++c) {
        v[c] = {load_floats(block.corner[c][0]) - rays.o[0][lane], load_floats(block.corner[c][1]) - rays.o[1][lane],
                load_floats(block.corner[c][2]) - rays.o[2][lane]};
    }
    const Vec<D> d{splat<D>(rays.d[0][lane]), splat<D>(rays.d[1][lane]), splat<D>(rays.d[2][lane])};
    D t = ray_triangle(v[0], v[1], v[2], d, splat<D>(t_min));
    const auto nearer = t <= splat<D>(rays.t[lane]);
    if (!any(nearer)) return false;
    if (holes.mask != nullptr) {
        // Lanes beyond the last triangle repeat it, so that they read no texture coordinates behind the end.
        t = select(nearer & (splat<D>(block.count) > load<D>(kLaneNumber)), t, splat<D>(kInf));
        remove_holes(holes, v, d, block.first, 1, t);
    }
    const double nearest = smallest(t);
    if (!(nearest < kInf)) return false;
    const int place = __builtin_ctz(bits(t == splat<D>(nearest)));
    const double part = block.first + (place < block.count ? place : block.count - 1);
    const bool first = index < rays.geom[lane] || (index == rays.geom[lane] && part < rays.part[lane]);
    if (nearest == rays.t[lane] && !first) return false;
    rays.t[lane] = nearest;
    rays.geom[lane] = index;
    rays.part[lane] = part;
    return true;
}

// Intersects all rays of a packet with the triangles of a block, one by one; returns true if any hit is nearer than
// before. The result has the same bits as that of `meet_block`.
HIL_INLINE bool meet_triangles(const TriangleBlock &block, const Holes &holes, double index, const Vec<D> &o, const Vec<D> &d,
                               const D &t_min, Packet &p) {
    bool met = false;
    for (int i = 0; i < block.count; ++i) {
        Vec<D> v[3];
        for (int c = 0; c < 3; ++c) {
            v[c] = {(double)block.corner[c][0][i] - o.x, (double)block.corner[c][1][i] - o.y,
                    (double)block.corner[c][2][i] - o.z};
        }
        D t = ray_triangle(v[0], v[1], v[2], d, t_min);
        if (holes.mask != nullptr) {
            const auto nearer = t <= p.t;
            if (!any(nearer)) continue;
            t = select(nearer, t, splat<D>(kInf));
            remove_holes(holes, v, d, block.first + i, 0, t);
        }
        met |= take(p, t, index, (double)(block.first + i));
    }
    return met;
}

// Intersects the rays that enter a block's box with its triangles; returns true if any hit is nearer than before.
HIL_INLINE bool enter_block(const TriangleBlock &block, const Holes &holes, double index, const Vec<D> &o, const Vec<D> &d,
                            const Vec<D> &inverse, double t_min, Lanes &rays, Packet &p) {
    const Interval<D> in = within(o, inverse, block.lo, block.hi);
    unsigned entering = bits((in.enter <= in.leave) & (in.leave >= p.t_min) & (in.enter <= p.t));
    if (entering == 0) return false;
    // Loop over the smaller of the two sets, rays or triangles.
    if (block.count <= __builtin_popcount(entering)) return meet_triangles(block, holes, index, o, d, p.t_min, p);
    store(rays.t, p.t), store(rays.geom, p.geom), store(rays.part, p.part);
    bool met = false;
    for (; entering != 0; entering &= entering - 1)
        met |= meet_block(block, holes, index, t_min, __builtin_ctz(entering), rays);
    if (met) p.t = load<D>(rays.t), p.geom = load<D>(rays.geom), p.part = load<D>(rays.part);
    return met;
}

HIL_NOINLINE void meet_mesh(const CastMesh &mesh, const AlphaMask *mask, double index, const Vec<D> &o, const Vec<D> &d,
                                         bool tree, StackEntry *stack, Packet &p, double t_min) {
    const Holes holes{mask, mesh.uv};
    const Vec<D> inverse{inverse_of(d.x), inverse_of(d.y), inverse_of(d.z)};
    const Interval<D> box = within(o, inverse, mesh.lo, mesh.hi);
    // Rays that miss the mesh's box neither widen the beam nor delay its end.
    const auto concerned = (box.enter <= box.leave) & (box.leave >= p.t_min) & (box.enter <= p.t);
    const unsigned active = tree ? bits(concerned) : (1u << kLanes) - 1;
    if (active == 0) return;
    Lanes rays;
    store(rays.o[0], o.x), store(rays.o[1], o.y), store(rays.o[2], o.z);
    store(rays.d[0], d.x), store(rays.d[1], d.y), store(rays.d[2], d.z);
    if (!tree) {
        store(rays.t, p.t), store(rays.geom, p.geom), store(rays.part, p.part);
        for (int lane = 0; lane < kLanes; ++lane)
            for (std::int32_t i = 0; i < mesh.block_count; ++i) meet_block(mesh.blocks[i], holes, index, t_min, lane, rays);
        p.t = load<D>(rays.t), p.geom = load<D>(rays.geom), p.part = load<D>(rays.part);
    } else if (mesh.block_count <= kFewBlocks) {
        for (std::int32_t i = 0; i < mesh.block_count; ++i)
            enter_block(mesh.blocks[i], holes, index, o, d, inverse, t_min, rays, p);
    } else {
        double any_ray[6];
        const int any_lane = __builtin_ctz(active);
        for (int a = 0; a < 3; ++a) any_ray[a] = rays.o[a][any_lane], any_ray[3 + a] = rays.d[a][any_lane];
        const auto only = [&](const D &v, double other) { return select(concerned, v, splat<D>(other)); };
        const Vec<D> from{only(o.x, any_ray[0]), only(o.y, any_ray[1]), only(o.z, any_ray[2])};
        const Vec<D> to{only(d.x, any_ray[3]), only(d.y, any_ray[4]), only(d.z, any_ray[5])};
        const Beam beam = beam_of(from, to, t_min);
        double mesh_far;
        const auto renew = [&] {
            mesh_far = largest(select(concerned, min(p.t, box.leave), splat<D>(-1.0)));
        };
        renew();
        walk(mesh.nodes, beam, stack, mesh_far, [&](std::int32_t i, double, StackEntry *) {
            if (enter_block(mesh.blocks[i], holes, index, o, d, inverse, t_min, rays, p)) renew();
        });
    }
    p.far = smaller(largest(p.t), kBeyond);
}

// Returns false if no ray of the packet enters the geom's box before its nearest hit.
HIL_INLINE bool may_meet(const Packet &p, const CastGeom &g) {
    const Interval<D> box = within(p.o, p.inverse, g.lo, g.hi);
    return any((box.enter <= box.leave) & (box.leave >= p.t_min) & (box.enter <= p.t));
}

HIL_INLINE void meet_geom(const CastScene &scene, std::int32_t index, bool tree, StackEntry *stack, Packet &p,
                          double t_min) {
    const CastGeom &g = scene.geoms[index];
    const Vec<D> from{p.o.x - g.p_WG[0], p.o.y - g.p_WG[1], p.o.z - g.p_WG[2]};
    D t;
    if (g.shape == Shape::kSphere) {
        t = ray_sphere(from, p.d, g.size[0], p.t_min);
    } else {
        const Vec<D> o = into(g.R_WG, from), d = into(g.R_WG, p.d);
        switch (g.shape) {
            case Shape::kBox: t = ray_box(o, d, g.size, p.t_min); break;
            case Shape::kCapsule: t = ray_capsule(o, d, g.size[0], g.size[1], p.t_min); break;
            case Shape::kCylinder: t = ray_cylinder(o, d, g.size[0], g.size[1], p.t_min); break;
            case Shape::kPlane: t = ray_plane(o, d, g.size, p.t_min); break;
            case Shape::kEllipsoid: {
                const double *k = g.inverse_size;
                t = ray_ellipsoid(Vec<D>{o.x * k[0], o.y * k[1], o.z * k[2]},
                                  Vec<D>{d.x * k[0], d.y * k[1], d.z * k[2]}, p.t_min);
                break;
            }
            case Shape::kMesh:
                meet_mesh(scene.meshes[g.mesh], g.mask < 0 ? nullptr : scene.masks + g.mask, (double)index, o, d, tree, stack, p, t_min);
                return;
            default: return;
        }
    }
    if (take(p, t, (double)index, -1.0)) p.far = smaller(largest(p.t), kBeyond);
}

// meet_geom as a function call, where inlining would only add another compiled copy.
HIL_NOINLINE void meet_listed(const CastScene &scene, std::int32_t index, bool tree, StackEntry *stack, Packet &p,
                              double t_min) {
    meet_geom(scene, index, tree, stack, p, t_min);
}

// Column `axis` of eight rows, assembled in registers.
HIL_INLINE D column(const double *const *row, int axis) {
    D v;
    for (int i = 0; i < kParts; ++i) {
        const double *const *r = row + i * (kRegisterBytes / 8);
#if defined(__AVX512F__)
        v.r[i] = (DoubleRegister){r[0][axis], r[1][axis], r[2][axis], r[3][axis],
                                  r[4][axis], r[5][axis], r[6][axis], r[7][axis]};
#elif defined(__AVX2__)
        v.r[i] = (DoubleRegister){r[0][axis], r[1][axis], r[2][axis], r[3][axis]};
#else
        v.r[i] = (DoubleRegister){r[0][axis], r[1][axis]};
#endif
    }
    return v;
}
HIL_INLINE Vec<D> rows(const double *from, const std::int32_t *ray, bool in_a_row) {
    if (in_a_row) return load_rows(from + 3 * (std::size_t)ray[0]);
    const double *row[kLanes];
    for (int i = 0; i < kLanes; ++i) row[i] = from + 3 * (std::size_t)ray[i];
    return {column(row, 0), column(row, 1), column(row, 2)};
}

// Mask of the rays that can be cast: finite, with a direction and an origin within kFarthest.
HIL_INLINE MaskOf<D> usable(const Vec<D> &o, const Vec<D> &d) {
    const D world = splat<D>(kFarthest), longest = splat<D>(1e6);
    return (abs(o.x) < world) & (abs(o.y) < world) & (abs(o.z) < world) & (abs(d.x) < longest) &
           (abs(d.y) < longest) & (abs(d.z) < longest) & (dot(d, d) > splat<D>(1e-12));
}

// Rays at eight positions of the order; positions from `count` on repeat the first.
struct Places {
    std::int32_t ray[kLanes];
    int count;
    bool in_a_row;  // the rays are contiguous in memory
};

// Loads up to eight rays; returns false if none of them can be cast. Rays that cannot be cast hit nothing.
HIL_INLINE bool load_packet(const RayBatch &rays, const Places &places, double t_min, Packet &p) {
    p.d = rows(rays.direction, places.ray, places.in_a_row);
    if (rays.one_origin) {
        p.o = {splat<D>(rays.origin[0]), splat<D>(rays.origin[1]), splat<D>(rays.origin[2])};
    } else {
        p.o = rows(rays.origin, places.ray, places.in_a_row);
    }
    const auto good = usable(p.o, p.d);
    const unsigned valid = bits(good);
    if (valid != 0 && valid != (1u << kLanes) - 1) {
        // A lane without a ray copies another ray and takes no hits.
        const int other = __builtin_ctz(valid);
        const auto lane = [&](D v) {
            double x[kLanes];
            store(x, v);
            return select(good, v, splat<D>(x[other]));
        };
        p.o = {lane(p.o.x), lane(p.o.y), lane(p.o.z)};
        p.d = {lane(p.d.x), lane(p.d.y), lane(p.d.z)};
    }
    p.inverse = {inverse_of(p.d.x), inverse_of(p.d.y), inverse_of(p.d.z)};
    p.t_min = splat<D>(t_min);
    p.geom = p.part = splat<D>(kInf);
    p.t = select(good, splat<D>(rays.skips.max_range ? rays.t_max : kInf), splat<D>(-kInf));
    p.far = smaller(largest(p.t), kBeyond);
    return valid != 0 && t_min <= rays.t_max;
}

HIL_INLINE void write(const CastScene &scene, const RayBatch &rays, const Places &places, const Packet &p) {
    const auto hit = (p.geom < splat<D>(kInf)) & (p.t <= splat<D>(rays.t_max));
    double t[kLanes], geom[kLanes];
    store(t, select(hit, p.t, splat<D>(kInf)));
    store(geom, select(hit, p.geom, splat<D>(-1.0)));
    for (int i = 0; i < places.count; ++i) {
        rays.range[places.ray[i]] = t[i];
        rays.geom[places.ray[i]] = (std::int32_t)geom[i];
    }
    if (rays.normal == nullptr) return;
    const Vec<D> normal = surface_normals(scene, hit, p.geom, p.part, p.o, p.d, p.t);
    if (places.in_a_row) return store_rows(rays.normal + 3 * (std::size_t)places.ray[0], normal);
    double row[3 * kLanes];
    store_rows(row, normal);
    for (int i = 0; i < places.count; ++i)
        for (int a = 0; a < 3; ++a) rays.normal[3 * (std::size_t)places.ray[i] + a] = row[3 * i + a];
}

// Intersects these packets with the geoms that their common beam reaches.
HIL_INLINE void meet_scene(const CastScene &scene, Packet *const *packets, int count, bool tree, double t_min,
                           StackEntry *stack) {
    if (!tree) {
        for (std::int32_t i = 0; i < scene.geom_count; ++i)
            for (int k = 0; k < count && scene.geoms[i].shown; ++k) meet_listed(scene, i, false, stack, *packets[k], t_min);
        return;
    }
    double far;
    const auto meet = [&](std::int32_t geom, double near, StackEntry *free) {
        far = -kInf;
        for (int k = 0; k < count; ++k) {
            Packet &p = *packets[k];
            if (near <= p.far && may_meet(p, scene.geoms[geom])) meet_geom(scene, geom, true, free, p, t_min);
            far = larger(far, p.far);
        }
    };
    for (std::int32_t i = 0; i < scene.unbounded_count; ++i)
        for (int k = 0; k < count; ++k) meet_listed(scene, scene.unbounded[i], true, stack, *packets[k], t_min);
    far = packets[0]->far;
    for (int k = 1; k < count; ++k) far = larger(far, packets[k]->far);
    const Beam beam = beam_of(packets, count, t_min);
    const WideNode *const trees[2] = {scene.fixed, scene.moving};
    for (const WideNode *nodes : trees) {
        if (nodes != nullptr) walk(nodes, beam, stack, far, meet);
    }
}

}  // namespace

void cast_packets(const CastScene &scene, const RayBatch &rays, std::size_t begin, std::size_t end,
                  StackEntry *stack) {
    const double t_min = rays.t_min > 0.0 ? rays.t_min : 0.0;
    while (begin < end) {
        Packet packets[kTogether], *casting[kTogether];
        Places places[kTogether];
        int count = 0, cast = 0;
        for (; count < kTogether && begin < end; ++count) {
            Places &at = places[count];
            at.count = end - begin < (std::size_t)kLanes ? (int)(end - begin) : kLanes;
            for (int i = 0; i < kLanes; ++i) at.ray[i] = rays.order[begin + (std::size_t)(i < at.count ? i : 0)];
            at.in_a_row = true;
            for (int i = 1; i < kLanes; ++i) at.in_a_row &= at.ray[i] == at.ray[0] + i;
            begin += (std::size_t)at.count;
            if (load_packet(rays, at, t_min, packets[count])) casting[cast++] = &packets[count];
        }
        if (cast > 0) meet_scene(scene, casting, cast, rays.skips.tree, t_min, stack);
        for (int k = 0; k < count; ++k) write(scene, rays, places[k], packets[k]);
    }
}

}  // namespace hil::sim::frame::HIL_ISA
