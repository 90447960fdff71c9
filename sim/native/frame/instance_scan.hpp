// What a picture of instance ids holds of each instance: its extent, area, rim and run lengths. In one pass each.
#pragma once

#include <cstdint>
#include <vector>

namespace hil::sim::frame {

struct InstanceRow {
    std::int32_t id;
    std::int32_t area;  // pixels
    std::int32_t x_min, y_min, x_max, y_max;  // inclusive
    std::int32_t rim;     // pairs of neighbours (4-connected) of which one pixel is the instance's, one is not
    std::int32_t hidden;  // those of them where the other pixel's surface stands in front
};

// `hidden` by depth z: the inverse depth of a plane is linear in the picture, so what the neighbour's surface would have
// at the instance's pixel is 2 / z_q - 1 / z_r, where q is the neighbour and r the next pixel of the same thing beyond
// it (1 / z_q where there is none). Nearer than the instance by more than kInFront: it stands in front. Ground under a
// wall touches it at that pixel and does not.
constexpr double kInFront = 1.03;

struct LabelPicture {
    const std::uint16_t *instance;  // 0: nothing
    const std::uint8_t *classes;    // or null
    const float *depth;             // along the optical axis [m], +inf for nothing; or null: `hidden` stays 0
    std::int32_t width, height;
};

class InstanceScan {
public:
    InstanceScan() : slot_(65536, -1) {}

    // Rows by ascending id, without 0. `class_pixels`: 256 counts over the whole picture, or null.
    const std::vector<InstanceRow> &scan(const LabelPicture &picture, std::int64_t *class_pixels);

    // Masks of `ids` as COCO's run lengths: column by column, nothing first, to the last pixel. Those of ids[i] are
    // counts()[offsets()[i]] to before offsets()[i + 1]. An id that the picture lacks has one run, of nothing.
    void run_lengths(const LabelPicture &picture, const std::uint16_t *ids, std::size_t n);
    const std::vector<std::int32_t> &counts() const { return counts_; }
    const std::vector<std::int64_t> &offsets() const { return offsets_; }

private:
    struct Run {
        std::int32_t slot, start, length;
    };

    std::int32_t slot_of(std::uint16_t id);
    void pair(const LabelPicture &p, std::int32_t at, std::int32_t step, bool beyond);

    std::vector<std::int32_t> slot_;  // by id: its row, -1 for none
    std::vector<InstanceRow> rows_;
    std::vector<std::int32_t> edges_;  // pixels whose neighbour is another thing's: the right one, or (runs) the one above
    std::vector<std::int32_t> turns_;  // the latter column by column
    std::vector<std::int32_t> column_;  // where in `turns_` each column ends
    std::vector<Run> runs_;
    std::vector<std::int32_t> counts_, end_;
    std::vector<std::int64_t> offsets_, next_;
};

}  // namespace hil::sim::frame
