// sim._kernels.sweep_rays: rays of a sweep from a moving carrier. Contract: frame/sweep_rays.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>
#include <tuple>

#include "frame/sweep_rays.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using V3 = std::array<double, 3>;
using Motion = std::tuple<V3, V3, V3, V3, std::array<double, 4>, V3, V3, V3>;
using Offsets = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using In3 = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Out3 = nb::ndarray<double, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

}  // namespace

void bind_sweep_rays(nb::module_ &m) {
    m.def(
        "sweep_rays",
        [](const Motion &motion, Offsets time_offset_ns, In3 origins_B, In3 directions_B, Out3 origins_W,
           Out3 directions_W, const std::string &isa) {
            const std::size_t n = time_offset_ns.shape(0);
            if (origins_B.shape(0) != n || directions_B.shape(0) != n || origins_W.shape(0) != n ||
                directions_W.shape(0) != n) {
                throw std::invalid_argument("all arrays of a sweep need one row a ray");
            }
            hil::sim::frame::SweepMotion c{};
            const auto copy = [](const auto &from, double *to) { std::copy(from.begin(), from.end(), to); };
            copy(std::get<0>(motion), c.p), copy(std::get<1>(motion), c.c1), copy(std::get<2>(motion), c.c2);
            copy(std::get<3>(motion), c.c3), copy(std::get<4>(motion), c.q_WB), copy(std::get<5>(motion), c.f1);
            copy(std::get<6>(motion), c.f2), copy(std::get<7>(motion), c.f3);
            const hil::sim::frame::SweepKernel kernel = hil::sim::frame::sweep_kernel(hil::sim::frame::isa_by_name(isa));
            hil::sim::frame::SweepBox box{};
            {
                nb::gil_scoped_release release;
                kernel(c, time_offset_ns.data(), origins_B.data(), directions_B.data(), origins_W.data(),
                       directions_W.data(), n, box);
            }
            return std::make_tuple(V3{box.lo[0], box.lo[1], box.lo[2]}, V3{box.hi[0], box.hi[1], box.hi[2]});
        },
        "motion"_a, "time_offset_ns"_a, "origins_B"_a, "directions_B"_a, "origins_W"_a.noconvert(),
        "directions_W"_a.noconvert(), nb::kw_only(), "isa"_a = "",
        "Rays in W, each from where the carrier is when it fires; returns the box of all origins, low and high.");
}
