// Distance along a ray to the ground plane z = 0 and to axis-aligned boxes.
//
// Slab method (Kay and Kajiya, SIGGRAPH 1986): a box is the intersection of three slabs; the ray is inside from the
// last entry to the first exit. A ray that starts inside a box or under the ground is at distance 0.
//
// `boxes`: [count][6] = centre x y z, half edges x y z, in W [m]. `direction_W` a unit vector. Returns the distance
// [m], or -1 if nothing is hit. + - * / and comparisons only; no allocation.
#pragma once

#include <cstddef>

namespace hil::sim {

double ray_distance(const double *origin_W, const double *direction_W, const double *boxes, std::size_t count);

}  // namespace hil::sim
