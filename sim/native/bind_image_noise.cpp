// sim._kernels: errors of camera sensors, on whole pictures. Contract: image_noise.hpp.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bind_arrays.hpp"
#include "image_noise.hpp"

namespace {

hil::sim::ImageKey key_of(const Key &key) { return {{key[0], key[1]}}; }

}  // namespace

void bind_image_noise(nb::module_ &m) {
    m.def(
        "accumulate_linear",
        [](In<std::uint8_t, -1, -1, 3> rgb, float weight, Out<float, -1, -1, 3> out) {
            same_size(rgb, out, "the sum");
            nb::gil_scoped_release unlocked;
            hil::sim::accumulate_linear(rgb.data(), weight, out.data(), rgb.size());
        },
        "rgb"_a.noconvert(), "weight"_a, "out"_a.noconvert());
    m.def(
        "expose",
        [](In<float, -1, -1, 3> linear, std::optional<In<float, -1, -1>> vignette, float gain, float electrons_at_white,
           float read_noise_electrons, bool noisy, Key key, std::uint64_t index, Out<std::uint8_t, -1, -1, 3> rgb) {
            same_size(linear, rgb, "the light");
            if (vignette) same_size(*vignette, rgb, "the vignette");
            if (!(gain > 0.0f && electrons_at_white > 0.0f && read_noise_electrons >= 0.0f)) {
                throw std::invalid_argument("gain and electrons must be positive, read noise not negative");
            }
            nb::gil_scoped_release unlocked;
            hil::sim::expose(linear.data(), vignette ? vignette->data() : nullptr,
                             {gain, electrons_at_white, read_noise_electrons, noisy}, key_of(key), index, rgb.data(),
                             rgb.size() / 3);
        },
        "linear"_a.noconvert(), "vignette"_a.noconvert().none(), nb::kw_only(), "gain"_a, "electrons_at_white"_a,
        "read_noise_electrons"_a, "noisy"_a, "key"_a, "index"_a, "rgb"_a.noconvert());
    m.def(
        "blur_depth",
        [](Out<float, -1, -1> depth_m, float sigma_m, float sigma_per_m, float step_m, float disparity_scale_m, float min_m,
           float max_m, Key key, std::uint64_t index) {
            nb::gil_scoped_release unlocked;
            hil::sim::blur_depth(depth_m.data(), {sigma_m, sigma_per_m, step_m, disparity_scale_m, min_m, max_m},
                                 key_of(key), index, depth_m.size());
        },
        "depth_m"_a.noconvert(), nb::kw_only(), "sigma_m"_a, "sigma_per_m"_a, "step_m"_a, "disparity_scale_m"_a,
        "min_m"_a, "max_m"_a, "key"_a, "index"_a);
    m.def(
        "image_normals",
        [](Key key, std::uint64_t index, Out<float, -1> out) {
            hil::sim::image_normals(key_of(key), index, out.data(), out.size());
        },
        "key"_a, "index"_a, "out"_a.noconvert());
    m.def(
        "sin_cos",
        [](In<double, -1> angle_rad, Out<double, -1> sine, Out<double, -1> cosine) {
            if (sine.size() != angle_rad.size() || cosine.size() != angle_rad.size()) {
                throw std::invalid_argument("angles, sines and cosines must have the same length");
            }
            nb::gil_scoped_release unlocked;
            hil::sim::sin_cos(angle_rad.data(), sine.data(), cosine.data(), angle_rad.size());
        },
        "angle_rad"_a.noconvert(), "sine"_a.noconvert(), "cosine"_a.noconvert());
}
