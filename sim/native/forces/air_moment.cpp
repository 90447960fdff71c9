// Moment of the air that flows across the vehicle: flapping blades and the parts above and below the centre of mass turn
// it back against the flow.
//
//   M = (k_x a_y, -k_y a_x, 0)      a the velocity through the air in B, k >= 0 or < 0 [N s]
//
// Linear in the velocity, as flapping is. Identified from flight (hil/apps/identify/fit): the small quadrotors of the
// published flights need it more than any drag.

#include "force_binding.hpp"

namespace hil::sim {

namespace {

class AirMoment : public Force {
  public:
    AirMoment(double about_x_ns, double about_y_ns) : about_x_ns_(about_x_ns), about_y_ns_(about_y_ns) {}

    void add(const Instant &now, Wrench &out) const override {
        out.torque_B[0] += about_x_ns_ * now.air_B[1];
        out.torque_B[1] -= about_y_ns_ * now.air_B[0];
    }

  private:
    double about_x_ns_, about_y_ns_;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<AirMoment, Force>(m, "AirMoment", "Moment of the air across the vehicle; see forces/air_moment.cpp.")
        .def(nb::init<double, double>(), nb::kw_only(), "about_x_ns"_a, "about_y_ns"_a);
}};

}  // namespace

}  // namespace hil::sim
