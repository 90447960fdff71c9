// Bounding volume hierarchy over axis-aligned boxes: a binary tree, children side by side, built top-down by the
// surface area heuristic over 16 bins (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007).
//
// The build is a function of the boxes alone: ties go to the lower index, nothing depends on addresses or threads.
#pragma once

#include <cstdint>
#include <vector>

namespace hil::sim::frame {

struct Aabb {
    float lo[3], hi[3];
};

// Half the surface of a box; 0 for an empty one.
inline float half_area(const Aabb &box) {
    const float x = box.hi[0] - box.lo[0], y = box.hi[1] - box.lo[1], z = box.hi[2] - box.lo[2];
    return x < 0.0f ? 0.0f : x * y + y * z + z * x;
}

// Box in float, rounded outward so that it contains the box [lo, hi] in double.
Aabb outward(const double *lo, const double *hi);

struct BvhNode {
    Aabb box;
    std::int32_t first;  // leaf: position in `order`; else left child, the right one follows it
    std::int32_t count;  // leaf: number of items (> 0); else 0
};

struct Bvh {
    std::vector<BvhNode> nodes;        // [0] the root; empty without items
    std::vector<std::int32_t> order;   // items, leaf by leaf
};

// Boxes must be finite, which the caller checks. A leaf holds `leaf_size` items at most.
Bvh build_bvh(const std::vector<Aabb> &boxes, int leaf_size);

}  // namespace hil::sim::frame
