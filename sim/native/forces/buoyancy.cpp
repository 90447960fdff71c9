// Buoyancy of a volume of lifting gas, or of a hull in the air.
//
//   F = rho V g z_W,  M = r x F,   r the centre of the volume in B
//
// V is the volume whose content is not in the vehicle's mass; the drag of its hull is the vehicle's.

#include "force_binding.hpp"

namespace hil::sim {

namespace {

class Buoyancy : public Force {
  public:
    Buoyancy(double lift_n, ::Vec3 centre_m) : lift_n_(lift_n), centre_m_(centre_m) {}

    void add(const Instant &now, Wrench &out) const override {
        double f[3];
        for (int j = 0; j < 3; ++j) {
            f[j] = now.density_ratio * lift_n_ * now.R[6 + j];  // z_W in B
            out.force_B[j] += f[j];
        }
        const ::Vec3 &r = centre_m_;
        out.torque_B[0] += r[1] * f[2] - r[2] * f[1];
        out.torque_B[1] += r[2] * f[0] - r[0] * f[2];
        out.torque_B[2] += r[0] * f[1] - r[1] * f[0];
    }

  private:
    double lift_n_;
    ::Vec3 centre_m_;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Buoyancy, Force>(m, "Buoyancy", "Constant force along z_W at a point of the body; see forces/buoyancy.cpp.")
        .def(nb::init<double, ::Vec3>(), nb::kw_only(), "lift_n"_a, "centre_m"_a);
}};

}  // namespace

}  // namespace hil::sim
