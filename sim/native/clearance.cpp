#include "clearance.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace hil::sim {
namespace {

constexpr int kLeaf = 4;        // greatest number of shapes in a leaf

double box_distance(const double *local, const double *half) {
    double squared = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double outside = std::fabs(local[j]) - half[j];
        if (outside > 0.0) squared += outside * outside;
    }
    return std::sqrt(squared);
}

double box_distance(const frame::Aabb &box, const double *p) {
    double squared = 0.0;
    for (int j = 0; j < 3; ++j) {
        const double below = box.lo[j] - p[j], above = p[j] - box.hi[j];
        const double outside = below > above ? below : above;
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

// Half edges of the enclosing box along the shape's axes.
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

frame::Aabb bounds_of(const Solid &solid) {
    const auto half = own_half(solid);
    double low[3], high[3];
    for (int i = 0; i < 3; ++i) {
        const double *row = solid.R + 3 * i;
        const double reach =
            (std::fabs(row[0]) * half[0] + std::fabs(row[1]) * half[1]) + std::fabs(row[2]) * half[2];
        // Margin for rounding in `reach`: the box must enclose the shape.
        const double slack = 1e-12 * (std::fabs(solid.center[i]) + reach);
        low[i] = solid.center[i] - reach - slack;
        high[i] = solid.center[i] + reach + slack;
    }
    return frame::outward(low, high);
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
        if (!known(solid))
            throw std::invalid_argument("each solid needs a kind of 0 or 2 to 6 (mjtGeom) and finite numbers");
        (solid.kind == SolidKind::kPlane ? planes_ : solids_).push_back(solid);
    }
    std::vector<frame::Aabb> boxes;
    boxes.reserve(solids_.size());
    for (const Solid &solid : solids_) boxes.push_back(bounds_of(solid));
    const frame::Bvh tree = frame::build_bvh(boxes, kLeaf);
    std::vector<Solid> ordered;
    ordered.reserve(solids_.size());
    for (const std::int32_t i : tree.order) ordered.push_back(solids_[static_cast<std::size_t>(i)]);
    solids_ = std::move(ordered);
    nodes_ = tree.nodes;
}

double SolidTree::distance(const double *p) const {
    double least = std::numeric_limits<double>::infinity();
    for (const Solid &plane : planes_) least = std::min(least, solid_distance(plane, p));
    if (!nodes_.empty()) search(nodes_.front(), p, least);
    return least;
}

void SolidTree::search(const frame::BvhNode &node, const double *p, double &least) const {
    if (!(box_distance(node.box, p) < least)) return;
    if (node.count > 0) {
        for (int i = node.first; i < node.first + node.count; ++i) {
            least = std::min(least, solid_distance(solids_[static_cast<std::size_t>(i)], p));
        }
        return;
    }
    const frame::BvhNode *near = &nodes_[static_cast<std::size_t>(node.first)], *far = near + 1;
    if (box_distance(far->box, p) < box_distance(near->box, p)) std::swap(near, far);
    search(*near, p, least);
    search(*far, p, least);
}

}  // namespace hil::sim
