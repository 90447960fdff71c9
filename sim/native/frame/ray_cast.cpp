#include "ray_cast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <thread>

namespace hil::sim::frame {
namespace {

constexpr std::size_t kLanes = 8;
constexpr std::size_t kRaysPerThread = 512;  // with fewer, a thread costs more than it saves
constexpr int kMostThreads = 64;
constexpr double kDriftedApart = 1.5;  // growth of the moving tree's area at which it is rebuilt

CastGeom cast_geom(const Geom &g, bool shown, const Aabb &box) {
    CastGeom c{};
    std::copy_n(g.p_WG, 3, c.p_WG);
    std::copy_n(g.R_WG, 9, c.R_WG);
    std::copy_n(g.size, 3, c.size);
    if (g.shape == Shape::kEllipsoid) {
        for (int i = 0; i < 3; ++i) c.inverse_size[i] = 1.0 / g.size[i];
    }
    c.mesh = g.mesh;
    c.mask = g.mask;
    c.shape = g.shape;
    c.shown = shown;
    const Aabb outer = padded(box);
    std::copy_n(outer.lo, 3, c.lo);
    std::copy_n(outer.hi, 3, c.hi);
    return c;
}

// Returns the leaves of a mesh's tree as blocks; `tree` and `boxes` receive the same tree with blocks as items.
std::vector<TriangleBlock> blocks_of(const Mesh &mesh, Bvh &tree, std::vector<Aabb> &boxes) {
    std::vector<TriangleBlock> blocks;
    tree = mesh.tree;
    tree.order.clear();
    for (BvhNode &node : tree.nodes) {
        for (std::int32_t first = node.first; node.count > 0 && first < node.first + node.count; first += kWide) {
            TriangleBlock block;
            block.first = first;
            block.count = std::min(node.first + node.count - first, kWide);
            for (int lane = 0; lane < kWide; ++lane) {
                const auto t = static_cast<std::size_t>(first + std::min(lane, block.count - 1));
                for (std::size_t c = 0; c < 3; ++c) {
                    const auto v = static_cast<std::size_t>(mesh.triangle[3 * t + c]);
                    for (std::size_t a = 0; a < 3; ++a) block.corner[c][a][lane] = mesh.vertex[3 * v + a];
                }
            }
            const Aabb outer = padded(node.box);
            std::copy_n(outer.lo, 3, block.lo);
            std::copy_n(outer.hi, 3, block.hi);
            tree.order.push_back(static_cast<std::int32_t>(blocks.size()));
            boxes.push_back(node.box);
            blocks.push_back(block);
        }
        if (node.count > 0) {
            const std::int32_t parts = (node.count + kWide - 1) / kWide;
            node.first = static_cast<std::int32_t>(tree.order.size()) - parts;
            node.count = parts;
        }
    }
    return blocks;
}

bool bounded(const Geom &g) { return !std::isinf(g.half[0]) && !std::isinf(g.half[1]); }

Aabb everywhere() {
    constexpr float kAll = 1e30f;
    return {{-kAll, -kAll, -kAll}, {kAll, kAll, kAll}};
}

const WideNode *root(const WideTree &tree) { return tree.nodes.empty() ? nullptr : tree.nodes.data(); }

// Speed of the surface point p along direction d.
double receding(const Geom &g, const double p[3], const double d[3]) {
    const double r[3] = {p[0] - g.p_WG[0], p[1] - g.p_WG[1], p[2] - g.p_WG[2]};
    const double *w = g.w_W;
    const double v[3] = {g.v_W[0] + (w[1] * r[2] - w[2] * r[1]), g.v_W[1] + (w[2] * r[0] - w[0] * r[2]),
                         g.v_W[2] + (w[0] * r[1] - w[1] * r[0])};
    return (v[0] * d[0] + v[1] * d[1] + v[2] * d[2]) / std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

int entries(const WideTree &tree) { return (kWide - 1) * tree.depth + kWide; }

}  // namespace

CastKernel cast_kernel(Isa isa) {
#if defined(__x86_64__)
    if (isa == Isa::kAvx512) return avx512::cast_packets;
    if (isa == Isa::kAvx2) return avx2::cast_packets;
#endif
    (void)isa;
    return base::cast_packets;
}

RayCaster::RayCaster(const Geometry &geometry) : geometry_(geometry) {
    const std::size_t n = geometry.geoms().size();
    boxes_.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
        boxes_[i] = geometry.world_box(static_cast<int>(i));
        geoms_.push_back(cast_geom(geometry.geoms()[i], geometry.shown(static_cast<int>(i)), boxes_[i]));
    }
    for (const Mesh &mesh : geometry.meshes()) {
        Bvh tree;
        std::vector<Aabb> boxes;
        blocks_.push_back(blocks_of(mesh, tree, boxes));
        mesh_trees_.push_back(widen(tree, boxes));
        CastMesh cast{root(mesh_trees_.back()), blocks_.back().data(),
                      static_cast<std::int32_t>(blocks_.back().size()), {}, {}, mesh.vertex.data(), mesh.triangle.data(),
                      mesh.uv.empty() ? nullptr : mesh.uv.data()};
        const Aabb outer = padded(mesh.box);
        std::copy_n(outer.lo, 3, cast.lo);
        std::copy_n(outer.hi, 3, cast.hi);
        meshes_.push_back(cast);
    }
    fixed_ = widen(geometry.tree(), boxes_);
    refresh();
}

void RayCaster::refresh() {
    if (geometry_.geoms().size() != geoms_.size()) throw std::logic_error("geoms were added after the caster was made");
    if (fresh_ && version_ == geometry_.version()) return;
    const std::vector<std::int32_t> &items = geometry_.moving();
    for (const std::int32_t item : items) {
        const auto i = static_cast<std::size_t>(item);
        const bool shown = geometry_.shown(item);
        const Geom &g = geometry_.geoms()[i];
        boxes_[i] = !shown ? inside_out() : bounded(g) ? geometry_.world_box(item) : everywhere();
        geoms_[i] = cast_geom(g, shown, boxes_[i]);
    }
    // The tree of moving geoms keeps its topology until its boxes have grown. This affects speed, never the result.
    if (!fresh_ || refit(moving_, boxes_) > kDriftedApart * moving_area_) {
        // A hidden geom is put where it was last: it may be shown again there.
        std::vector<Aabb> boxes, last_boxes = boxes_;
        for (const std::int32_t item : items) {
            const auto i = static_cast<std::size_t>(item);
            if (!geometry_.shown(item) && bounded(geometry_.geoms()[i])) last_boxes[i] = geometry_.world_box(item);
            boxes.push_back(last_boxes[i]);
        }
        Bvh tree = build_bvh(boxes, 2);
        for (auto &item : tree.order) item = items[static_cast<std::size_t>(item)];
        moving_ = widen(tree, boxes_);
        moving_area_ = refit(moving_, last_boxes);
        refit(moving_, boxes_);
    }
    version_ = geometry_.version();
    fresh_ = true;
}

CastScene RayCaster::scene() const {
    int mesh_entries = 0;
    for (const WideTree &tree : mesh_trees_) mesh_entries = std::max(mesh_entries, entries(tree));
    return {root(fixed_),
            root(moving_),
            geometry_.unbounded().data(),
            geoms_.data(),
            meshes_.data(),
            geometry_.masks().data(),
            static_cast<std::int32_t>(geometry_.unbounded().size()),
            static_cast<std::int32_t>(geoms_.size()),
            std::max(entries(fixed_), entries(moving_)) + mesh_entries};
}

void RayCaster::cast(const double *origin, bool one_origin, const double *direction, std::size_t count, double t_min,
                     double t_max, const CastSkips &skips, const std::int32_t *order, int threads, Isa isa,
                     const CastOutput &out) const {
    if (count == 0) return;
    std::vector<std::int32_t> sorted;
    if (order == nullptr) {
        sorted.resize(count);
        coherent_order(direction, count, sorted.data());
        order = sorted.data();
    }
    if (std::isnan(t_min) || std::isnan(t_max)) t_min = 1.0, t_max = 0.0;
    const CastScene all = scene();
    const RayBatch rays{origin, one_origin, direction, order, t_min, t_max, skips, out.range, out.geom, out.normal};
    const CastKernel kernel = cast_kernel(isa);
    const auto work = [&](std::size_t begin, std::size_t end) {
        std::vector<StackEntry> stack(static_cast<std::size_t>(all.stack_entries));
        kernel(all, rays, begin, end, stack.data());
        if (out.radial_velocity == nullptr) return;
        for (std::size_t at = begin; at < end; ++at) {
            const auto i = static_cast<std::size_t>(order[at]);
            out.radial_velocity[i] = std::numeric_limits<double>::quiet_NaN();
            if (out.geom[i] < 0) continue;
            const double *o = origin + (one_origin ? 0 : 3 * i), *d = direction + 3 * i;
            double p[3];
            for (int a = 0; a < 3; ++a) p[a] = o[a] + out.range[i] * d[a];
            out.radial_velocity[i] = receding(geometry_.geoms()[static_cast<std::size_t>(out.geom[i])], p, d);
        }
    };
    const std::size_t useful = std::max<std::size_t>(1, count / kRaysPerThread);
    const auto wanted = static_cast<std::size_t>(std::clamp(threads, 1, kMostThreads));
    const std::size_t workers = std::min(wanted, useful);
    if (workers == 1) return work(0, count);
    const std::size_t share = ((count + workers - 1) / workers + kLanes - 1) / kLanes * kLanes;
    std::vector<std::thread> running;
    running.reserve(workers);
    for (std::size_t begin = share; begin < count; begin += share) {
        const std::size_t end = std::min(count, begin + share);
        try {
            running.emplace_back(work, begin, end);
        } catch (const std::system_error &) {
            work(begin, end);  // the system gives no more threads
        }
    }
    work(0, std::min(count, share));
    for (std::thread &thread : running) thread.join();
}

void coherent_order(const double *direction, std::size_t count, std::int32_t *order) {
    // Six faces of 64 x 64 cells of about 1.4 degrees.
    constexpr int kBits = 6, kSide = 1 << kBits;
    constexpr std::size_t kCells = 6 * kSide * kSide + 1;
    static const auto spread = [] {
        std::vector<std::uint16_t> s(kSide);
        for (unsigned i = 0; i < kSide; ++i)
            for (unsigned b = 0; b < kBits; ++b) s[i] = static_cast<std::uint16_t>(s[i] | (((i >> b) & 1u) << (2 * b)));
        return s;
    }();
    std::vector<std::int32_t> start(kCells + 1, 0);
    std::vector<std::uint16_t> cell(count);
    for (std::size_t i = 0; i < count; ++i) {
        const double *d = direction + 3 * i;
        const double ax = std::fabs(d[0]), ay = std::fabs(d[1]), az = std::fabs(d[2]);
        const int axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
        const double major = d[axis], size = std::fabs(major);
        std::size_t key = kCells - 1;
        if (size > 0.0 && size < std::numeric_limits<double>::infinity()) {
            const double scale = 0.5 * kSide / size;
            const double u = d[(axis + 1) % 3] * scale + 0.5 * kSide, v = d[(axis + 2) % 3] * scale + 0.5 * kSide;
            if (u >= 0.0 && v >= 0.0 && u <= kSide && v <= kSide) {
                const auto a = static_cast<std::size_t>(std::min(u, kSide - 1.0));
                const auto b = static_cast<std::size_t>(std::min(v, kSide - 1.0));
                const std::size_t face = 2 * static_cast<std::size_t>(axis) + (major < 0.0 ? 1 : 0);
                key = face * kSide * kSide + (spread[a] | static_cast<std::size_t>(spread[b]) << 1);
            }
        }
        cell[i] = static_cast<std::uint16_t>(key);
        ++start[key + 1];
    }
    for (std::size_t k = 1; k <= kCells; ++k) start[k] += start[k - 1];
    for (std::size_t i = 0; i < count; ++i) order[start[cell[i]]++] = static_cast<std::int32_t>(i);
}

}  // namespace hil::sim::frame
