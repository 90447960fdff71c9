// sim._kernels.InstanceScan: extents and masks of a picture's instances. Contract: frame/instance_scan.hpp.
#include <nanobind/stl/optional.h>

#include <cstring>
#include <optional>

#include "bind_arrays.hpp"
#include "frame/instance_scan.hpp"

using hil::sim::frame::InstanceRow;
using hil::sim::frame::InstanceScan;
using hil::sim::frame::LabelPicture;

namespace {

constexpr std::size_t kMostPixels = std::size_t{1} << 28;
constexpr std::size_t kColumns = sizeof(InstanceRow) / sizeof(std::int32_t);

template <typename A>
auto data_of(const std::optional<A> &array, const In<std::uint16_t, -1, -1> &ids, const char *name) -> decltype(array->data()) {
    if (!array) return nullptr;
    if (array->shape(0) != ids.shape(0) || array->shape(1) != ids.shape(1)) {
        throw std::invalid_argument(std::string(name) + " and instance differ in size");
    }
    return array->data();
}

LabelPicture picture_of(const In<std::uint16_t, -1, -1> &ids) {
    if (ids.size() == 0 || ids.size() > kMostPixels) throw std::invalid_argument("the picture is empty or too large");
    return {ids.data(), nullptr, nullptr, static_cast<std::int32_t>(ids.shape(1)),
            static_cast<std::int32_t>(ids.shape(0))};
}

std::size_t scan(InstanceScan &self, In<std::uint16_t, -1, -1> instance, std::optional<In<std::uint8_t, -1, -1>> classes, std::optional<In<float, -1, -1>> depth_m,
                 Out<std::int32_t, -1, kColumns> out, Out<std::int64_t, 256> class_pixels) {
    LabelPicture picture = picture_of(instance);
    picture.classes = data_of(classes, instance, "classes");
    picture.depth = data_of(depth_m, instance, "depth_m");
    nb::gil_scoped_release unlocked;
    const auto &rows = self.scan(picture, class_pixels.data());
    if (rows.size() <= out.shape(0) && !rows.empty()) {
        std::memcpy(out.data(), rows.data(), rows.size() * sizeof(InstanceRow));
    }
    return rows.size();
}

nb::tuple run_length_texts(InstanceScan &self, In<std::uint16_t, -1, -1> instance, In<std::uint16_t, -1> ids) {
    const LabelPicture picture = picture_of(instance);
    for (std::size_t i = 1; i < ids.size(); ++i) {
        if (ids.data()[i] <= ids.data()[i - 1]) throw std::invalid_argument("ids must rise");
    }
    {
        nb::gil_scoped_release unlocked;
        self.run_lengths(picture, ids.data(), ids.size());
    }
    std::string text;
    nb::list all;
    for (std::size_t i = 0; i < ids.size(); ++i) {
        text.clear();
        for (auto at = self.offsets()[i]; at < self.offsets()[i + 1]; ++at) {
            if (!text.empty()) text += ',';
            text += std::to_string(self.counts()[static_cast<std::size_t>(at)]);
        }
        all.append(nb::str(text.data(), text.size()));
    }
    return nb::tuple(all);
}

}  // namespace

void bind_instance_scan(nb::module_ &m) {
    nb::class_<InstanceScan>(m, "InstanceScan", "For one thread at a time.")
        .def(nb::init<>())
        .def("scan", scan, "instance"_a.noconvert(), "classes"_a.noconvert().none(), "depth_m"_a.noconvert().none(),
             "out"_a.noconvert(), "class_pixels"_a.noconvert(),
             "Rows (id, area, x_min, y_min, x_max, y_max, rim, hidden) by id; how many there are. Nothing "
             "is written where `out` has room for fewer.")
        .def("run_length_texts", run_length_texts, "instance"_a.noconvert(), "ids"_a.noconvert(),
             "Masks of rising ids as COCO's run lengths: counts with commas between them.");
}
