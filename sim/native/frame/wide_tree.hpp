// Bounding volume tree with eight boxes per node, lane by lane, so that a beam is tested against all eight at once.
//
// Boxes are enlarged by kPad and 1.2e-7 of the coordinate. The rounding of ray and shape, at most 1e-8 m within 1e7 m,
// then never puts a hit outside its box, and the tree finds the same hits as a test of every item. Missing children
// have inside-out boxes, which no ray meets.
#pragma once

#include <cstdint>
#include <vector>

#include "bvh.hpp"

namespace hil::sim::frame {

constexpr int kWide = 8;

struct alignas(64) WideNode {
    float face[6][kWide];  // low x, y, z, high x, y, z
    std::int32_t child[kWide];  // >= 0: a node; below: item ~child
};

struct WideTree {
    std::vector<WideNode> nodes;  // [0] the root; empty without items
    int depth = 0;                // of nodes; a traversal has at most 7 * depth + 8 open entries
};

// Returns the same tree with nodes opened until they have up to eight children; `boxes` by item.
WideTree widen(const Bvh &tree, const std::vector<Aabb> &boxes);

// Puts new boxes of the items into the tree. Returns the total area of its boxes, which grows as items move apart.
double refit(WideTree &tree, const std::vector<Aabb> &boxes);

// Box as nodes store it: padded and rounded outward.
Aabb padded(const Aabb &box);

// Box of a missing child.
Aabb inside_out();

}  // namespace hil::sim::frame
