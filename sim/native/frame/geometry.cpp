#include "geometry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <stdexcept>

namespace hil::sim::frame {

namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr int kTrianglesPerLeaf = 8;
constexpr int kPacketsPerLeaf = 4;  // a test of a node costs about as much as the triangles of a packet
constexpr int kGeomsPerLeaf = 2;
constexpr double kFarthest = 1e7;  // [m]

void local_box(Geom &g, const std::vector<Mesh> &meshes) {
    const double *s = g.size;
    std::fill(g.centre, g.centre + 3, 0.0);
    const auto half = [&](double x, double y, double z) {
        g.half[0] = x, g.half[1] = y, g.half[2] = z;
    };
    switch (g.shape) {
        case Shape::kPlane: {
            // The kernels' rule: a half length that is not above 0 in float, or is kFarthest or more, is infinite.
            const auto edge = [](double size) {
                return static_cast<float>(size) > 0.0f && size < kFarthest ? size : kInf;
            };
            half(edge(s[0]), edge(s[1]), 0.0);
            break;
        }
        case Shape::kSphere: half(s[0], s[0], s[0]); break;
        case Shape::kCapsule: half(s[0], s[0], s[1] + s[0]); break;
        case Shape::kCylinder: half(s[0], s[0], s[1]); break;
        case Shape::kEllipsoid:
        case Shape::kBox: half(s[0], s[1], s[2]); break;
        case Shape::kMesh: {
            const Aabb &box = meshes[static_cast<std::size_t>(g.mesh)].box;
            for (int i = 0; i < 3; ++i) {
                g.centre[i] = 0.5 * (static_cast<double>(box.lo[i]) + box.hi[i]);
                g.half[i] = 0.5 * (static_cast<double>(box.hi[i]) - box.lo[i]);
            }
            break;
        }
    }
}

void pack(Mesh &mesh) {
    constexpr std::size_t kLanes = 16;
    const std::size_t triangles = mesh.triangle.size() / 3, packets = (triangles + kLanes - 1) / kLanes;
    mesh.packed.resize(packets * 9 * kLanes);
    std::vector<Aabb> boxes(packets);
    for (std::size_t packet = 0; packet < packets; ++packet) {
        Aabb &box = boxes[packet];
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
            const std::size_t t = std::min(packet * kLanes + lane, triangles - 1);
            for (std::size_t corner = 0; corner < 3; ++corner) {
                const float *v = &mesh.vertex[3 * static_cast<std::size_t>(mesh.triangle[3 * t + corner])];
                for (std::size_t i = 0; i < 3; ++i) {
                    mesh.packed[((packet * 3 + corner) * 3 + i) * kLanes + lane] = v[i];
                    const bool first = lane == 0 && corner == 0;
                    box.lo[i] = first ? v[i] : std::min(box.lo[i], v[i]);
                    box.hi[i] = first ? v[i] : std::max(box.hi[i], v[i]);
                }
            }
        }
    }
    mesh.packed_tree = build_bvh(boxes, kPacketsPerLeaf);
    mesh.facet.resize(triangles);
    double surface = 0.0, image = 0.0;
    for (std::size_t t = 0; t < triangles; ++t) {
        double v[3][3];
        for (std::size_t corner = 0; corner < 3; ++corner) {
            const float *from = &mesh.vertex[3 * static_cast<std::size_t>(mesh.triangle[3 * t + corner])];
            std::copy_n(from, 3, v[corner]);
        }
        double n[3];
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            n[i] = (v[1][j] - v[0][j]) * (v[2][k] - v[0][k]) - (v[1][k] - v[0][k]) * (v[2][j] - v[0][j]);
        }
        const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        surface += length;
        // b and c of p = a + b (B - a) + c (C - a): grad b = (C - a) x n / (n . n), grad c = n x (B - a) / (n . n).
        double gradient[2][3] = {};
        for (int i = 0; i < 3 && length > 0.0; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            gradient[0][i] = ((v[2][j] - v[0][j]) * n[k] - (v[2][k] - v[0][k]) * n[j]) / (length * length);
            gradient[1][i] = (n[j] * (v[1][k] - v[0][k]) - n[k] * (v[1][j] - v[0][j])) / (length * length);
        }
        // The value that is from[0], from[stride] and from[2 stride] at the corners.
        const auto interpolated = [&](const float *from, std::size_t stride, float *to) {
            double start = from[0];
            for (int i = 0; i < 3; ++i) {
                const double slope = gradient[0][i] * (static_cast<double>(from[stride]) - from[0]) +
                                     gradient[1][i] * (static_cast<double>(from[2 * stride]) - from[0]);
                start -= slope * v[0][i];
                to[i] = static_cast<float>(slope);
            }
            to[3] = static_cast<float>(start);
        };
        Facet &facet = mesh.facet[t];
        double offset = 0.0;
        for (int i = 0; i < 3 && length > 0.0; ++i) {
            facet.normal[i] = static_cast<float>(n[i] / length);
            offset -= n[i] / length * v[0][i];
        }
        facet.normal[3] = static_cast<float>(offset);
        if (!mesh.uv.empty()) {
            interpolated(&mesh.uv[6 * t], 2, facet.u);
            interpolated(&mesh.uv[6 * t + 1], 2, facet.v);
        }
        for (std::size_t i = 0; i < 3 && !mesh.corner_normal.empty(); ++i) interpolated(&mesh.corner_normal[9 * t + i], 3, facet.smooth[i]);
        if (!mesh.uv.empty()) {
            const float *uv = &mesh.uv[6 * t];
            image += std::fabs((uv[2] - uv[0]) * (uv[5] - uv[1]) - (uv[3] - uv[1]) * (uv[4] - uv[0]));
        }
    }
    if (triangles > 0) mesh.edge_m = static_cast<float>(std::sqrt(surface / static_cast<double>(triangles)));
    if (surface > 0.0 && image > 0.0) mesh.uv_per_m = static_cast<float>(std::sqrt(image / surface));
}

// Fills mesh.face.
void group_faces(Mesh &mesh) {
    constexpr double kSameNormal = 1e-6, kSameTexture = 1e-4;  // greatest differences, of components and of coordinates
    const std::size_t triangles = mesh.triangle.size() / 3;
    mesh.face.resize(triangles);
    std::iota(mesh.face.begin(), mesh.face.end(), 0);
    if (!mesh.corner_normal.empty()) return;
    const auto corner = [&](std::size_t t, std::size_t c) { return &mesh.vertex[3 * static_cast<std::size_t>(mesh.triangle[3 * t + c])]; };
    const auto mapped = [](const float *row, const float *p) {
        return static_cast<double>(row[0]) * p[0] + static_cast<double>(row[1]) * p[1] + static_cast<double>(row[2]) * p[2] + row[3];
    };
    const auto same = [&](std::size_t t, std::size_t of) {
        for (std::size_t i = 0; i < 3; ++i) {
            if (!(std::fabs(mesh.facet[t].normal[i] - mesh.facet[of].normal[i]) <= kSameNormal)) return false;
        }
        for (std::size_t c = 0; c < 3 && !mesh.uv.empty(); ++c) {
            const float *uv = &mesh.uv[6 * t + 2 * c], *p = corner(t, c);
            if (!(std::fabs(mapped(mesh.facet[of].u, p) - uv[0]) <= kSameTexture)) return false;
            if (!(std::fabs(mapped(mesh.facet[of].v, p) - uv[1]) <= kSameTexture)) return false;
        }
        return true;
    };
    std::vector<std::pair<float, std::int32_t>> largest;  // the square of an edge, negative, stands for the size
    for (std::size_t t = 0; t < triangles; ++t) {
        double least = kInf;
        for (std::size_t c = 0; c < 3; ++c) {
            double square = 0.0;
            for (std::size_t k = 0; k < 3; ++k) {
                const double step = static_cast<double>(corner(t, c)[k]) - corner(t, (c + 1) % 3)[k];
                square += step * step;
            }
            least = std::min(least, square);
        }
        largest.emplace_back(static_cast<float>(-least), static_cast<std::int32_t>(t));
    }
    std::sort(largest.begin(), largest.end());
    std::map<std::array<std::int32_t, 3>, std::vector<std::int32_t>> faces;  // by direction
    for (const auto &[size, triangle] : largest) {
        const auto t = static_cast<std::size_t>(triangle);
        const auto rounded = [&](std::size_t i) { return static_cast<std::int32_t>(std::lround(16.0 * mesh.facet[t].normal[i])); };
        std::vector<std::int32_t> &known = faces[{rounded(0), rounded(1), rounded(2)}];
        constexpr std::size_t kMost = 64;  // compared, so that a mesh of many faces takes no longer
        const std::size_t first = known.size() > kMost ? known.size() - kMost : 0;
        const auto found = std::find_if(known.begin() + static_cast<std::ptrdiff_t>(first), known.end(),
                                        [&](std::int32_t of) { return same(t, static_cast<std::size_t>(of)); });
        if (found != known.end()) {
            mesh.face[t] = *found;
        } else {
            known.push_back(triangle);
        }
    }
}

bool is_closed(const Mesh &mesh) {
    // Corners at the same position are one corner, also if the file repeats it.
    std::map<std::array<float, 3>, std::int32_t> places;
    std::vector<std::int32_t> corner(mesh.triangle.size());
    for (std::size_t i = 0; i < corner.size(); ++i) {
        const float *v = &mesh.vertex[3 * static_cast<std::size_t>(mesh.triangle[i])];
        corner[i] = places.try_emplace({v[0] + 0.0f, v[1] + 0.0f, v[2] + 0.0f}, static_cast<std::int32_t>(places.size())).first->second;
    }
    std::vector<std::int32_t> parent(places.size());  // union-find over connected corners
    std::iota(parent.begin(), parent.end(), 0);
    const auto root = [&](std::int32_t i) {
        while (parent[static_cast<std::size_t>(i)] != i) {
            auto &p = parent[static_cast<std::size_t>(i)];
            i = p = parent[static_cast<std::size_t>(p)];
        }
        return i;
    };
    std::vector<std::pair<std::int32_t, std::int32_t>> edges, reversed;
    for (std::size_t t = 0; t < corner.size(); t += 3) {
        for (std::size_t k = 0; k < 3; ++k) {
            const std::int32_t a = corner[t + k], b = corner[t + (k + 1) % 3];
            if (a == b) return false;
            edges.emplace_back(a, b);
            reversed.emplace_back(b, a);
            parent[static_cast<std::size_t>(root(a))] = root(b);
        }
    }
    std::sort(edges.begin(), edges.end());
    std::sort(reversed.begin(), reversed.end());
    if (edges != reversed || std::adjacent_find(edges.begin(), edges.end()) != edges.end()) return false;
    std::map<std::int32_t, double> volume;  // six times the volume of each connected part
    for (std::size_t t = 0; t < corner.size(); t += 3) {
        const float *v[3];
        for (std::size_t k = 0; k < 3; ++k) v[k] = &mesh.vertex[3 * static_cast<std::size_t>(mesh.triangle[t + k])];
        double &sum = volume[root(corner[t])];
        for (int i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            sum += static_cast<double>(v[0][i]) * (static_cast<double>(v[1][j]) * v[2][k] - static_cast<double>(v[1][k]) * v[2][j]);
        }
    }
    return std::all_of(volume.begin(), volume.end(), [](const auto &part) { return part.second > 0.0; });
}

bool usable_size(const Geom &g) {
    const double *s = g.size;
    switch (g.shape) {
        case Shape::kPlane: return !std::isnan(s[0]) && !std::isnan(s[1]);
        case Shape::kSphere: return within_world(s, 1) && s[0] > 0.0;
        case Shape::kCapsule:
        case Shape::kCylinder: return within_world(s, 2) && s[0] > 0.0 && s[1] >= 0.0;
        case Shape::kEllipsoid:
        case Shape::kBox: return within_world(s, 3) && s[0] > 0.0 && s[1] > 0.0 && s[2] > 0.0;
        case Shape::kMesh: return true;
    }
    return false;
}

}  // namespace

bool within_world(const double *x, int n) {
    for (int i = 0; i < n; ++i)
        if (!(std::fabs(x[i]) < kFarthest)) return false;
    return true;
}

int Geometry::add_mesh(const float *vertex, std::size_t vertices, const std::int32_t *triangle,
                       std::size_t triangles, const float *uv, const float *corner_normal) {
    if (finished_) throw std::invalid_argument("the geometry is finished: nothing can be added");
    Mesh mesh;
    mesh.vertex.assign(vertex, vertex + 3 * vertices);
    std::vector<Aabb> boxes;
    for (std::size_t t = 0; t < triangles; ++t) {
        double lo[3] = {kInf, kInf, kInf}, hi[3] = {-kInf, -kInf, -kInf};
        bool good = true;
        for (int corner = 0; corner < 3; ++corner) {
            const std::int32_t v = triangle[3 * t + static_cast<std::size_t>(corner)];
            if (v < 0 || static_cast<std::size_t>(v) >= vertices) {
                throw std::invalid_argument("a triangle names a vertex index that the mesh does not have");
            }
            for (int i = 0; i < 3; ++i) {
                const double x = vertex[3 * v + i];
                good = good && std::fabs(x) < kFarthest;
                lo[i] = std::min(lo[i], x);
                hi[i] = std::max(hi[i], x);
            }
        }
        if (!good) continue;  // drop a triangle with a vertex that is not finite or too far away
        for (std::size_t k = 0; k < 3; ++k) mesh.triangle.push_back(triangle[3 * t + k]);
        if (uv != nullptr) mesh.uv.insert(mesh.uv.end(), uv + 6 * t, uv + 6 * t + 6);
        if (corner_normal != nullptr) {
            mesh.corner_normal.insert(mesh.corner_normal.end(), corner_normal + 9 * t, corner_normal + 9 * t + 9);
        }
        boxes.push_back(outward(lo, hi));
    }
    mesh.tree = build_bvh(boxes, kTrianglesPerLeaf);
    mesh.box = boxes.empty() ? Aabb{{0, 0, 0}, {0, 0, 0}} : mesh.tree.nodes[0].box;
    // Store triangles in the order of the leaves, so that those drawn together are contiguous.
    Mesh sorted = mesh;
    for (std::size_t i = 0; i < mesh.tree.order.size(); ++i) {
        const auto from = static_cast<std::size_t>(mesh.tree.order[i]);
        std::copy_n(&mesh.triangle[3 * from], 3, &sorted.triangle[3 * i]);
        if (!mesh.uv.empty()) std::copy_n(&mesh.uv[6 * from], 6, &sorted.uv[6 * i]);
        if (!mesh.corner_normal.empty()) std::copy_n(&mesh.corner_normal[9 * from], 9, &sorted.corner_normal[9 * i]);
        sorted.tree.order[i] = static_cast<std::int32_t>(i);
    }
    pack(sorted);
    group_faces(sorted);
    sorted.closed = is_closed(sorted);
    meshes_.push_back(std::move(sorted));
    return static_cast<int>(meshes_.size()) - 1;
}

int Geometry::add_mask(const std::uint8_t *opaque, std::size_t height, std::size_t width) {
    if (finished_) throw std::invalid_argument("the geometry is finished: nothing can be added");
    const auto usable = [](std::size_t n) { return n >= 4 && n <= 4096 && (n & (n - 1)) == 0; };
    if (!usable(width) || !usable(height)) throw std::invalid_argument("edges of a mask must be powers of two, 4 to 4096");
    AlphaMask mask;
    mask.width = static_cast<int>(width);
    mask.height = static_cast<int>(height);
    std::vector<std::uint32_t> words((width * height + 31) / 32);
    for (std::size_t i = 0; i < width * height; ++i) words[i / 32] |= (opaque[i] != 0 ? 1u : 0u) << i % 32;
    mask.opaque.assign(words.begin(), words.end());
    masks_.push_back(std::move(mask));
    return static_cast<int>(masks_.size()) - 1;
}

int Geometry::add_geom(const Geom &geom) {
    if (finished_) throw std::invalid_argument("the geometry is finished: nothing can be added");
    Geom g = geom;
    if (g.shape == Shape::kMesh && (g.mesh < 0 || static_cast<std::size_t>(g.mesh) >= meshes_.size())) {
        throw std::invalid_argument("a geom names a mesh index that does not exist: add meshes first");
    }
    if (g.mask >= 0) {
        if (static_cast<std::size_t>(g.mask) >= masks_.size()) {
            throw std::invalid_argument("a geom names a mask index that does not exist: add masks first");
        }
        if (g.shape != Shape::kMesh || meshes_[static_cast<std::size_t>(g.mesh)].uv.empty()) {
            throw std::invalid_argument("a geom with a mask must be a mesh with texture coordinates");
        }
    }
    if (!usable_size(g) || (g.shape == Shape::kMesh && meshes_[static_cast<std::size_t>(g.mesh)].triangle.empty())) {
        g.visible = false;
    }
    local_box(g, meshes_);
    std::fill(g.v_W, g.v_W + 3, 0.0);
    std::fill(g.w_W, g.w_W + 3, 0.0);
    geoms_.push_back(g);
    boxes_.push_back({});
    shown_.push_back(0);
    const int index = static_cast<int>(geoms_.size()) - 1;
    place(index);
    return index;
}

void Geometry::finish() {
    finished_ = true;
    std::vector<Aabb> boxes;
    std::vector<std::int32_t> items;
    unbounded_.clear();
    moving_.clear();
    for (std::size_t i = 0; i < geoms_.size(); ++i) {
        const Geom &g = geoms_[i];
        if (!g.visible) continue;
        const auto index = static_cast<std::int32_t>(i);
        if (g.moving) {
            moving_.push_back(index);
        } else if (shown_[i] != 0) {
            if (std::isinf(g.half[0]) || std::isinf(g.half[1])) {
                unbounded_.push_back(index);
            } else {
                items.push_back(index);
                boxes.push_back(boxes_[i]);
            }
        }
    }
    tree_ = build_bvh(boxes, kGeomsPerLeaf);
    for (auto &item : tree_.order) item = items[static_cast<std::size_t>(item)];
}

void Geometry::move(int index, const double *p_WG, const double *R_WG, const double *v_W, const double *w_W) {
    Geom &g = moving_geom(index);
    std::copy_n(p_WG, 3, g.p_WG);
    std::copy_n(R_WG, 9, g.R_WG);
    std::copy_n(v_W, 3, g.v_W);
    std::copy_n(w_W, 3, g.w_W);
    place(index);
    ++version_;
}

Geom &Geometry::moving_geom(int index) {
    Geom &g = geoms_.at(static_cast<std::size_t>(index));
    if (!g.moving) throw std::invalid_argument("this geom is static: add it with moving=True to move or hide it");
    return g;
}

void Geometry::hide(int index) {
    moving_geom(index);
    shown_[static_cast<std::size_t>(index)] = 0;
    ++version_;
}

void Geometry::place(int index) {
    const auto i = static_cast<std::size_t>(index);
    const Geom &g = geoms_[i];
    shown_[i] = g.visible && within_world(g.p_WG, 3) && within_world(g.R_WG, 9) && within_world(g.v_W, 3) && within_world(g.w_W, 3);
    if (!shown_[i] || std::isinf(g.half[0]) || std::isinf(g.half[1])) return;
    double lo[3], hi[3];
    for (int r = 0; r < 3; ++r) {
        const double *row = g.R_WG + 3 * r;
        const double middle = g.p_WG[r] + row[0] * g.centre[0] + row[1] * g.centre[1] + row[2] * g.centre[2];
        const double reach =
            std::fabs(row[0]) * g.half[0] + std::fabs(row[1]) * g.half[1] + std::fabs(row[2]) * g.half[2];
        lo[r] = middle - reach;
        hi[r] = middle + reach;
    }
    boxes_[i] = outward(lo, hi);
}

}  // namespace hil::sim::frame
