#include "raster.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "view.hpp"

namespace hil::sim::frame {

HIL_BY_ISA(RasterKernels, raster_kernels, raster_kernels_of_isa)

namespace {

constexpr double kPixelMargin = 0.25;
constexpr std::size_t kFewNodes = 7;  // of a mesh so small that a test of each node costs more than its triangles

void halves(const Aabb &box, double *centre, double *half) {
    for (int i = 0; i < 3; ++i) {
        centre[i] = 0.5 * (static_cast<double>(box.lo[i]) + box.hi[i]);
        half[i] = 0.5 * (static_cast<double>(box.hi[i]) - box.lo[i]);
    }
}

// Returns true if two cones (axis, cosine of the half angle; below -1: all directions) overlap, with a margin of 1e-3.
bool cones_meet(const float *a, const float *b) {
    if (a[3] < -1.0f || b[3] < -1.0f || a[3] + b[3] <= 0.0f) return true;
    const double sine2 = (1.0 - static_cast<double>(a[3]) * a[3]) * (1.0 - static_cast<double>(b[3]) * b[3]);
    const double cosine = static_cast<double>(a[0]) * b[0] + static_cast<double>(a[1]) * b[1] + static_cast<double>(a[2]) * b[2];
    return cosine >= static_cast<double>(a[3]) * b[3] - std::sqrt(std::max(0.0, sine2)) - 1e-3;
}

double distance_to_box(const double *p, const Aabb &box) {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i) {
        const double outside = std::max({box.lo[i] - p[i], p[i] - box.hi[i], 0.0});
        sum += outside * outside;
    }
    return std::sqrt(sum);
}

struct BlockRect {
    int x0, x1, y0, y1;  // ends excluded
    bool empty() const { return x0 >= x1 || y0 >= y1; }
};

double clamped(double x, int lo, int hi) { return x > lo ? (x < hi ? x : hi) : lo; }  // NaN: lo
int floor_to_int(double x) {
    const int i = static_cast<int>(x);
    return i - (i > x ? 1 : 0);
}

// Drawing of one picture, or of one thread's rows of it.
class Pass {
public:
    Pass(const Geometry &geometry, const RasterCamera &camera, const RasterOptions &options, const View &view,
         VisibilityBuffer &buffer, const RayTable &rays, const RasterKernels &kernels, bool plane_clears, Raster::Band &band)
        : geometry_(geometry), camera_(camera), options_(options), view_(view), buffer_(buffer), rays_(rays),
          kernels_(kernels), plane_clears_(plane_clears), row0_(band.row0), row1_(band.row1), drawn_(band.drawn), drawn_of_geom_(band.drawn_of_geom),
          heap_(band.heap), packets_(band.packets), counts_(band.counts) {}

    void run() {
        if (options_.draw_static) {
            for (const auto geom : geometry_.unbounded()) draw_geom(geom);
        }
        heap_.clear();
        if (options_.draw_static && !geometry_.tree().nodes.empty()) push_node(0);
        if (options_.draw_moving) {
            const auto &moving = geometry_.moving();
            for (std::size_t i = 0; i < moving.size(); ++i) {
                constexpr std::size_t kAhead = 8;
                if (i + kAhead < moving.size()) __builtin_prefetch(geometry_.geoms()[static_cast<std::size_t>(moving[i + kAhead])].half);
                if (geometry_.shown(moving[i]) && (options_.moving == nullptr || options_.moving[i] != 0)) push_geom(moving[i]);
            }
        }
        while (!heap_.empty()) {
            std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
            const auto [nearest, item] = heap_.back();
            heap_.pop_back();
            if (options_.occlusion_culling && hidden({0, buffer_.blocks_x, row0_, row1_}, nearest)) break;
            if (item < 0) {
                // Leaves are drawn last: most of those that are hidden are then behind something without holes.
                if (geometry_.geoms()[static_cast<std::size_t>(~item)].mask >= 0) {
                    masked_.push_back(~item);
                } else {
                    draw_geom(~item);
                }
                continue;
            }
            const BvhNode &node = geometry_.tree().nodes[static_cast<std::size_t>(item)];
            if (options_.occlusion_culling && node_hidden(view_, node.box, nearest)) continue;
            if (node.count == 0) {
                push_node(node.first);
                push_node(node.first + 1);
            } else {
                for (std::int32_t i = 0; i < node.count; ++i) {
                    push_geom(geometry_.tree().order[static_cast<std::size_t>(node.first + i)]);
                }
            }
        }
        for (const auto geom : masked_) draw_geom(geom);
    }

private:
    void push(float nearest, std::int32_t item) {
        heap_.emplace_back(nearest, item);
        std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
    }

    void push_node(std::int32_t index) {
        ++counts_.nodes;
        double centre[3], half[3];
        halves(geometry_.tree().nodes[static_cast<std::size_t>(index)].box, centre, half);
        if (options_.frustum_culling && view_.outside(centre, half)) return;
        push(static_cast<float>(view_.nearest(centre, half)), index);
    }

    void push_geom(std::int32_t index) {
        double centre[3], half[3];
        const Geom &g = geometry_.geoms()[static_cast<std::size_t>(index)];
        if (std::isinf(g.half[0]) || std::isinf(g.half[1])) return push(0.0f, ~index);
        halves(geometry_.world_box(index), centre, half);
        if (options_.frustum_culling && view_.outside(centre, half)) return;
        push(static_cast<float>(view_.nearest(centre, half)), ~index);
    }

    BlockRect blocks_of(const PixelRect &r) const {
        const int left = -floor_to_int(-clamped(r.lo_x - 0.5 - kPixelMargin, 0, buffer_.width));
        const int right = floor_to_int(clamped(r.hi_x - 0.5 + kPixelMargin, -1, buffer_.width - 1));
        const int top = -floor_to_int(-clamped(r.lo_y - 0.5 - kPixelMargin, 0, buffer_.height));
        const int bottom = floor_to_int(clamped(r.hi_y - 0.5 + kPixelMargin, -1, buffer_.height - 1));
        if (left > right || top > bottom) return {0, 0, 0, 0};
        return {left / kBlock, right / kBlock + 1, std::max(row0_, top / kBlock), std::min(row1_, bottom / kBlock + 1)};
    }

    bool node_hidden(const View &view, const Aabb &box, float nearest) {
        double centre[3], half[3];
        halves(box, centre, half);
        if (view.projection == Projection::kTable) {
            float cone[4];
            view.cone_of(centre, half, cone);
            return cone_hidden(cone, nearest);
        }
        PixelRect rect;
        if (!view.pixels(centre, half, rect)) return false;
        const BlockRect blocks = blocks_of(rect);
        return blocks.empty() || hidden(blocks, nearest);
    }

    // Returns true if everything drawn in these blocks is nearer.
    bool hidden(const BlockRect &r, float nearest) {
        for (int ty = r.y0 / kTile; ty <= (r.y1 - 1) / kTile; ++ty) {
            for (int tx = r.x0 / kTile; tx <= (r.x1 - 1) / kTile; ++tx) {
                if (nearest > tile_farthest(tx, ty)) continue;
                for (int y = std::max(r.y0, ty * kTile); y < std::min(r.y1, (ty + 1) * kTile); ++y) {
                    const float *row = &buffer_.farthest[static_cast<std::size_t>(y * buffer_.blocks_x)];
                    for (int x = std::max(r.x0, tx * kTile); x < std::min(r.x1, (tx + 1) * kTile); ++x) {
                        if (!(nearest > row[x])) return false;
                    }
                }
            }
        }
        return true;
    }

    // The same for a table of rays, by tiles only.
    bool cone_hidden(const float *cone, float nearest) {
        for (int ty = row0_ / kTile; ty <= (row1_ - 1) / kTile; ++ty) {
            for (int tx = 0; tx < buffer_.tiles_x; ++tx) {
                const float *tile = &rays_.tile_cone[4 * static_cast<std::size_t>(ty * buffer_.tiles_x + tx)];
                if (cones_meet(cone, tile) && !(nearest > tile_farthest(tx, ty))) return false;
            }
        }
        return true;
    }

    float tile_farthest(int tx, int ty) {
        const auto tile = static_cast<std::size_t>(ty * buffer_.tiles_x + tx);
        if (buffer_.tile_stale[tile] != 0) {
            float farthest = -std::numeric_limits<float>::infinity();
            for (int y = std::max(row0_, ty * kTile); y < std::min(row1_, (ty + 1) * kTile); ++y) {
                const float *row = &buffer_.farthest[static_cast<std::size_t>(y * buffer_.blocks_x)];
                for (int x = tx * kTile; x < std::min(buffer_.blocks_x, (tx + 1) * kTile); ++x) {
                    farthest = std::max(farthest, row[x]);
                }
            }
            buffer_.tile_farthest[tile] = farthest;
            buffer_.tile_stale[tile] = 0;
        }
        return buffer_.tile_farthest[tile];
    }

    void draw_geom(std::int32_t index) {
        const Geom &g = geometry_.geoms()[static_cast<std::size_t>(index)];
        const View local = view_.in(g.p_WG, g.R_WG);
        DrawnGeom d{};
        d.geom = index;
        d.shape = g.shape;
        d.cone[3] = -2.0f;
        BlockRect rect{0, buffer_.blocks_x, row0_, row1_};
        double nearest = -1e30;
        if (std::isfinite(g.half[0]) && std::isfinite(g.half[1])) {
            PixelRect pixels;
            const bool bounded = pixels_of_geom(view_, local, g, pixels, nearest);
            if (bounded && options_.frustum_culling) rect = blocks_of(pixels);
            if (rect.empty() || nearest > options_.far_t) return;
            if (bounded && options_.occlusion_culling && hidden(rect, static_cast<float>(nearest))) return;
            if (view_.projection == Projection::kTable && options_.frustum_culling) {
                double centre[3], half[3];
                halves(geometry_.world_box(index), centre, half);
                view_.cone_of(centre, half, d.cone);
                if (options_.occlusion_culling && cone_hidden(d.cone, static_cast<float>(nearest))) return;
            }
        }
        ++counts_.geoms;
        d.x0 = rect.x0, d.x1 = rect.x1, d.y0 = rect.y0, d.y1 = rect.y1;
        // Above the bounds of all boxes around the geom, by more than their rounding.
        const double bound = std::max(-1e30, nearest);
        d.t_min_bound = static_cast<float>(bound + 1e-6 * (1.0 + std::fabs(bound)));
        set_up(g, local, d);
        d.first = plane_clears_ && drawn_.empty();
        const std::int32_t *packets = nullptr;
        std::size_t count = 0;
        if (g.shape == Shape::kMesh) {
            d.mesh = &geometry_.meshes()[static_cast<std::size_t>(g.mesh)];
            if (g.mask >= 0) d.mask = &geometry_.masks()[static_cast<std::size_t>(g.mask)];
            // If the mesh is beyond the reach of the near limit, the camera is outside it and no front is clipped.
            d.backs_hidden = options_.hide_backs && d.mesh->closed &&
                             (view_.projection == Projection::kParallel ||
                              distance_to_box(local.p, d.mesh->box) > 1.001 * view_.near_reach_m + 1e-4);
            const Bvh &tree = d.mesh->packed_tree;
            packets = tree.order.data(), count = tree.order.size();
            if (tree.nodes.size() > kFewNodes && (rect.x1 - rect.x0) * (rect.y1 - rect.y0) > kFewBlocks) {
                packets_.clear();
                collect_packets(*d.mesh, local);
                packets = packets_.data(), count = packets_.size();
            }
            if (count == 0) return;
        }
        constexpr int kMany = 48;  // blocks: the spans of fewer cost more than they save
        if (g.shape == Shape::kBox && options_.frustum_culling && view_.projection == Projection::kPinhole &&
            (rect.x1 - rect.x0) * (rect.y1 - rect.y0) > kMany) {
            d.spans = spans_of_box(g, local, rect);
        }
        drawn_of_geom_[static_cast<std::size_t>(index)] = static_cast<std::int32_t>(drawn_.size());
        drawn_.push_back(d);
        kernels_.draw(d, rays_, buffer_, options_, row0_, row1_, packets, static_cast<int>(count));
    }

    // A long box that the camera is close to touches few of the blocks around it.
    const std::int32_t *spans_of_box(const Geom &g, const View &local, const BlockRect &rect) {
        const auto rows = static_cast<std::size_t>(rect.y1 - rect.y0);
        columns_.assign(rows, {});
        local.spans(g.centre, g.half, kBlock * (rect.y0 + 0.5), kBlock, 0.5 * (kBlock - 1) + kPixelMargin, rect.y1 - rect.y0, columns_.data());
        spans_.resize(2 * rows);
        for (std::size_t i = 0; i < rows; ++i) {
            const BlockRect r = blocks_of({columns_[i].lo, columns_[i].hi, 0.0, static_cast<double>(buffer_.height)});
            spans_[2 * i] = std::max(r.x0, rect.x0);
            spans_[2 * i + 1] = std::min(r.x1, rect.x1);
        }
        return spans_.data();
    }

    void set_up(const Geom &g, const View &local, DrawnGeom &d) const {
        for (int r = 0; r < 3; ++r) {
            const double scale = g.shape == Shape::kEllipsoid ? 1.0 / g.size[r] : 1.0;
            d.o[r] = static_cast<float>(local.p[r] * scale);
            for (int c = 0; c < 3; ++c) d.m[3 * r + c] = static_cast<float>(local.axis[c][r] * scale);
        }
        d.radius = static_cast<float>(g.size[0]);
        for (int i = 0; i < 3; ++i) d.half[i] = static_cast<float>(g.size[i]);
        if (g.shape == Shape::kCapsule || g.shape == Shape::kCylinder) d.half[2] = static_cast<float>(g.size[1]);
        // The velocity at the camera's origin serves for every point of the geom along a ray: w x (t d) has no component
        // along d.
        double v[3];
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            v[i] = g.v_W[i] - camera_.v_W[i] + g.w_W[j] * (camera_.p_WC[k] - g.p_WG[k]) -
                   g.w_W[k] * (camera_.p_WC[j] - g.p_WG[j]);
        }
        for (int c = 0; c < 3; ++c) {
            d.velocity_C[c] = static_cast<float>(camera_.R_WC[c] * v[0] + camera_.R_WC[3 + c] * v[1] + camera_.R_WC[6 + c] * v[2]);
        }
    }

    void collect_packets(const Mesh &mesh, const View &local) {
        // Near child first.
        std::int32_t stack[128];
        int depth = 0;
        stack[depth++] = 0;
        while (depth > 0) {
            const BvhNode &node = mesh.packed_tree.nodes[static_cast<std::size_t>(stack[--depth])];
            double centre[3], half[3];
            halves(node.box, centre, half);
            if (options_.frustum_culling && local.outside(centre, half)) continue;
            if (options_.occlusion_culling &&
                node_hidden(local, node.box, static_cast<float>(local.nearest(centre, half)))) {
                continue;
            }
            if (node.count > 0 || depth + 2 > 128) {
                add_packets(mesh, node);
                continue;
            }
            double near[2];
            for (int child = 0; child < 2; ++child) {
                halves(mesh.packed_tree.nodes[static_cast<std::size_t>(node.first + child)].box, centre, half);
                near[child] = local.nearest(centre, half);
            }
            const int first = near[1] < near[0] ? 1 : 0;
            stack[depth++] = node.first + 1 - first;
            stack[depth++] = node.first + first;
        }
    }

    // The packets below a node are consecutive: from its leftmost leaf to its rightmost.
    void add_packets(const Mesh &mesh, const BvhNode &node) {
        const auto leaf = [&](std::int32_t side) {
            const BvhNode *at = &node;
            while (at->count == 0) at = &mesh.packed_tree.nodes[static_cast<std::size_t>(at->first + side)];
            return at;
        };
        const BvhNode *last = leaf(1);
        const auto order = mesh.packed_tree.order.begin();
        packets_.insert(packets_.end(), order + leaf(0)->first, order + last->first + last->count);
    }

    const Geometry &geometry_;
    const RasterCamera &camera_;
    const RasterOptions &options_;
    const View &view_;
    VisibilityBuffer &buffer_;
    const RayTable &rays_;
    const RasterKernels &kernels_;
    const bool plane_clears_;  // the blocks are not clear: the first plane writes all of them
    const int row0_, row1_;
    std::vector<DrawnGeom> &drawn_;
    std::vector<std::int32_t> &drawn_of_geom_;
    std::vector<std::pair<float, std::int32_t>> &heap_;
    std::vector<std::int32_t> &packets_;
    std::vector<Columns> columns_;
    std::vector<std::int32_t> spans_;
    std::vector<std::int32_t> masked_;  // geoms with holes, nearest first
    RasterCounts &counts_;
};

}  // namespace

void Raster::blank_open(int row, const RasterOptions &options) {
    VisibilityBuffer &b = buffer_;
    for (int x = 0; x < b.blocks_x; ++x) {
        const auto at = static_cast<std::size_t>(row * b.blocks_x + x);
        const bool open = options.open[at] != 0;
        b.farthest[at] = open ? options.far_t : -std::numeric_limits<float>::infinity();
        if (!open) continue;
        std::fill_n(&b.t[16 * at], 16, options.far_t);
        std::fill_n(&b.geom[16 * at], 16, -1);
    }
}

void Raster::clear(const Band &band, const RasterOptions &options, bool by_plane) {
    VisibilityBuffer &b = buffer_;
    const auto blank = [&](int row, int x0, int x1) {
        if (options.open != nullptr) return blank_open(row, options);
        const auto from = static_cast<std::size_t>(row * b.blocks_x + x0), count = static_cast<std::size_t>(x1 - x0);
        std::fill_n(&b.t[16 * from], 16 * count, options.far_t);
        std::fill_n(&b.geom[16 * from], 16 * count, -1);
        std::fill_n(&b.farthest[from], count, options.far_t);
    };
    if (options.sparse && cleared_) {
        for (const DrawnGeom &d : band.drawn) {
            for (int row = d.y0; row < d.y1; ++row) blank(row, d.x0, d.x1);
        }
        return;
    }
    for (int row = band.row0; row < band.row1 && !by_plane; ++row) blank(row, 0, b.blocks_x);
    for (int row = band.row0 / kTile; row <= (band.row1 - 1) / kTile; ++row) {
        std::fill_n(&b.tile_stale[static_cast<std::size_t>(row * b.tiles_x)], b.tiles_x, std::uint8_t{1});
    }
}

// Returns true if an infinite plane is drawn first, and into every block.
bool Raster::plane_clears(const RasterOptions &options) const {
    return options.draw_static && !options.sparse && options.open == nullptr && !geometry_.unbounded().empty();
}

void Raster::draw_band(Band &band, const RasterCamera &camera, const RasterOptions &options) {
    VisibilityBuffer &b = buffer_;
    const bool sees = within_world(camera.p_WC, 3) && within_world(camera.R_WC, 9) && within_world(camera.v_W, 3);
    const bool by_plane = sees && plane_clears(options);
    clear(band, options, by_plane);
    band.drawn.clear();
    band.drawn_of_geom.resize(geometry_.geoms().size());
    band.counts = {};
    if (!sees) return;
    const View seen = view(camera, options, band.row0, band.row1);
    Pass(geometry_, camera, options, seen, b, rays_, raster_kernels(isa_), by_plane, band).run();
}

View Raster::view(const RasterCamera &camera, const RasterOptions &options, int row0, int row1) const {
    return make_view(camera, rays_.projection, fx_, fy_, cx_, cy_, buffer_.width, kBlock * row0,
                     std::min(kBlock * row1, buffer_.height), rays_.cone, options);
}

void Raster::check_rows(int row0, int row1) const {
    if (row0 < 0 || row1 > buffer_.height || row0 >= row1 || row0 % kBlock != 0 ||
        (row1 % kBlock != 0 && row1 != buffer_.height)) {
        throw std::invalid_argument("rows must be within the picture, in multiples of 4");
    }
}

void Raster::draw(const RasterCamera &camera, const RasterOptions &options, int row0, int row1, int threads,
                  const std::function<void(const Band &)> &then) {
    check_rows(row0, row1);
    const int first = row0 / kBlock, last = ceil_div(row1, kBlock);
    // Threads meet at borders of tiles only.
    const int first_tile = first / kTile, tiles = (last - 1) / kTile + 1 - first_tile;
    const int bands = options.sparse ? 1 : std::clamp(threads, 1, tiles);
    bands_.resize(std::max(bands_.size(), static_cast<std::size_t>(bands)));
    for (int i = 0; i < bands; ++i) {
        bands_[static_cast<std::size_t>(i)].row0 = std::max(first, (first_tile + tiles * i / bands) * kTile);
        bands_[static_cast<std::size_t>(i)].row1 = std::min(last, (first_tile + tiles * (i + 1) / bands) * kTile);
    }
    std::vector<std::exception_ptr> failed(static_cast<std::size_t>(bands));
    const auto work = [&](int i) {
        try {
            Band &band = bands_[static_cast<std::size_t>(i)];
            draw_band(band, camera, options);
            if (then) then(band);
        } catch (...) {
            failed[static_cast<std::size_t>(i)] = std::current_exception();
        }
    };
    std::vector<std::thread> others;
    others.reserve(static_cast<std::size_t>(bands));
    for (int i = 1; i < bands; ++i) {
        try {
            others.emplace_back(work, i);
        } catch (const std::system_error &) {
            work(i);  // the system gives no more threads
        }
    }
    work(0);
    for (auto &thread : others) thread.join();
    for (const auto &failure : failed) {
        if (failure) std::rethrow_exception(failure);
    }
    cleared_ = true;
    counts_ = {};
    for (int i = 0; i < bands; ++i) {
        counts_.nodes += bands_[static_cast<std::size_t>(i)].counts.nodes;
        counts_.geoms += bands_[static_cast<std::size_t>(i)].counts.geoms;
    }
}

}  // namespace hil::sim::frame
