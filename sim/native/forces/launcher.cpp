// Pull of a launcher along its rail: catapult, bungee or a hand.
//
//   F = (F_0 - k s) d   while engaged, F > 0 and s < length       s = (p - p_0) . d, the way along the rail
//
// d the unit vector of the rail in W, p_0 where the vehicle was held. A catapult has k = 0; a bungee F_0 = k times its
// stretch. The force acts at the centre of mass: the rail, which sim/physics/launch.py keeps the vehicle on, takes
// every torque and every force across it. A step ends where the pull does.

#include <cmath>

#include "force_binding.hpp"

namespace hil::sim {

namespace {

class Launcher : public Force {
  public:
    // Begins to pull in the coming tick.
    void engage(::Vec3 from_W_m, ::Vec3 along_W, double force_n, double stiffness_npm, double length_m) {
        from_W_m_ = from_W_m;
        along_W_ = along_W;
        force_n_ = force_n;
        stiffness_npm_ = stiffness_npm;
        length_m_ = length_m;
        engaged_ = true;
    }

    void release() { engaged_ = false; }

    double longest_step(const double *s, const double *, double longest_s) const override {
        if (!engaged_) return longest_s;
        const double speed = s[kV] * along_W_[0] + s[kV + 1] * along_W_[1] + s[kV + 2] * along_W_[2];
        const double left = length_m_ - way(s);
        if (left > 0.0 && speed > 0.0 && left < speed * longest_s) return left / speed;
        return longest_s;
    }

    void add(const Instant &now, Wrench &out) const override {
        if (!engaged_) return;
        const double s = way(now.s), pull = force_n_ - stiffness_npm_ * s;
        if (!(s < length_m_) || !(pull > 0.0)) return;
        const ::Vec3 &d = along_W_;
        for (int j = 0; j < 3; ++j) out.force_B[j] += pull * (now.R[j] * d[0] + now.R[3 + j] * d[1] + now.R[6 + j] * d[2]);
    }

    void repair() override { engaged_ = false; }

  private:
    double way(const double *s) const {
        return (s[kP] - from_W_m_[0]) * along_W_[0] + (s[kP + 1] - from_W_m_[1]) * along_W_[1] +
               (s[kP + 2] - from_W_m_[2]) * along_W_[2];
    }

    ::Vec3 from_W_m_{0.0, 0.0, 0.0}, along_W_{1.0, 0.0, 0.0};
    double force_n_ = 0.0, stiffness_npm_ = 0.0, length_m_ = 0.0;
    bool engaged_ = false;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Launcher, Force>(m, "Launcher", "Pull of a launcher along its rail; see forces/launcher.cpp.")
        .def(nb::init<>())
        .def("engage", &Launcher::engage, nb::kw_only(), "from_W_m"_a, "along_W"_a, "force_n"_a, "stiffness_npm"_a,
             "length_m"_a, "Pull from the coming tick on.")
        .def("release", &Launcher::release, "Pull no more.");
}};

}  // namespace

}  // namespace hil::sim
