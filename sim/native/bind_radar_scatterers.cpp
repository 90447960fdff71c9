// sim._kernels: conversion of rendered pictures to radar echoes, and the tables that it needs. Contracts:
// sim/native/radar/scatterers.hpp, reflection.hpp and directions.hpp.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <tuple>

#include "bind_arrays.hpp"
#include "detmath.hpp"
#include "radar/directions.hpp"
#include "radar/reflection.hpp"
#include "radar/scatterers.hpp"

namespace rd = hil::sim::radar;

namespace {

void need(bool holds, const char *message) {
    if (!holds) throw std::invalid_argument(message);
}

template <class A>
bool has_shape(const A &array, std::size_t height, std::size_t width) {
    return array.shape(0) == height && array.shape(1) == width;
}

rd::ReflectingSurface surface_of(double eps_r, double eps_i, double phase_height, double facet_slope) {
    need(eps_r > 0.0 && eps_i >= 0.0 && phase_height >= 0.0 && facet_slope > 0.0,
         "a surface needs eps_r and facet_slope above 0, eps_i and phase_height of 0 or more");
    return {eps_r, eps_i, phase_height, facet_slope};
}

}  // namespace

void bind_radar_scatterers(nb::module_ &m) {
    m.attr("RADAR_CURVE_STEPS") = rd::kCurveSteps;
    m.def(
        "radar_backscatter",
        [](double eps_r, double eps_i, double phase_height, double facet_slope, In<double, -1> cosine,
           Out<double, -1> sigma0) {
            need(cosine.shape(0) == sigma0.shape(0), "cosine and sigma0 differ in length");
            const auto surface = surface_of(eps_r, eps_i, phase_height, facet_slope);
            for (std::size_t i = 0; i < cosine.shape(0); ++i) {
                sigma0.data()[i] = rd::backscatter(surface, cosine.data()[i]);
            }
        },
        "eps_r"_a, "eps_i"_a, "phase_height"_a, "facet_slope"_a, "cosine"_a.noconvert(), "sigma0"_a.noconvert());
    m.def(
        "radar_fresnel_power",
        [](double eps_r, double eps_i, double cosine) {
            return rd::fresnel_power(surface_of(eps_r, eps_i, 0.0, 1.0), cosine);
        },
        "eps_r"_a, "eps_i"_a, "cosine"_a);
    m.def(
        "radar_amplitude_curve",
        [](double eps_r, double eps_i, double phase_height, double facet_slope, Out<float, -1> out) {
            need(out.shape(0) == rd::kCurveSteps + 1, "a curve has RADAR_CURVE_STEPS + 1 nodes");
            rd::amplitude_curve(surface_of(eps_r, eps_i, phase_height, facet_slope), out.data(), out.shape(0));
        },
        "eps_r"_a, "eps_i"_a, "phase_height"_a, "facet_slope"_a, "out"_a.noconvert());
    m.def(
        "cosines_and_sines",
        [](In<double, -1> angle_rad, Out<double, -1> cosine, Out<double, -1> sine) {
            const std::size_t n = angle_rad.shape(0);
            need(cosine.shape(0) == n && sine.shape(0) == n, "all arrays need one row per angle");
            nb::gil_scoped_release release;
            for (std::size_t i = 0; i < n; ++i) {
                cosine.data()[i] = hil::det::cos(angle_rad.data()[i]);
                sine.data()[i] = hil::det::sin(angle_rad.data()[i]);
            }
        },
        "angle_rad"_a.noconvert(), "cosine"_a.noconvert(), "sine"_a.noconvert(), "Write both of each angle.");
    m.def(
        "arc_tangents",
        [](In<double, -1> y, In<double, -1> x, Out<double, -1> angle_rad) {
            const std::size_t n = angle_rad.shape(0);
            need(y.shape(0) == n && x.shape(0) == n, "all arrays need one row per angle");
            nb::gil_scoped_release release;
            for (std::size_t i = 0; i < n; ++i) angle_rad.data()[i] = hil::det::atan2(y.data()[i], x.data()[i]);
        },
        "y"_a.noconvert(), "x"_a.noconvert(), "angle_rad"_a.noconvert(), "Write the angle of each (x, y).");
    m.def(
        "pixel_solid_angles",
        [](In<double, -1, -1, 3> corners, Out<double, -1, -1> out) {
            need(corners.shape(0) >= 1 && corners.shape(1) >= 1 &&
                     has_shape(out, corners.shape(0) - 1, corners.shape(1) - 1),
                 "corners needs one row and one column more than out");
            nb::gil_scoped_release release;
            rd::pixel_solid_angles(corners.data(), out.shape(0), out.shape(1), out.data());
        },
        "corners"_a.noconvert(), "out"_a.noconvert());
    m.def(
        "azimuth_elevation",
        [](In<double, -1, 3> direction_R, Out<double, -1> azimuth, Out<double, -1> elevation) {
            const std::size_t n = direction_R.shape(0);
            need(azimuth.shape(0) == n && elevation.shape(0) == n, "all arrays need one row per direction");
            nb::gil_scoped_release release;
            rd::azimuth_elevation(direction_R.data(), n, azimuth.data(), elevation.data());
        },
        "direction_R"_a.noconvert(), "azimuth_rad"_a.noconvert(), "elevation_rad"_a.noconvert());
    m.def(
        "cosine_pattern",
        [](In<double, -1, 3> direction_R, double azimuth_exponent, double elevation_exponent, Out<double, -1> out) {
            need(out.shape(0) == direction_R.shape(0), "all arrays need one row per direction");
            nb::gil_scoped_release release;
            rd::cosine_pattern(direction_R.data(), out.shape(0), azimuth_exponent, elevation_exponent, out.data());
        },
        "direction_R"_a.noconvert(), "azimuth_exponent"_a, "elevation_exponent"_a, "out"_a.noconvert());
    m.def(
        "collect_scatterers",
        [](In<float, -1, 4, rd::kLanes> blocks, In<double, -1, 3> direction_R, In<float, -1, rd::kCurveSteps + 1> curves,
           std::optional<In<std::uint8_t, 256>> class_kept, float max_range_m, In<float, -1, -1> range,
           In<float, -1, -1, 3> normal, In<std::uint8_t, -1, -1> material, In<float, -1, -1> radial_velocity,
           std::optional<In<std::uint8_t, -1, -1>> segmentation, Out<double, -1> range_m, Out<double, -1> speed_mps,
           Out<double, -1, 3> echo_direction_R, Out<double, -1> amplitude, const std::string &isa) -> std::tuple<long, long, long, long, long, long, long, long> {
            const std::size_t height = range.shape(0), width = range.shape(1), pixels = height * width;
            need(has_shape(normal, height, width) && has_shape(material, height, width) &&
                     has_shape(radial_velocity, height, width) &&
                     (!segmentation || has_shape(*segmentation, height, width)),
                 "the channels of a picture differ in size");
            need(direction_R.shape(0) == pixels && blocks.shape(0) == (pixels + rd::kLanes - 1) / rd::kLanes,
                 "the picture's size differs from that of the camera for which the pixel tables were made");
            need(class_kept.has_value() == segmentation.has_value(), "class_kept and segmentation must be given together");
            const std::size_t room = range_m.shape(0);
            need(room >= pixels && speed_mps.shape(0) == room && echo_direction_R.shape(0) == room &&
                     amplitude.shape(0) == room,
                 "the arrays of echoes need a row for every pixel");
            const rd::PixelPlan plan = {blocks.data(),
                                        direction_R.data(),
                                        static_cast<long>(pixels),
                                        curves.data(),
                                        static_cast<int>(curves.shape(0)),
                                        class_kept ? class_kept->data() : nullptr,
                                        max_range_m};
            const rd::PixelPicture picture = {range.data(), normal.data(), radial_velocity.data(), material.data(),
                                              segmentation ? segmentation->data() : nullptr};
            const rd::EchoColumns out = {range_m.data(), speed_mps.data(), echo_direction_R.data(), amplitude.data()};
            rd::ScatterCounts c{};
            const auto &kernels = rd::scatter_kernels(hil::sim::frame::isa_by_name(isa));
            {
                nb::gil_scoped_release release;
                kernels.collect(plan, picture, out, c);
            }
            return {c.invalid, c.sky, c.nothing, c.unknown, c.range, c.classes, c.away, c.kept};
        },
        "blocks"_a.noconvert(), "direction_R"_a.noconvert(), "curves"_a.noconvert(), "class_kept"_a.noconvert().none(),
        "max_range_m"_a, "picture_range"_a.noconvert(), "normal"_a.noconvert(), "material"_a.noconvert(),
        "radial_velocity"_a.noconvert(), "segmentation"_a.noconvert().none(), "range_m"_a.noconvert(),
        "speed_mps"_a.noconvert(), "echo_direction_R"_a.noconvert(), "amplitude"_a.noconvert(), "isa"_a,
        "Write the echoes of a picture; return the counts of ScatterCounts in their order.");
}
