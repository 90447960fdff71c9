#include "extinction.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

void extinguish(const double *range_m, double extinction_per_m, std::size_t count, double *strength) {
    for (std::size_t i = 0; i < count; ++i) {
        if (std::isfinite(range_m[i])) strength[i] *= det::exp(-extinction_per_m * range_m[i]);
    }
}

}  // namespace hil::sim
