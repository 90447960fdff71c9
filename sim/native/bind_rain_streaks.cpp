// sim._kernels.draw_streaks: drops in a picture. Contract: rain_streaks.hpp.
#include "bind_arrays.hpp"
#include "rain_streaks.hpp"

using namespace hil::sim;

namespace {

void draw(Out<float, -1, -1> opacity, std::array<double, 4> intrinsics_px, In<double, -1> share, In<double, -1> width,
          In<double, -1> far, In<double, -1> fall, std::array<double, 2> near_m_and_margin_px, Vec3 air, Vec3 down,
          double exposure_s, Key key, std::uint64_t index, std::size_t count) {
    const std::size_t n = share.shape(0);
    if (n == 0) throw std::invalid_argument("there is no class of drops");
    if (width.shape(0) != n || far.shape(0) != n || fall.shape(0) != n) {
        throw std::invalid_argument("share, width_m, far_m and fall_mps must have the same length");
    }
    const auto &[fx, fy, cx, cy] = intrinsics_px;
    const StreakCamera camera{fx, fy, cx, cy, opacity.shape(1), opacity.shape(0)};
    const StreakDrops drops{share.data(), width.data(), far.data(), fall.data(), n, near_m_and_margin_px[0], near_m_and_margin_px[1]};
    const StreakMotion motion{{air[0], air[1], air[2]}, {down[0], down[1], down[2]}, exposure_s};
    nb::gil_scoped_release release;
    draw_streaks(camera, drops, motion, key.data(), index, count, opacity.data());
}

}  // namespace

void bind_rain_streaks(nb::module_ &m) {
    m.def("draw_streaks", &draw, "opacity"_a.noconvert(), nb::kw_only(), "intrinsics_px"_a, "share"_a, "width_m"_a, "far_m"_a,
          "fall_mps"_a, "near_m_and_margin_px"_a, "air_C_mps"_a, "down_C"_a, "exposure_s"_a, "key"_a, "index"_a, "count"_a,
          "Add the opacity of drops that fall through the exposure to the picture's.");
}
