// sim._kernels.BoxScene: boxes are passed once, then one call per ray. Contract: ray.hpp.

#include "bind_arrays.hpp"
#include "ray.hpp"

namespace {

class BoxScene {
  public:
    explicit BoxScene(const std::vector<std::array<double, 6>> &boxes) {
        for (const auto &box : boxes) boxes_.insert(boxes_.end(), box.begin(), box.end());
    }
    double ray_distance(const Vec3 &origin_W, const Vec3 &direction_W) const {
        return hil::sim::ray_distance(origin_W.data(), direction_W.data(), boxes_.data(), boxes_.size() / 6);
    }

  private:
    std::vector<double> boxes_;
};

}  // namespace

void bind_ray(nb::module_ &m) {
    nb::class_<BoxScene>(m, "BoxScene", "The ground z = 0 and axis-aligned boxes (centre x y z, half edges x y z) [m].")
        .def(nb::init<const std::vector<std::array<double, 6>> &>(), "boxes"_a)
        .def("ray_distance", &BoxScene::ray_distance, "origin_W"_a, "direction_W"_a,
             "Return the distance [m] along a unit vector to the nearest surface; -1 if none is hit, 0 inside a box.");
}
