#include "wide_tree.hpp"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstddef>
#include <limits>

namespace hil::sim::frame {
namespace {

constexpr double kPad = 1e-6;            // [m]
constexpr double kRelativePad = 1.2e-7;  // twice the relative error of rounding to float
constexpr std::int32_t kNobody = std::numeric_limits<std::int32_t>::min();  // child of an empty slot

// One child: a node of the binary tree, an item, or (box only) a node of this tree.
struct Child {
    Aabb box;
    std::int32_t node = -1;  // of the binary tree
    std::int32_t item = -1;
};

void put(WideNode &node, int at, const Aabb &box, std::int32_t child) {
    node.child[at] = child;
    for (int a = 0; a < 3; ++a) {
        if (!(box.lo[a] <= box.hi[a])) {
            node.face[a][at] = FLT_MAX;
            node.face[3 + a][at] = -FLT_MAX;
            continue;
        }
        const Aabb outer = padded(box);
        node.face[a][at] = outer.lo[a];
        node.face[3 + a][at] = outer.hi[a];
    }
}

WideNode empty_node() {
    WideNode node;
    for (int i = 0; i < kWide; ++i) put(node, i, inside_out(), kNobody);
    return node;
}

struct Widener {
    const Bvh &tree;
    const std::vector<Aabb> &boxes;
    WideTree out;

    const BvhNode &at(std::int32_t node) const { return tree.nodes[static_cast<std::size_t>(node)]; }

    // Number of children that replace a child when it is opened; 1: it cannot be opened.
    int parts(const Child &child) const {
        if (child.node < 0) return 1;
        return at(child.node).count > 0 ? at(child.node).count : 2;
    }

    void open(std::vector<Child> &children, std::size_t which) const {
        const Child child = children[which];
        children.erase(children.begin() + static_cast<std::ptrdiff_t>(which));
        const BvhNode &node = at(child.node);
        if (node.count > 0) {
            for (std::int32_t i = 0; i < node.count; ++i) {
                const std::int32_t item = tree.order[static_cast<std::size_t>(node.first + i)];
                children.push_back({boxes[static_cast<std::size_t>(item)], -1, item});
            }
        } else {
            for (std::int32_t i = 0; i < 2; ++i) children.push_back({at(node.first + i).box, node.first + i, -1});
        }
    }

    std::int32_t make(std::int32_t node, int depth) {
        out.depth = std::max(out.depth, depth);
        std::vector<Child> children{{at(node).box, node, -1}};
        for (;;) {
            std::size_t best = children.size();
            float largest = -1.0f;
            for (std::size_t i = 0; i < children.size(); ++i) {
                const int more = parts(children[i]) - 1;
                // The first child, the node itself, always fits: leaves of more than eight items do not occur.
                if (children[i].node < 0 || children.size() + static_cast<std::size_t>(more) > kWide) continue;
                const float area = half_area(children[i].box);
                if (area > largest) largest = area, best = i;
            }
            if (best == children.size()) break;
            open(children, best);
        }
        const auto index = static_cast<std::int32_t>(out.nodes.size());
        out.nodes.push_back(empty_node());
        for (std::size_t i = 0; i < children.size(); ++i) {
            const Child &child = children[i];
            const std::int32_t to = child.node < 0 ? ~child.item : make(child.node, depth + 1);
            put(out.nodes[static_cast<std::size_t>(index)], static_cast<int>(i), child.box, to);
        }
        return index;
    }
};

}  // namespace

Aabb inside_out() { return {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}}; }

Aabb padded(const Aabb &box) {
    Aabb outer;
    for (int a = 0; a < 3; ++a) {
        const double lo = box.lo[a], hi = box.hi[a];
        outer.lo[a] = static_cast<float>(lo - kPad - kRelativePad * std::fabs(lo));
        outer.hi[a] = static_cast<float>(hi + kPad + kRelativePad * std::fabs(hi));
    }
    return outer;
}

WideTree widen(const Bvh &tree, const std::vector<Aabb> &boxes) {
    Widener widener{tree, boxes, {}};
    if (!tree.nodes.empty()) widener.make(0, 1);
    return std::move(widener.out);
}

double refit(WideTree &tree, const std::vector<Aabb> &boxes) {
    double area = 0.0;
    // Children are stored after their parents: going backwards, a node's children are already refitted.
    for (std::size_t n = tree.nodes.size(); n-- > 0;) {
        WideNode &node = tree.nodes[n];
        for (int i = 0; i < kWide; ++i) {
            const std::int32_t child = node.child[i];
            if (child >= 0) {
                // These boxes are already padded; padding them again is harmless.
                const WideNode &below = tree.nodes[static_cast<std::size_t>(child)];
                Aabb box = inside_out();
                for (int a = 0; a < 3; ++a) {
                    box.lo[a] = *std::min_element(below.face[a], below.face[a] + kWide);
                    box.hi[a] = *std::max_element(below.face[3 + a], below.face[3 + a] + kWide);
                }
                put(node, i, box, child);
            } else if (child != kNobody) {
                put(node, i, boxes[static_cast<std::size_t>(~child)], child);
            }
            const double x = static_cast<double>(node.face[3][i]) - node.face[0][i];
            const double y = static_cast<double>(node.face[4][i]) - node.face[1][i];
            const double z = static_cast<double>(node.face[5][i]) - node.face[2][i];
            if (x >= 0.0) area += x * y + y * z + z * x;
        }
    }
    return area;
}

}  // namespace hil::sim::frame
