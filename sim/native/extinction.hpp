// Light that hazy air takes away (Beer and Lambert), with the exponential that is the same on every machine.
#pragma once

#include <cstddef>

namespace hil::sim {

// strength[i] *= exp(-extinction_per_m range_m[i]) where the range is finite; elsewhere it stays.
void extinguish(const double *range_m, double extinction_per_m, std::size_t count, double *strength);

}  // namespace hil::sim
