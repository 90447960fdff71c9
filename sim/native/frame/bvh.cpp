#include "bvh.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hil::sim::frame {

namespace {

constexpr int kBins = 16;
constexpr float kNone = std::numeric_limits<float>::infinity();

Aabb empty_box() { return {{kNone, kNone, kNone}, {-kNone, -kNone, -kNone}}; }

void grow(Aabb &box, const Aabb &other) {
    for (int i = 0; i < 3; ++i) {
        box.lo[i] = std::min(box.lo[i], other.lo[i]);
        box.hi[i] = std::max(box.hi[i], other.hi[i]);
    }
}

float centre(const Aabb &box, int axis) { return 0.5f * box.lo[axis] + 0.5f * box.hi[axis]; }

struct Builder {
    const std::vector<Aabb> &boxes;
    const int leaf_size;
    Bvh tree;

    void split(std::int32_t node, std::int32_t begin, std::int32_t end) {
        auto &order = tree.order;
        Aabb box = empty_box(), centres = empty_box();
        for (auto i = begin; i < end; ++i) {
            const Aabb &item = boxes[static_cast<std::size_t>(order[static_cast<std::size_t>(i)])];
            grow(box, item);
            for (int a = 0; a < 3; ++a) {
                centres.lo[a] = std::min(centres.lo[a], centre(item, a));
                centres.hi[a] = std::max(centres.hi[a], centre(item, a));
            }
        }
        tree.nodes[static_cast<std::size_t>(node)].box = box;
        const std::int32_t count = end - begin;
        std::int32_t middle = begin;
        if (count > leaf_size) middle = best_split(begin, end, centres);
        if (middle == begin) {
            tree.nodes[static_cast<std::size_t>(node)].first = begin;
            tree.nodes[static_cast<std::size_t>(node)].count = count;
            return;
        }
        const auto left = static_cast<std::int32_t>(tree.nodes.size());
        tree.nodes.resize(tree.nodes.size() + 2);
        tree.nodes[static_cast<std::size_t>(node)].first = left;
        tree.nodes[static_cast<std::size_t>(node)].count = 0;
        split(left, begin, middle);
        split(left + 1, middle, end);
    }

    std::int32_t best_split(std::int32_t begin, std::int32_t end, const Aabb &centres) {
        auto &order = tree.order;
        int best_axis = -1, best_bin = 0;
        float best_cost = kNone;
        for (int axis = 0; axis < 3; ++axis) {
            const float extent = centres.hi[axis] - centres.lo[axis];
            if (!(extent > 0.0f)) continue;
            Aabb bin_box[kBins];
            int bin_count[kBins] = {};
            std::fill(bin_box, bin_box + kBins, empty_box());
            for (auto i = begin; i < end; ++i) {
                const Aabb &item = boxes[static_cast<std::size_t>(order[static_cast<std::size_t>(i)])];
                const int b = bin(item, axis, centres);
                grow(bin_box[b], item);
                ++bin_count[b];
            }
            float right_cost[kBins];
            Aabb right = empty_box();
            int right_count = 0;
            for (int b = kBins - 1; b > 0; --b) {
                grow(right, bin_box[b]);
                right_count += bin_count[b];
                right_cost[b] = half_area(right) * static_cast<float>(right_count);
            }
            Aabb left = empty_box();
            int left_count = 0;
            for (int b = 1; b < kBins; ++b) {
                grow(left, bin_box[b - 1]);
                left_count += bin_count[b - 1];
                const float cost = half_area(left) * static_cast<float>(left_count) + right_cost[b];
                if (left_count > 0 && left_count < end - begin && cost < best_cost) {
                    best_cost = cost;
                    best_axis = axis;
                    best_bin = b;
                }
            }
        }
        const auto from = order.begin() + begin, to = order.begin() + end;
        if (best_axis < 0) return begin + (end - begin) / 2;  // all centres coincide: split the list in half
        const auto middle = std::stable_partition(from, to, [&](std::int32_t i) {
            return bin(boxes[static_cast<std::size_t>(i)], best_axis, centres) < best_bin;
        });
        return static_cast<std::int32_t>(middle - order.begin());
    }

    static int bin(const Aabb &box, int axis, const Aabb &centres) {
        const float extent = centres.hi[axis] - centres.lo[axis];
        const float at = (centre(box, axis) - centres.lo[axis]) / extent * static_cast<float>(kBins);
        return std::clamp(static_cast<int>(at), 0, kBins - 1);
    }
};

}  // namespace

Aabb outward(const double *lo, const double *hi) {
    Aabb box;
    for (int i = 0; i < 3; ++i) {
        box.lo[i] = std::nextafter(static_cast<float>(lo[i]), -kNone);
        box.hi[i] = std::nextafter(static_cast<float>(hi[i]), kNone);
    }
    return box;
}

Bvh build_bvh(const std::vector<Aabb> &boxes, int leaf_size) {
    Builder builder{boxes, leaf_size, {}};
    if (boxes.empty()) return {};
    builder.tree.order.resize(boxes.size());
    for (std::size_t i = 0; i < boxes.size(); ++i) builder.tree.order[i] = static_cast<std::int32_t>(i);
    builder.tree.nodes.reserve(2 * boxes.size());
    builder.tree.nodes.resize(1);
    builder.split(0, 0, static_cast<std::int32_t>(boxes.size()));
    return std::move(builder.tree);
}

}  // namespace hil::sim::frame
