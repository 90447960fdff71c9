// sim._kernels.walker_pose: limbs of a walking person. Contract: gait.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>

#include <array>
#include <bit>
#include <stdexcept>

#include "gait.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr std::size_t kShapeValues = sizeof(hil::sim::GaitShape) / sizeof(double);
constexpr std::size_t kWalkValues = sizeof(hil::sim::WalkState) / sizeof(double);
using ShapeValues = std::array<double, kShapeValues>;
using WalkValues = std::array<double, kWalkValues>;
using Out3 = nb::ndarray<double, nb::numpy, nb::shape<hil::sim::kLimbs, 3>, nb::c_contig, nb::device::cpu>;
using Out4 = nb::ndarray<double, nb::numpy, nb::shape<hil::sim::kLimbs, 4>, nb::c_contig, nb::device::cpu>;

}  // namespace

void bind_gait(nb::module_ &m) {
    m.def(
        "walker_pose",
        [](const ShapeValues &shape, double phase, const WalkValues &walk, Out3 p_WB, Out4 q_WB, Out3 v_WB_W,
           Out3 w_WB_W) {
            if (!(phase >= 0.0 && phase <= 1.0)) {
                throw std::invalid_argument("the phase of a step cycle is 0 to 1");
            }
            hil::sim::walker_pose(std::bit_cast<hil::sim::GaitShape>(shape), phase,
                                  std::bit_cast<hil::sim::WalkState>(walk), p_WB.data(), q_WB.data(), v_WB_W.data(),
                                  w_WB_W.data());
        },
        "shape"_a, "phase"_a, "walk"_a, "p_WB"_a.noconvert(), "q_WB"_a.noconvert(), "v_WB_W"_a.noconvert(),
        "w_WB_W"_a.noconvert(), "Poses and velocities in W of the limbs of a walker.");
}
