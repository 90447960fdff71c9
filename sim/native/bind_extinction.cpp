// sim._kernels.extinguish: attenuation of light by haze. Contract: extinction.hpp.

#include "bind_arrays.hpp"
#include "extinction.hpp"

void bind_extinction(nb::module_ &m) {
    m.def(
        "extinguish",
        [](In<double, -1> range_m, double extinction_per_m, const Out<double, -1> &strength) {
            if (range_m.shape(0) != strength.shape(0)) throw std::invalid_argument("ranges and strengths must have the same length");
            nb::gil_scoped_release release;
            hil::sim::extinguish(range_m.data(), extinction_per_m, range_m.shape(0), strength.data());
        },
        "range_m"_a.noconvert(), "extinction_per_m"_a, "strength"_a.noconvert(),
        "Multiply each strength by exp(-extinction_per_m range); leave it unchanged if the range is not finite.");
}
