#include "instance_scan.hpp"

#include <algorithm>
#include <cstring>
#include <limits>

namespace hil::sim::frame {
namespace {

// Where the run of equal elements that begins at `from` ends, at `end` at most: eight bytes at a time.
template <typename T>
std::int32_t run_end(const T *values, std::int32_t from, std::int32_t end) {
    constexpr std::int32_t kWord = 8 / sizeof(T);
    T repeated[kWord];
    std::fill_n(repeated, kWord, values[from]);
    std::uint64_t same, here;
    std::memcpy(&same, repeated, 8);
    std::int32_t at = from + 1;
    for (; at + kWord <= end; at += kWord) {
        std::memcpy(&here, values + at, 8);
        if (here != same) break;
    }
    while (at < end && values[at] == values[from]) ++at;
    return at;
}

// The pixels whose lower neighbour is another thing's, row by row.
template <typename OnTurn>
void each_turn(const LabelPicture &p, OnTurn on_turn) {
    constexpr std::int32_t kAtOnce = 8;
    const std::int32_t w = p.width;
    for (std::int32_t y = 0; y + 1 < p.height; ++y) {
        const std::uint16_t *ids = p.instance + static_cast<std::ptrdiff_t>(y) * w;
        for (std::int32_t from = 0; from < w; from += kAtOnce) {
            const std::int32_t to = std::min(w, from + kAtOnce);
            if (to - from == kAtOnce && !std::memcmp(ids + from, ids + from + w, 2 * kAtOnce)) continue;
            for (std::int32_t x = from; x < to; ++x) {
                if (ids[x] != ids[x + w]) on_turn(x, y);
            }
        }
    }
}

bool real(float depth) { return depth > 0.0f && depth <= std::numeric_limits<float>::max(); }

}  // namespace

std::int32_t InstanceScan::slot_of(std::uint16_t id) {
    std::int32_t &slot = slot_[id];
    if (slot < 0) {
        slot = static_cast<std::int32_t>(rows_.size());
        rows_.push_back({id, 0, std::numeric_limits<std::int32_t>::max(), 0, -1, -1, 0, 0});
    }
    return slot;
}

// Neighbours `at` and `at + step` of different ids, seen from the first: the second may stand in front.
// `beyond`: at + 2 step lies in the picture. The inequality of the header, times all three depths.
void InstanceScan::pair(const LabelPicture &p, std::int32_t at, std::int32_t step, bool beyond) {
    const std::uint16_t id = p.instance[at];
    if (!id) return;
    InstanceRow &row = rows_[static_cast<std::size_t>(slot_[id])];
    ++row.rim;
    const std::int32_t other = at + step, next = other + step;
    if (!p.depth || !real(p.depth[other])) return;
    const double z_p = p.depth[at], z_q = p.depth[other];
    double z_r = z_q;
    if (beyond && p.instance[next] == p.instance[other] && real(p.depth[next])) z_r = p.depth[next];
    row.hidden += z_p * (2.0 * z_r - z_q) > kInFront * z_q * z_r;
}

const std::vector<InstanceRow> &InstanceScan::scan(const LabelPicture &p, std::int64_t *class_pixels) {
    for (const InstanceRow &row : rows_) slot_[static_cast<std::size_t>(row.id)] = -1;
    rows_.clear();
    if (class_pixels) std::fill_n(class_pixels, 256, 0);
    const std::int32_t w = p.width, h = p.height;
    if (p.classes && class_pixels) {
        for (std::int32_t i = 0, end; i < w * h; i = end) {
            end = run_end(p.classes, i, w * h);
            class_pixels[p.classes[i]] += end - i;
        }
    }
    edges_.clear();
    for (std::int32_t y = 0; y < h; ++y) {
        const std::uint16_t *ids = p.instance + static_cast<std::ptrdiff_t>(y) * w;
        for (std::int32_t x = 0, end; x < w; x = end) {
            const std::uint16_t id = ids[x];
            end = run_end(ids, x, w);
            if (end < w) edges_.push_back(y * w + end - 1);
            if (!id) continue;
            InstanceRow &row = rows_[static_cast<std::size_t>(slot_of(id))];
            row.area += end - x;
            row.x_min = std::min(row.x_min, x);
            row.x_max = std::max(row.x_max, end - 1);
            if (row.y_max < 0) row.y_min = y;
            row.y_max = y;
        }
    }
    for (const std::int32_t at : edges_) {
        const std::int32_t x = at % w;
        pair(p, at, 1, x + 2 < w);
        pair(p, at + 1, -1, x > 0);
    }
    each_turn(p, [&](std::int32_t x, std::int32_t y) {
        pair(p, y * w + x, w, y + 2 < h);
        pair(p, (y + 1) * w + x, -w, y > 0);
    });
    std::sort(rows_.begin(), rows_.end(), [](const InstanceRow &a, const InstanceRow &b) { return a.id < b.id; });
    return rows_;
}

void InstanceScan::run_lengths(const LabelPicture &p, const std::uint16_t *ids, std::size_t n) {
    const std::int32_t w = p.width, h = p.height, pixels = w * h;
    // Where columns turn to another thing, put column by column: far fewer than pixels.
    edges_.clear();
    column_.assign(static_cast<std::size_t>(w) + 1, 0);
    each_turn(p, [&](std::int32_t x, std::int32_t y) {
        edges_.push_back((y + 1) * w + x);
        ++column_[static_cast<std::size_t>(x) + 1];
    });
    for (std::size_t x = 0; x < static_cast<std::size_t>(w); ++x) column_[x + 1] += column_[x];
    turns_.resize(edges_.size());
    for (const std::int32_t at : edges_) turns_[static_cast<std::size_t>(column_[static_cast<std::size_t>(at % w)]++)] = at;
    for (const InstanceRow &row : rows_) slot_[static_cast<std::size_t>(row.id)] = -1;
    rows_.clear();
    for (std::size_t i = 0; i < n; ++i) slot_[ids[i]] = static_cast<std::int32_t>(i);
    runs_.clear();
    offsets_.assign(n + 1, 0);
    end_.assign(n, 0);
    std::uint16_t id = p.instance[0];
    std::int32_t start = 0;
    const auto end_run = [&](std::int32_t end) {
        const std::int32_t slot = slot_[id];
        if (slot < 0) return;
        runs_.push_back({slot, start, end - start});
        offsets_[static_cast<std::size_t>(slot) + 1] += 2;
        end_[static_cast<std::size_t>(slot)] = end;
    };
    const auto go_on = [&](std::int32_t at, std::int32_t x, std::int32_t y) {
        if (p.instance[at] == id) return;
        end_run(x * h + y);
        id = p.instance[at], start = x * h + y;
    };
    for (std::int32_t x = 0, turn = 0; x < w; ++x) {
        go_on(x, x, 0);
        for (; turn < column_[static_cast<std::size_t>(x)]; ++turn) {
            const std::int32_t at = turns_[static_cast<std::size_t>(turn)];
            go_on(at, x, at / w);
        }
    }
    end_run(pixels);
    for (std::size_t i = 0; i < n; ++i) offsets_[i + 1] += offsets_[i] + (end_[i] < pixels);
    counts_.resize(static_cast<std::size_t>(offsets_[n]));
    next_.assign(offsets_.begin(), offsets_.end() - 1);
    std::fill(end_.begin(), end_.end(), 0);
    for (const Run &run : runs_) {
        std::int64_t &at = next_[static_cast<std::size_t>(run.slot)];
        std::int32_t &end = end_[static_cast<std::size_t>(run.slot)];
        counts_[static_cast<std::size_t>(at++)] = run.start - end;
        counts_[static_cast<std::size_t>(at++)] = run.length;
        end = run.start + run.length;
    }
    for (std::size_t i = 0; i < n; ++i) {
        if (end_[i] < pixels) counts_[static_cast<std::size_t>(next_[i])] = pixels - end_[i];
        slot_[ids[i]] = -1;
    }
}

}  // namespace hil::sim::frame
