// DEFLATE (RFC 1951) in zlib's wrapping (RFC 1950), made for speed: one probe for a match, greedy, one dynamic block.
//
// In integers alone: the same bytes on every machine, which compression libraries do not promise between versions and
// processors. Data that does not shrink is stored.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace hil::sim {

class Deflater {
public:
    // Appends the zlib stream of `size` bytes to `out`. No allocation once the buffers have grown to the largest input.
    // `size` below 2^28.
    void compress(const std::uint8_t *data, std::size_t size, std::vector<std::uint8_t> &out);

private:
    struct Match {
        std::uint32_t literals;  // bytes before it, after the match before
        std::uint16_t length, distance;
    };

    void find_matches(const std::uint8_t *data, std::size_t size);

    std::vector<std::uint32_t> head_;  // by hash of 8 bytes: the last place they were seen
    std::vector<Match> matches_;
    std::size_t n_matches_ = 0;
    std::uint32_t literal_count_[288] = {};
    std::uint32_t distance_count_[32] = {};
};

}  // namespace hil::sim
