// Outlines: the pixels that an edge of something may pass through, and their colour by coverage.
//
// A pixel belongs to an outline if it sees another geom than a pixel beside, above or below it. It takes four samples of
// what is seen, at the quarters of the pixel, and its colour is their mean in linear light. Samples are not shaded: one that
// sees the pixel's own geom has the pixel's colour, any other that of the nearest of the eight pixels around that sees the
// sample's geom. Only where none does (something thinner than a pixel) is the sample shaded itself. All other pixels, and
// every channel but colour, keep the sample of their centre.
//
// The samples are pixels of a picture twice as fine, of which only the blocks over outlines are drawn: all others are
// closed (RasterOptions::open), which hides what is behind them as a near wall would.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "raster.hpp"

namespace hil::sim::frame {

class Outlines {
public:
    // Finds the outlines in pixel rows [row0, row1). Of the buffer, rows [drawn0, drawn1) are drawn: the same and those
    // above and below, if the picture has any.
    void find(const VisibilityBuffer &buffer, int drawn0, int drawn1, int row0, int row1);
    bool empty() const { return pixel_.empty(); }

    // [blocks of a picture twice as fine, `blocks_x` in a row]: 1 if a block has samples.
    const std::vector<std::uint8_t> &finer_blocks(int blocks_x, int blocks_y);

    // Finds the colour of each sample in pixel rows [first, last). Sets a bit in `lanes`, [blocks of the finer picture], for
    // each one that must be shaded. Returns false if there are none. Threads may do different rows.
    bool match(const VisibilityBuffer &finer, int first, int last, std::uint16_t *lanes);

    // Writes the outlines of pixel rows [first, last) to `out`. `rgb`: colour of the centres; `samples`: of the finer picture.
    void put(const std::uint8_t *rgb, const std::uint8_t *samples, int first, int last, std::uint8_t *out) const;

private:
    std::ptrdiff_t at(int x, int y) const { return static_cast<std::ptrdiff_t>(y + 1) * stride_ + x + 1; }

    int width_ = 0, height_ = 0, row0_ = 0, stride_ = 0;
    std::vector<std::int32_t> geom_;         // seen by each pixel, row-major, with a rim that repeats the outermost pixels
    std::vector<std::int32_t> pixel_;        // y width + x of each pixel of an outline, row by row
    std::vector<std::size_t> first_of_row_;  // of rows from row0 on: index of the first one in `pixel_`
    std::vector<std::uint8_t> finer_;
    std::vector<std::int32_t> source_;       // [pixel_][4]: the pixel, or -1 - the sample, that gives the colour of a sample
};

}  // namespace hil::sim::frame
