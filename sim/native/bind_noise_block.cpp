// sim._kernels.uniform_block, normal_block: consecutive draws of a named noise stream. Contract: noise_block.hpp.

#include "bind_arrays.hpp"
#include "noise_block.hpp"

void bind_noise_block(nb::module_ &m) {
    m.def(
        "uniform_block",
        [](Key key, std::uint64_t first_index, const Out<double, -1> &out) {
            nb::gil_scoped_release release;
            hil::sim::uniform_block(key.data(), first_index, out.shape(0), out.data());
        },
        "key"_a, "first_index"_a, "out"_a.noconvert(),
        "Uniforms of indices first_index, first_index + 1, ... of the one-lane stream with this key.");
    m.def(
        "normal_block",
        [](Key key, std::uint64_t first_index, const Out<double, -1> &out) {
            nb::gil_scoped_release release;
            hil::sim::normal_block(key.data(), first_index, out.shape(0), out.data());
        },
        "key"_a, "first_index"_a, "out"_a.noconvert(),
        "Standard normals of indices first_index, first_index + 1, ... of the one-lane stream with this key.");
}
