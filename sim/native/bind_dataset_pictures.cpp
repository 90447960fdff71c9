// sim._kernels: pictures of a data set. Normals as the integers of a PNG (hil/apps/dataset/formats/pictures.py), and
// extent, rim and mask of each instance.
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "bind_arrays.hpp"

namespace {

// A neighbour's surface is in front if it is nearer than the instance by more than this factor. The inverse depth of a
// plane is linear in the picture, so the neighbour's surface extrapolates to 2 / z_q - 1 / z_r at the instance's pixel,
// where q is the neighbour and r the next pixel of the same object beyond it (1 / z_q without one). Ground under a wall
// touches it at that pixel and is not in front.
constexpr double kInFront = 1.03;

using Ids = In<std::uint16_t, -1, -1>;
using Depth = std::optional<In<float, -1, -1>>;
using Row = std::array<std::int32_t, 8>;
enum Column { kId, kArea, kLeft, kTop, kRight, kBottom, kRim, kHidden };

bool real(float depth) { return depth > 0.0f && depth <= std::numeric_limits<float>::max(); }

class Scan {
public:
    Scan(const Ids &instance, const Depth &depth_m)
        : ids_(instance.data()), depth_(depth_m ? depth_m->data() : nullptr),
          w_(static_cast<std::int32_t>(instance.shape(1))), h_(static_cast<std::int32_t>(instance.shape(0))) {}

    std::vector<Row> rows() {
        for (std::int32_t y = 0; y < h_; ++y) {
            const std::int32_t first = y * w_;
            for (std::int32_t x = 0, end; x < w_; x = end) {
                for (end = x + 1; end < w_ && ids_[first + end] == ids_[first + x];) ++end;
                if (ids_[first + x]) grow(row_of(ids_[first + x]), x, end, y);
                if (end == w_) continue;
                pair(first + end - 1, 1, end + 1 < w_);
                pair(first + end, -1, end > 1);
            }
            for (std::int32_t at = first; y + 1 < h_ && at < first + w_; ++at) {
                if (ids_[at] == ids_[at + w_]) continue;
                pair(at, w_, y + 2 < h_);
                pair(at + w_, -w_, y > 0);
            }
        }
        std::sort(rows_.begin(), rows_.end());
        return rows_;
    }

private:
    Row &row_of(std::uint16_t id) {
        std::int32_t &slot = slot_[id];
        if (slot < 0) {
            slot = static_cast<std::int32_t>(rows_.size());
            rows_.push_back({id, 0, w_, h_, -1, -1, 0, 0});
        }
        return rows_[static_cast<std::size_t>(slot)];
    }

    // Extends the instance by pixels x .. end - 1 of row y.
    static void grow(Row &row, std::int32_t x, std::int32_t end, std::int32_t y) {
        row[kArea] += end - x;
        row[kLeft] = std::min(row[kLeft], x), row[kTop] = std::min(row[kTop], y);
        row[kRight] = std::max(row[kRight], end - 1), row[kBottom] = y;
    }

    // Counts the pair of neighbours `at` and `at + step`, of different ids, for the instance at `at`. The test is the
    // inequality of kInFront, multiplied by all three depths. `beyond`: at + 2 step is in the picture.
    void pair(std::int32_t at, std::int32_t step, bool beyond) {
        if (!ids_[at]) return;
        Row &row = row_of(ids_[at]);
        ++row[kRim];
        const std::int32_t other = at + step, next = other + step;
        if (!depth_ || !real(depth_[other])) return;
        const double z_p = depth_[at], z_q = depth_[other];
        const double z_r = beyond && ids_[next] == ids_[other] && real(depth_[next]) ? depth_[next] : z_q;
        row[kHidden] += z_p * (2.0 * z_r - z_q) > kInFront * z_q * z_r;
    }

    const std::uint16_t *ids_;
    const float *depth_;
    std::int32_t w_, h_;
    std::vector<std::int32_t> slot_ = std::vector<std::int32_t>(65536, -1);  // row of each id; -1: none
    std::vector<Row> rows_;
};

std::vector<Row> scan_instances(const Ids &instance, const Depth &depth_m) {
    if (depth_m) same_size(instance, *depth_m, "depth_m");
    nb::gil_scoped_release unlocked;
    return Scan(instance, depth_m).rows();
}

std::vector<std::string> run_length_texts(const Ids &instance, const std::vector<std::uint16_t> &wanted) {
    const std::size_t height = instance.shape(0), width = instance.shape(1);
    std::vector<std::string> texts(wanted.size());
    std::vector<std::size_t> counted(wanted.size(), 0);  // pixels, column by column
    std::vector<std::int32_t> slot(65536, -1);
    for (std::size_t i = 0; i < wanted.size(); ++i) slot[wanted[i]] = static_cast<std::int32_t>(i);
    std::size_t start = 0, at = 0;
    const auto run_ends = [&](std::uint16_t id) {
        if (slot[id] >= 0) {
            const auto i = static_cast<std::size_t>(slot[id]);
            if (!texts[i].empty()) texts[i] += ',';
            texts[i] += std::to_string(start - counted[i]) + ',' + std::to_string(at - start);
            counted[i] = at;
        }
        start = at;
    };
    std::uint16_t id = 0;
    for (std::size_t x = 0; x < width; ++x) {
        for (std::size_t y = 0; y < height; ++y, ++at) {
            const std::uint16_t here = instance.data()[y * width + x];
            if (here == id) continue;
            if (at) run_ends(id);
            id = here;
        }
    }
    if (at) run_ends(id);
    for (std::size_t i = 0; i < texts.size(); ++i) {
        if (counted[i] < at) texts[i] += ',' + std::to_string(at - counted[i]);
    }
    return texts;
}

void normal_values(const In<float, -1, -1, 3> &normal, const Out<std::uint8_t, -1, -1, 3> &out) {
    same_size(normal, out, "the colours");
    std::uint8_t *__restrict v = out.data();
    const float *__restrict x = normal.data();
    const std::size_t n = normal.size();
    for (std::size_t i = 0; i < n; ++i) {
        const float above = x[i] >= -1.0f ? x[i] : -1.0f;  // NaN: -1
        v[i] = static_cast<std::uint8_t>(static_cast<std::int32_t>((above <= 1.0f ? above : 1.0f) * 127.0f + 128.5f));
    }
    for (std::size_t i = 0; i < n; i += 3) {  // only the zero vector: a unit vector has a component above 0.5 in magnitude
        if (v[i] == 128 && v[i + 1] == 128 && v[i + 2] == 128) v[i] = v[i + 1] = v[i + 2] = 0;
    }
}

}  // namespace

void bind_dataset_pictures(nb::module_ &m) {
    m.def("scan_instances", scan_instances, "instance"_a.noconvert(), "depth_m"_a.noconvert().none(),
          "Return rows (id, area, x_min, y_min, x_max, y_max, rim, hidden) by rising id, without 0. `rim`: pairs of "
          "neighbours of which one pixel is the instance's; `hidden`: pairs in which the other pixel is in front.");
    m.def("run_length_texts", run_length_texts, "instance"_a.noconvert(), "ids"_a,
          "Return the mask of each id as COCO run lengths: column by column, background first, separated by commas.");
    m.def("normal_values", normal_values, "normal"_a.noconvert(), "out"_a.noconvert(),
          "Write floor(127 n + 128.5) of each component, clipped to -1 to 1; (0, 0, 0) for the zero vector.");
}
