// sim._kernels.sweep_rays: rays of a sweep from a moving vehicle. Contract: frame/sweep_rays.hpp.
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>

#include "bind_arrays.hpp"
#include "frame/sweep_rays.hpp"

namespace {

using Motion = std::tuple<Vec3, Vec3, Vec3, Vec3, std::array<double, 4>, Vec3, Vec3, Vec3>;

}  // namespace

void bind_sweep_rays(nb::module_ &m) {
    m.def(
        "sweep_rays",
        [](const Motion &motion, In<std::int32_t, -1> time_offset_ns, In<double, -1, 3> origins_B, In<double, -1, 3> directions_B, Out<double, -1, 3> origins_W,
           Out<double, -1, 3> directions_W, const std::string &isa) {
            const std::size_t n = time_offset_ns.shape(0);
            if (origins_B.shape(0) != n || directions_B.shape(0) != n || origins_W.shape(0) != n ||
                directions_W.shape(0) != n) {
                throw std::invalid_argument("all arrays of a sweep need one row per ray");
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
            return std::make_tuple(Vec3{box.lo[0], box.lo[1], box.lo[2]}, Vec3{box.hi[0], box.hi[1], box.hi[2]});
        },
        "motion"_a, "time_offset_ns"_a, "origins_B"_a, "directions_B"_a, "origins_W"_a.noconvert(),
        "directions_W"_a.noconvert(), nb::kw_only(), "isa"_a = "",
        "Write the rays in W, each from the vehicle's pose when it fires; return the box of all origins, low and high.");
}
