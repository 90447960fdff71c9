// Bounding volume tree with eight boxes a node, side by side, so that one beam meets all eight at once.
//
// Boxes are stored a little larger than they are (kPad, and 1.2e-7 of the coordinate): the rounding of ray and
// shape, at most 1e-8 m within 1e7 m, can then never put a hit outside its box, and what is found by the tree is what
// a test of every item finds. Children that are not there have inside-out boxes, which nothing meets.
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
    int depth = 0;                // of nodes; a walk has at most 7 * depth + 8 entries open
};

// The same tree with its nodes opened until they have eight children; `boxes` by item.
WideTree widen(const Bvh &tree, const std::vector<Aabb> &boxes);

// New boxes of the items into the same tree. Returns how much there is to search, the area of all its boxes: what has
// moved apart makes it grow.
double refit(WideTree &tree, const std::vector<Aabb> &boxes);

// A box as the nodes hold it: padded, outward.
Aabb padded(const Aabb &box);

// The box of what is not there.
Aabb inside_out();

}  // namespace hil::sim::frame
