// Lower bound of the gap between a sphere and the static scene, from a tree of its solid shapes. All in W [m].
//
// The bound is the exact distance for planes, boxes, spheres, capsules and cylinders; for an ellipsoid with radii r the
// greater of the distance to its box and min(r) (|p / r| - 1), since |x| >= min(r) |x / r|. Meshes and height fields
// are given as boxes that enclose them. Inside a shape the distance is 0 or less.
//
// A node of the tree is an axis-aligned box. Nodes farther than the nearest shape so far are skipped, so the cost grows
// with the logarithm of the number of shapes. Queries are const and do not allocate.
// Deterministic: + - * / sqrt and comparisons; the minimum does not depend on the order of the search.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "frame/bvh.hpp"

namespace hil::sim {

// Numbers of mjtGeom.
enum class SolidKind : int { kPlane = 0, kSphere = 2, kCapsule = 3, kEllipsoid = 4, kCylinder = 5, kBox = 6 };

struct Solid {
    SolidKind kind;
    double center[3];
    double R[9];     // columns are the shape's axes in W, row-major
    double size[3];  // as in MJCF: radii and half lengths
};

class SolidTree {
  public:
    // Throws std::invalid_argument for a shape of another kind, or one that is not finite.
    explicit SolidTree(std::vector<Solid> solids);
    // Distance from a point to the nearest shape; infinity without shapes.
    double distance(const double *p_W) const;
    std::size_t size() const { return planes_.size() + solids_.size(); }

  private:
    void search(const frame::BvhNode &node, const double *p, double &least) const;
    std::vector<Solid> planes_, solids_;  // the latter leaf by leaf
    std::vector<frame::BvhNode> nodes_;
};

// A contact may be reported slightly before shapes touch (MuJoCo's convex collision: 1e-6 m).
constexpr double kClearanceSlack_m = 1e-5;

inline double clearance(const double *p_W, double radius_m, const SolidTree &solids) {
    return solids.distance(p_W) - radius_m - kClearanceSlack_m;
}

}  // namespace hil::sim
