// Pictures as PNG (W3C, Portable Network Graphics, third edition): no time, no text, the same bytes on every machine.
#pragma once

#include <cstdint>
#include <vector>

#include "deflate.hpp"

namespace hil::sim {

// What is subtracted from a byte before compression: nothing, its neighbour on the left, or the one above.
enum class PngFilter : std::uint8_t { kNone = 0, kSub = 1, kUp = 2 };

struct PngPicture {
    const std::uint8_t *pixels;  // rows from the top, without gaps; 16-bit values in the machine's order
    std::uint32_t width, height;
    int components;     // 1 grey, 3 RGB
    int bytes;          // of one value: 1 or 2
    PngFilter filter;
    const std::uint8_t *palette;  // RGB of each index, or null; for one component of one byte
    std::uint32_t palette_size;   // 1 to 256 colours
};

class PngEncoder {
public:
    // Appends the file. Allocates only until its buffers have grown to the largest picture.
    void encode(const PngPicture &picture, std::vector<std::uint8_t> &out);

private:
    Deflater deflater_;
    std::vector<std::uint8_t> rows_;  // filtered, each after its filter's number
    std::vector<std::uint8_t> big_;   // two rows of 16-bit values, most significant byte first
};

}  // namespace hil::sim
