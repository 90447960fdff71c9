// sim._kernels.depth_values, normal_values: what pictures of depth and normals hold. Contract: frame/picture_values.hpp.
#include "bind_arrays.hpp"
#include "frame/picture_values.hpp"

void bind_picture_values(nb::module_ &m) {
    m.def(
        "depth_values",
        [](In<float, -1, -1> depth_m, double steps_per_m, Out<std::uint16_t, -1, -1> out) {
            same_size(depth_m, out, "the values");
            nb::gil_scoped_release unlocked;
            hil::sim::frame::depth_values(depth_m.data(), steps_per_m, depth_m.size(), out.data());
        },
        "depth_m"_a.noconvert(), "steps_per_m"_a, "out"_a.noconvert());
    m.def(
        "normal_values",
        [](In<float, -1, -1, 3> normal, Out<std::uint8_t, -1, -1, 3> out) {
            same_size(normal, out, "the colours");
            nb::gil_scoped_release unlocked;
            hil::sim::frame::normal_values(normal.data(), normal.size() / 3, out.data());
        },
        "normal"_a.noconvert(), "out"_a.noconvert());
}
