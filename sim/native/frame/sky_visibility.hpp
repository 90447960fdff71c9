// Ambient occlusion of a scene's static geoms: the share of the surroundings that sends light to a point, on a grid.
//
// For directions w of a fixed, even set, v(w) = 0 if a ray of `reach` metres from the middle of a cell meets a surface,
// else 1. A surface that faces up, met from above, counts as open: it is the ground, whose light the ambient light has
// already. The grid stores the first two bands of v's spherical harmonics, v(w) = a + b . w with
//
//     a = mean v,   b = 3 mean (v w),   mean over the hemisphere of n, weighted by n . w:   a + (2/3) b . n
//
// (Ramamoorthi and Hanrahan, SIGGRAPH 2001). Between the middles of cells it is interpolated. Cells from which no
// direction is open lie within solids and take the mean of their neighbours. Outside the grid all is open.
//
// Accuracy and cost: docs/frames.md. The result depends on the geometry alone, not on threads or the instruction set.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry.hpp"
#include "isa.hpp"

namespace hil::sim::frame {

struct SkyVisibility {
    // `cell_m` is enlarged where the static geoms would take more than a million cells.
    SkyVisibility(const Geometry &geometry, double cell_m, double reach_m, int threads, Isa isa);

    float corner_W[3];  // middle of the first cell
    float per_m;        // cells per metre
    std::int32_t size[3];
    std::vector<std::int32_t> cell;  // x fastest; a, (b + 1) / 2 of x, y, z in 8 bits each, a lowest
};

}  // namespace hil::sim::frame
