// Attenuation of light by haze (Beer-Lambert), with detmath's exponential: the same bits on every machine.
#pragma once

#include <cstddef>

namespace hil::sim {

// strength[i] *= exp(-extinction_per_m range_m[i]) if the range is finite; otherwise unchanged.
void extinguish(const double *range_m, double extinction_per_m, std::size_t count, double *strength);

}  // namespace hil::sim
