// sim._kernels.LidarReceiver, lambert_strength: receiver of a LiDAR. Contract: frame/lidar_receiver.hpp.
#include <nanobind/stl/optional.h>

#include <limits>
#include <optional>

#include "bind_arrays.hpp"
#include "frame/lidar_receiver.hpp"

using namespace hil::sim::frame;

namespace {

LidarReceiver make(Key noise_key, Key loss_key, double noise_m, double resolution_m, double min_range_m,
                   double max_range_m, std::optional<double> range_at_10_percent_m, double dropout,
                   std::optional<double> intensity_falloff_m) {
    if (!(resolution_m > 0.0)) throw std::invalid_argument("resolution_m must be above zero");
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    return {{noise_key[0], noise_key[1]},
            {loss_key[0], loss_key[1]},
            noise_m,
            resolution_m,
            min_range_m,
            max_range_m,
            range_at_10_percent_m.value_or(kNone),
            dropout,
            intensity_falloff_m.value_or(kNone)};
}

std::size_t receive(const LidarReceiver &receiver, std::uint64_t first, In<std::int32_t, -1> place, In<double, -1> range,
                    In<double, -1> strength, In<std::int32_t, -1> geom, In<double, -1, 3> direction, In<double, -1> origin_z,
                    In<std::uint16_t, -1> ring, In<std::int32_t, -1> offset, In<std::uint8_t, -1> geom_class, Out<float, -1, 3> points,
                    Out<float, -1> range_out, Out<float, -1> intensity, Out<std::uint16_t, -1> ring_out, Out<std::int32_t, -1> offset_out,
                    Out<std::uint8_t, -1> class_out, const std::optional<Out<std::int32_t, -1>> &ray, const std::string &isa) {
    const std::size_t n = place.shape(0);
    expect_rows(range, n, "range_m"), expect_rows(strength, n, "strength"), expect_rows(geom, n, "geom");
    expect_rows(direction, n, "directions_L"), expect_rows(origin_z, n, "origin_z_m"), expect_rows(ring, n, "ring");
    expect_rows(offset, n, "time_offset_ns"), expect_rows(points, n, "points_L"), expect_rows(range_out, n, "out range_m");
    expect_rows(intensity, n, "intensity"), expect_rows(ring_out, n, "out ring"), expect_rows(offset_out, n, "out time_offset_ns");
    expect_rows(class_out, n, "out segmentation");
    if (ray) expect_rows(*ray, n, "ray");
    for (std::size_t i = 0; i < n; ++i) {
        const std::int32_t at = place.data()[i];
        if (at < 0 || static_cast<std::size_t>(at) >= n)
            throw std::invalid_argument("place holds an index that is out of range");
        const bool met = range.data()[at] < std::numeric_limits<double>::infinity();
        const std::int32_t g = geom.data()[at];
        if (met && (g < 0 || static_cast<std::size_t>(g) >= geom_class.shape(0))) {
            throw std::invalid_argument("an echo's geom has no entry in geom_class");
        }
    }
    const LidarEchoes in{n,           place.data(),    range.data(), strength.data(), geom.data(),
                         direction.data(), origin_z.data(), ring.data(),  offset.data(),   geom_class.data()};
    const LidarCloud out{points.data(),   range_out.data(),  intensity.data(),
                         ring_out.data(), offset_out.data(), class_out.data(), ray ? ray->data() : nullptr};
    const ReceiveKernel kernel = receive_kernel(isa_by_name(isa));
    nb::gil_scoped_release release;
    return kernel(receiver, in, first, out);
}

}  // namespace

void bind_lidar_receiver(nb::module_ &m) {
    nb::class_<LidarReceiver>(m, "LidarReceiver")
        .def("__init__",
             [](LidarReceiver *self, Key noise_key, Key loss_key, double noise_m, double resolution_m,
                double min_range_m, double max_range_m, std::optional<double> range_at_10_percent_m, double dropout,
                std::optional<double> intensity_falloff_m) {
                 new (self) LidarReceiver(make(noise_key, loss_key, noise_m, resolution_m, min_range_m, max_range_m,
                                               range_at_10_percent_m, dropout, intensity_falloff_m));
             },
             nb::kw_only(), "noise_key"_a, "loss_key"_a, "noise_m"_a, "resolution_m"_a, "min_range_m"_a,
             "max_range_m"_a, "range_at_10_percent_m"_a.none(), "dropout"_a, "intensity_falloff_m"_a.none())
        .def("receive", &receive, "first_index"_a, "place"_a, "range_m"_a, "strength"_a, "geom"_a, "directions_L"_a,
             "origin_z_m"_a, "ring"_a, "time_offset_ns"_a, "geom_class"_a, "points_L"_a.noconvert(),
             "range_out_m"_a.noconvert(), "intensity"_a.noconvert(), "ring_out"_a.noconvert(),
             "time_offset_out_ns"_a.noconvert(), "segmentation"_a.noconvert(), nb::kw_only(), "ray"_a.noconvert() = nb::none(),
             "isa"_a = "",
             "Write the reported points to the front of the outputs, and to `ray` their rays; return their number.");
    m.def(
        "lambert_strength",
        [](In<std::int32_t, -1> geom, In<double, -1, 3> normal, In<double, -1, 3> direction, In<double, -1> reflectivity, Out<double, -1> strength) {
            const std::size_t n = geom.shape(0);
            expect_rows(normal, n, "normal_W"), expect_rows(direction, n, "directions_W"), expect_rows(strength, n, "strength");
            for (std::size_t i = 0; i < n; ++i) {
                if (geom.data()[i] >= 0 && static_cast<std::size_t>(geom.data()[i]) >= reflectivity.shape(0)) {
                    throw std::invalid_argument("a ray's geom has no entry in reflectivity");
                }
            }
            nb::gil_scoped_release release;
            lambert_strength(geom.data(), normal.data(), direction.data(), reflectivity.data(), n, strength.data());
        },
        "geom"_a, "normal_W"_a, "directions_W"_a, "reflectivity"_a, "strength"_a.noconvert(),
        "Write reflectivity times cosine of incidence of each ray; 0 without a hit.");
}
