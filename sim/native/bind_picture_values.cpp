// sim._kernels.depth_values, normal_values: what pictures of depth and normals hold. Contract: frame/picture_values.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <stdexcept>

#include "frame/picture_values.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Depth = nb::ndarray<const float, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Steps = nb::ndarray<std::uint16_t, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Normals = nb::ndarray<const float, nb::numpy, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Rgb = nb::ndarray<std::uint8_t, nb::numpy, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

template <typename A, typename B>
void same_size(const A &a, const B &b) {
    if (a.shape(0) != b.shape(0) || a.shape(1) != b.shape(1)) throw std::invalid_argument("the pictures differ in size");
}

}  // namespace

void bind_picture_values(nb::module_ &m) {
    m.def(
        "depth_values",
        [](Depth depth_m, double steps_per_m, Steps out) {
            same_size(depth_m, out);
            nb::gil_scoped_release unlocked;
            hil::sim::frame::depth_values(depth_m.data(), steps_per_m, depth_m.size(), out.data());
        },
        "depth_m"_a.noconvert(), "steps_per_m"_a, "out"_a.noconvert());
    m.def(
        "normal_values",
        [](Normals normal, Rgb out) {
            same_size(normal, out);
            nb::gil_scoped_release unlocked;
            hil::sim::frame::normal_values(normal.data(), normal.size() / 3, out.data());
        },
        "normal"_a.noconvert(), "out"_a.noconvert());
}
