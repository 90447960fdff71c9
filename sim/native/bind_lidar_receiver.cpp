// sim._kernels.LidarReceiver, lambert_strength: what a LiDAR reports. Contract: frame/lidar_receiver.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>

#include "frame/lidar_receiver.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace hil::sim::frame;

namespace {

using Key = std::array<std::uint64_t, 2>;
template <class T>
using In = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <class T>
using Out = nb::ndarray<T, nb::numpy, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using In3 = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using OutPoints = nb::ndarray<float, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

template <class Array>
void expect(const Array &array, std::size_t count, const char *what) {
    if (array.shape(0) != count) {
        throw std::invalid_argument(std::string(what) + " has " + std::to_string(array.shape(0)) + " rows for " +
                                    std::to_string(count) + " rays");
    }
}

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

std::size_t receive(const LidarReceiver &receiver, std::uint64_t first, In<std::int32_t> place, In<double> range,
                    In<double> strength, In<std::int32_t> geom, In3 direction, In<double> origin_z,
                    In<std::uint16_t> ring, In<std::int32_t> offset, In<std::uint8_t> geom_class, OutPoints points,
                    Out<float> range_out, Out<float> intensity, Out<std::uint16_t> ring_out, Out<std::int32_t> offset_out,
                    Out<std::uint8_t> class_out, const std::string &isa) {
    const std::size_t n = place.shape(0);
    expect(range, n, "range_m"), expect(strength, n, "strength"), expect(geom, n, "geom");
    expect(direction, n, "directions_L"), expect(origin_z, n, "origin_z_m"), expect(ring, n, "ring");
    expect(offset, n, "time_offset_ns"), expect(points, n, "points_L"), expect(range_out, n, "out range_m");
    expect(intensity, n, "intensity"), expect(ring_out, n, "out ring"), expect(offset_out, n, "out time_offset_ns");
    expect(class_out, n, "out segmentation");
    for (std::size_t i = 0; i < n; ++i) {
        const std::int32_t at = place.data()[i];
        if (at < 0 || static_cast<std::size_t>(at) >= n) throw std::invalid_argument("place is out of range");
        const bool met = range.data()[at] < std::numeric_limits<double>::infinity();
        const std::int32_t g = geom.data()[at];
        if (met && (g < 0 || static_cast<std::size_t>(g) >= geom_class.shape(0))) {
            throw std::invalid_argument("an echo of a geom without a class");
        }
    }
    const LidarEchoes in{n,           place.data(),    range.data(), strength.data(), geom.data(),
                         direction.data(), origin_z.data(), ring.data(),  offset.data(),   geom_class.data()};
    const LidarCloud out{points.data(),   range_out.data(),  intensity.data(),
                         ring_out.data(), offset_out.data(), class_out.data()};
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
             "time_offset_out_ns"_a.noconvert(), "segmentation"_a.noconvert(), nb::kw_only(), "isa"_a = "",
             "Writes the points that are reported to the front of the outputs; returns how many.");
    m.def(
        "lambert_strength",
        [](In<std::int32_t> geom, In3 normal, In3 direction, In<double> reflectivity, Out<double> strength) {
            const std::size_t n = geom.shape(0);
            expect(normal, n, "normal_W"), expect(direction, n, "directions_W"), expect(strength, n, "strength");
            for (std::size_t i = 0; i < n; ++i) {
                if (geom.data()[i] >= 0 && static_cast<std::size_t>(geom.data()[i]) >= reflectivity.shape(0)) {
                    throw std::invalid_argument("a geom without a reflectivity");
                }
            }
            nb::gil_scoped_release release;
            lambert_strength(geom.data(), normal.data(), direction.data(), reflectivity.data(), n, strength.data());
        },
        "geom"_a, "normal_W"_a, "directions_W"_a, "reflectivity"_a, "strength"_a.noconvert(),
        "Reflectivity times cosine of incidence of each ray; 0 where nothing was met.");
}
