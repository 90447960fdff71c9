// sim._kernels.PngEncoder, depth_values, normal_values: pictures as PNG. Contract: png.hpp, frame/picture_values.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "frame/picture_values.hpp"
#include "png.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Pixels = nb::ndarray<nb::ro, nb::numpy, nb::c_contig, nb::device::cpu>;
using Palette = nb::ndarray<const std::uint8_t, nb::numpy, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

using Depth = nb::ndarray<const float, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Steps = nb::ndarray<std::uint16_t, nb::numpy, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Normals = nb::ndarray<const float, nb::numpy, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Rgb = nb::ndarray<std::uint8_t, nb::numpy, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

template <typename A, typename B>
void same_size(const A &a, const B &b) {
    if (a.shape(0) != b.shape(0) || a.shape(1) != b.shape(1)) throw std::invalid_argument("the pictures differ in size");
}

class Encoder {
public:
    nb::bytes encode(Pixels pixels, const std::string &filter, std::optional<Palette> palette) {
        hil::sim::PngPicture p{};
        if (pixels.dtype() == nb::dtype<std::uint8_t>()) p.bytes = 1;
        else if (pixels.dtype() == nb::dtype<std::uint16_t>()) p.bytes = 2;
        else throw std::invalid_argument("a PNG holds uint8 or uint16");
        if (pixels.ndim() != 2 && !(pixels.ndim() == 3 && pixels.shape(2) == 3)) {
            throw std::invalid_argument("a PNG's pixels are (height, width) or (height, width, 3)");
        }
        p.components = pixels.ndim() == 2 ? 1 : 3;
        if (pixels.size() == 0) throw std::invalid_argument("the picture is empty");
        if (pixels.size() * p.bytes > (std::size_t{1} << 27)) throw std::invalid_argument("the picture is too large");
        p.pixels = static_cast<const std::uint8_t *>(pixels.data());
        p.height = static_cast<std::uint32_t>(pixels.shape(0));
        p.width = static_cast<std::uint32_t>(pixels.shape(1));
        if (filter == "none") p.filter = hil::sim::PngFilter::kNone;
        else if (filter == "sub") p.filter = hil::sim::PngFilter::kSub;
        else if (filter == "up") p.filter = hil::sim::PngFilter::kUp;
        else throw std::invalid_argument("the filter must be none, sub or up, not " + filter);
        if (palette) {
            if (p.bytes != 1 || p.components != 1) throw std::invalid_argument("a palette is for (height, width) uint8");
            if (palette->shape(0) < 1 || palette->shape(0) > 256) throw std::invalid_argument("1 to 256 colours");
            p.palette = palette->data();
            p.palette_size = static_cast<std::uint32_t>(palette->shape(0));
            for (std::size_t i = 0; i < pixels.size(); ++i) {
                if (p.pixels[i] >= p.palette_size) throw std::invalid_argument("a pixel is beyond the palette");
            }
        }
        out_.clear();
        {
            nb::gil_scoped_release unlocked;
            encoder_.encode(p, out_);
        }
        return nb::bytes(reinterpret_cast<const char *>(out_.data()), out_.size());
    }

private:
    hil::sim::PngEncoder encoder_;
    std::vector<std::uint8_t> out_;
};

}  // namespace

void bind_png(nb::module_ &m) {
    nb::class_<Encoder>(m, "PngEncoder", "For one thread at a time.")
        .def(nb::init<>())
        .def("encode", &Encoder::encode, "pixels"_a.noconvert(), "filter"_a = "none", "palette"_a = nb::none(),
             "The file. ValueError for what no PNG holds.");
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
