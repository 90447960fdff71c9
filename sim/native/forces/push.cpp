// Force of a given size along the axes of W at the centre of mass: a payload, a rope, a gust's share.
//
//   F = R^T F_W,  M = 0

#include "force_binding.hpp"

namespace hil::sim {

namespace {

class Push : public Force {
  public:
    explicit Push(::Vec3 force_W_n) : first_W_n_(force_W_n), force_W_n_(force_W_n) {}

    void set(::Vec3 force_W_n) { force_W_n_ = force_W_n; }

    void add(const Instant &now, Wrench &out) const override {
        const ::Vec3 &f = force_W_n_;
        if (f[0] == 0.0 && f[1] == 0.0 && f[2] == 0.0) return;
        for (int j = 0; j < 3; ++j) out.force_B[j] += now.R[j] * f[0] + now.R[3 + j] * f[1] + now.R[6 + j] * f[2];
    }

    void repair() override { force_W_n_ = first_W_n_; }

  private:
    ::Vec3 first_W_n_, force_W_n_;
};

const ForceBinding binding{[](nb::module_ &m) {
    nb::class_<Push, Force>(m, "Push", "Force along the axes of W at the centre of mass; see forces/push.cpp.")
        .def(nb::init<::Vec3>(), nb::kw_only(), "force_W_n"_a)
        .def("set", &Push::set, "force_W_n"_a, "Set the force from the next tick on.");
}};

}  // namespace

}  // namespace hil::sim
