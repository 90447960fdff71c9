// sim._kernels.LidarDrops: false returns from rain and snow. Contract: frame/lidar_drops.hpp.
#include "bind_arrays.hpp"
#include "frame/lidar_drops.hpp"

using namespace hil::sim::frame;

namespace {

struct Drops {
    LidarDrops model;
    double from_m, step_m;
};

std::size_t add(const Drops &drops, In<double, -1> nearest, std::uint64_t first, In<std::int32_t, -1> place, std::int32_t geom_of_drop,
                Out<double, -1> range, Out<double, -1> strength, Out<std::int32_t, -1> geom) {
    const std::size_t n = place.shape(0);
    expect_rows(range, n, "range_m"), expect_rows(strength, n, "strength"), expect_rows(geom, n, "geom");
    if (nearest.shape(0) == 0) throw std::invalid_argument("the table of the nearest drop is empty");
    for (std::size_t i = 0; i < n; ++i) {
        const std::int32_t at = place.data()[i];
        if (at < 0 || static_cast<std::size_t>(at) >= n)
            throw std::invalid_argument("place holds an index that is out of range");
    }
    const NearestDrop table{nearest.data(), nearest.shape(0), drops.from_m, drops.step_m};
    nb::gil_scoped_release release;
    return add_drops(drops.model, table, first, place.data(), n, geom_of_drop, range.data(), strength.data(), geom.data());
}

}  // namespace

void bind_lidar_drops(nb::module_ &m) {
    nb::class_<Drops>(m, "LidarDrops")
        .def("__init__",
             [](Drops *self, Key key, const std::string &echo, double aperture_m, double divergence_rad,
                double two_way_per_m, double least_power, double least_strength, double reflectivity, double water_scale,
                double water_power, double slope_per_mm, double largest_mm, double from_m, double step_m) {
                 new (self) Drops{{{key[0], key[1]},
                                   echo == "strongest",
                                   echo == "last",
                                   aperture_m,
                                   divergence_rad,
                                   two_way_per_m,
                                   least_power,
                                   least_strength,
                                   reflectivity,
                                   water_scale,
                                   water_power,
                                   slope_per_mm,
                                   largest_mm},
                                  from_m,
                                  step_m};
             },
             nb::kw_only(), "key"_a, "echo"_a, "aperture_m"_a, "divergence_rad"_a, "two_way_per_m"_a, "least_power"_a,
             "least_strength"_a, "reflectivity"_a, "water_scale"_a, "water_power"_a, "slope_per_mm"_a, "largest_mm"_a, "from_m"_a, "step_m"_a)
        .def("add", &add, "nearest"_a, "first_index"_a, "place"_a, "geom_of_drop"_a, "range_m"_a.noconvert(),
             "strength"_a.noconvert(), "geom"_a.noconvert(),
             "Write the drops that are reported instead of surfaces into the echoes; return their number.");
}
