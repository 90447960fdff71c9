#include "clearance.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace hil::sim {
namespace {

constexpr int kLeaf = 4;        // shapes in a leaf at most
constexpr int kStack = 64;      // halving 2^31 shapes needs 31 levels

double box_distance(const double *local, const double *half) {
    double squared = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double outside = std::fabs(local[j]) - half[j];
        if (outside > 0.0) squared += outside * outside;
    }
    return std::sqrt(squared);
}

double solid_distance(const Solid &solid, const double *p) {
    const double d[3] = {p[0] - solid.center[0], p[1] - solid.center[1], p[2] - solid.center[2]};
    const double *R = solid.R, *s = solid.size;
    const double local[3] = {R[0] * d[0] + R[3] * d[1] + R[6] * d[2], R[1] * d[0] + R[4] * d[1] + R[7] * d[2],
                             R[2] * d[0] + R[5] * d[1] + R[8] * d[2]};
    switch (solid.kind) {
        case SolidKind::kPlane:
            return local[2];
        case SolidKind::kSphere:
            return std::sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]) - s[0];
        case SolidKind::kCapsule: {
            const double beyond = std::fabs(local[2]) - s[1];
            const double along = beyond > 0.0 ? beyond : 0.0;
            return std::sqrt((local[0] * local[0] + local[1] * local[1]) + along * along) - s[0];
        }
        case SolidKind::kCylinder: {
            const double across = std::sqrt(local[0] * local[0] + local[1] * local[1]) - s[0];
            const double along = std::fabs(local[2]) - s[1];
            const double a = across > 0.0 ? across : 0.0, b = along > 0.0 ? along : 0.0;
            return std::sqrt(a * a + b * b);
        }
        case SolidKind::kEllipsoid: {
            const double x = local[0] / s[0], y = local[1] / s[1], z = local[2] / s[2];
            const double least = std::min(s[0], std::min(s[1], s[2]));
            return std::max(box_distance(local, s), least * (std::sqrt((x * x + y * y) + z * z) - 1.0));
        }
        case SolidKind::kBox:
            return box_distance(local, s);
    }
    return 0.0;
}

// Half edges of the box, along the shape's own axes, that holds it.
std::array<double, 3> own_half(const Solid &solid) {
    const double *s = solid.size;
    switch (solid.kind) {
        case SolidKind::kSphere:
            return {s[0], s[0], s[0]};
        case SolidKind::kCapsule:
            return {s[0], s[0], s[1] + s[0]};
        case SolidKind::kCylinder:
            return {s[0], s[0], s[1]};
        default:
            return {s[0], s[1], s[2]};
    }
}

std::array<double, 6> bounds_of(const Solid &solid) {
    const auto half = own_half(solid);
    std::array<double, 6> out{};
    for (int i = 0; i < 3; ++i) {
        const double *row = solid.R + 3 * i;
        const double reach =
            (std::fabs(row[0]) * half[0] + std::fabs(row[1]) * half[1]) + std::fabs(row[2]) * half[2];
        // Rounding of the sum above must not let a shape stick out of its box.
        const double slack = 1e-12 * (std::fabs(solid.center[i]) + reach);
        out[i] = solid.center[i] - reach - slack;
        out[3 + i] = solid.center[i] + reach + slack;
    }
    return out;
}

bool known(const Solid &solid) {
    switch (solid.kind) {
        case SolidKind::kPlane:
        case SolidKind::kSphere:
        case SolidKind::kCapsule:
        case SolidKind::kEllipsoid:
        case SolidKind::kCylinder:
        case SolidKind::kBox:
            break;
        default:
            return false;
    }
    double sum = 0.0;
    for (const double v : solid.center) sum += v;
    for (const double v : solid.R) sum += v;
    for (const double v : solid.size) sum += v;
    return std::isfinite(sum);
}

}  // namespace

SolidTree::SolidTree(std::vector<Solid> solids) {
    for (const Solid &solid : solids) {
        if (!known(solid)) throw std::invalid_argument("a solid has an unknown kind or is not finite");
        (solid.kind == SolidKind::kPlane ? planes_ : solids_).push_back(solid);
    }
    std::vector<std::array<double, 6>> bounds;
    bounds.reserve(solids_.size());
    for (const Solid &solid : solids_) bounds.push_back(bounds_of(solid));
    if (!solids_.empty()) build(0, static_cast<int>(solids_.size()), bounds);
}

int SolidTree::build(int first, int last, std::vector<std::array<double, 6>> &bounds) {
    const int index = static_cast<int>(nodes_.size());
    nodes_.push_back({});
    Node node{};
    double least[3], most[3];  // of the centres
    for (int j = 0; j < 3; ++j) {
        node.low[j] = least[j] = std::numeric_limits<double>::infinity();
        node.high[j] = most[j] = -std::numeric_limits<double>::infinity();
        for (int i = first; i < last; ++i) {
            const auto &b = bounds[static_cast<std::size_t>(i)];
            node.low[j] = std::min(node.low[j], b[j]);
            node.high[j] = std::max(node.high[j], b[3 + j]);
            const double middle = b[j] + b[3 + j];
            least[j] = std::min(least[j], middle);
            most[j] = std::max(most[j], middle);
        }
    }
    if (last - first <= kLeaf) {
        node.first = first;
        node.count = last - first;
        nodes_[static_cast<std::size_t>(index)] = node;
        return index;
    }
    int axis = 0;
    for (int j = 1; j < 3; ++j) {
        if (most[j] - least[j] > most[axis] - least[axis]) axis = j;
    }
    // By centre along the longest axis; equal ones keep their order, so that the tree is the same everywhere.
    std::vector<int> order(static_cast<std::size_t>(last - first));
    std::iota(order.begin(), order.end(), first);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        const auto &x = bounds[static_cast<std::size_t>(a)], &y = bounds[static_cast<std::size_t>(b)];
        return x[axis] + x[3 + axis] < y[axis] + y[3 + axis];
    });
    std::vector<Solid> solids;
    std::vector<std::array<double, 6>> boxes;
    solids.reserve(order.size());
    boxes.reserve(order.size());
    for (const int i : order) {
        solids.push_back(solids_[static_cast<std::size_t>(i)]);
        boxes.push_back(bounds[static_cast<std::size_t>(i)]);
    }
    std::copy(solids.begin(), solids.end(), solids_.begin() + first);
    std::copy(boxes.begin(), boxes.end(), bounds.begin() + first);
    const int middle = first + (last - first) / 2;
    build(first, middle, bounds);
    node.first = build(middle, last, bounds);
    node.count = 0;
    nodes_[static_cast<std::size_t>(index)] = node;
    return index;
}

double SolidTree::distance(const double *p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const Solid &plane : planes_) least = std::min(least, solid_distance(plane, p));
    if (nodes_.empty()) return least;
    const auto far = [&](int index) {
        const Node &node = nodes_[static_cast<std::size_t>(index)];
        double squared = 0.0;
        for (int j = 0; j < 3; ++j) {
            const double below = node.low[j] - p[j], above = p[j] - node.high[j];
            const double outside = below > above ? below : above;
            if (outside > 0.0) squared += outside * outside;
        }
        return std::sqrt(squared);
    };
    struct Entry {
        int index;
        double distance;
    } stack[kStack];
    int top = 0;
    stack[top++] = {0, far(0)};
    while (top > 0) {
        const Entry entry = stack[--top];
        if (!(entry.distance < least)) continue;
        const Node &node = nodes_[static_cast<std::size_t>(entry.index)];
        if (node.count > 0) {
            for (int i = node.first; i < node.first + node.count; ++i) {
                least = std::min(least, solid_distance(solids_[static_cast<std::size_t>(i)], p));
            }
            continue;
        }
        Entry near{entry.index + 1, far(entry.index + 1)}, other{node.first, far(node.first)};
        if (other.distance < near.distance) std::swap(near, other);
        stack[top++] = other;
        stack[top++] = near;
    }
    return least;
}

}  // namespace hil::sim
