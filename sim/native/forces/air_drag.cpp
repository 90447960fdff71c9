// Drag of the airframe.
//
//   D_j = -r (d1_j + d2_j |a|) a_j,   a the velocity through the air in B, j its axes, r the density over 1.225 kg/m3
//
// Drag uses the magnitude of the whole velocity, not each axis alone, which keeps the force smooth where a component
// changes sign. It acts at the centre of mass.

#include <cmath>

#include "force_binding.hpp"

namespace hil::sim {

namespace {

double largest(const ::Vec3 &v) {
    double most = v[0];
    if (v[1] > most) most = v[1];
    if (v[2] > most) most = v[2];
    return most;
}

class AirDrag : public Force {
  public:
    AirDrag(::Vec3 linear_n_per_mps, ::Vec3 quadratic_n_per_m2ps2)
        : linear_n_per_mps_(linear_n_per_mps), quadratic_n_per_m2ps2_(quadratic_n_per_m2ps2) {}

    void prepare(const StepTimes &, const Inertia &inertia) override {
        linear_per_s_ = largest(linear_n_per_mps_) / inertia.mass_kg;
        quadratic_per_m_ = 2.0 * largest(quadratic_n_per_m2ps2_) / inertia.mass_kg;
    }

    double damping_per_s(double airspeed_mps) const override { return linear_per_s_ + quadratic_per_m_ * airspeed_mps; }

    void add(const Instant &now, Wrench &out) const override {
        const double *a = now.air_B;
        const double airspeed = std::sqrt((a[0] * a[0] + a[1] * a[1]) + a[2] * a[2]);
        for (int j = 0; j < 3; ++j) {
            out.force_B[j] += -now.density_ratio * (linear_n_per_mps_[j] + quadratic_n_per_m2ps2_[j] * airspeed) * a[j];
        }
    }

  private:
    ::Vec3 linear_n_per_mps_, quadratic_n_per_m2ps2_;
    double linear_per_s_ = 0.0, quadratic_per_m_ = 0.0;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<AirDrag, Force>(m, "AirDrag", "Drag of the airframe; see forces/air_drag.cpp.")
        .def(nb::init<::Vec3, ::Vec3>(), nb::kw_only(), "linear_n_per_mps"_a, "quadratic_n_per_m2ps2"_a);
}};

}  // namespace

}  // namespace hil::sim
