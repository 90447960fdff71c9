// sim._kernels.Dryden: turbulence at the vehicle, one sample per call. See dryden.hpp.

#include "bind_arrays.hpp"
#include "dryden.hpp"

namespace {

class Dryden {
  public:
    Dryden(const nb::tuple &normals, double wind_20ft_mps, double dt_s) : wind_20ft_mps_(wind_20ft_mps), dt_s_(dt_s) {
        if (!(wind_20ft_mps >= 0.0) || !(dt_s > 0.0)) {
            throw std::invalid_argument("wind_20ft_mps must be 0 or more and dt_s above 0");
        }
        double n[hil::sim::kDrydenLanes];
        unpack(normals, n, "normals");
        state_ = hil::sim::dryden_start(n);
    }

    nb::tuple sample(double height_m) const {
        double out[3];
        hil::sim::dryden_sample(state_, hil::sim::dryden_scale(height_m, wind_20ft_mps_), out);
        return nb::make_tuple(out[0], out[1], out[2]);
    }

    nb::tuple step(double height_m, double airspeed_mps, const nb::tuple &normals) {
        double n[hil::sim::kDrydenLanes], out[3];
        unpack(normals, n, "normals");
        hil::sim::dryden_step(state_, hil::sim::dryden_scale(height_m, wind_20ft_mps_), airspeed_mps, dt_s_, n, out);
        return nb::make_tuple(out[0], out[1], out[2]);
    }

  private:
    hil::sim::DrydenState state_{};
    double wind_20ft_mps_, dt_s_;
};

}  // namespace

void bind_dryden(nb::module_ &m) {
    m.def(
        "dryden_scale",
        [](double height_m, double wind_20ft_mps) {
            const auto s = hil::sim::dryden_scale(height_m, wind_20ft_mps);
            return nb::make_tuple(s.sigma_uv, s.sigma_w, s.length_uv, s.length_w);
        },
        "height_m"_a, "wind_20ft_mps"_a, "Return (sigma_u, sigma_w [m/s], L_u, L_w [m]) of MIL-F-8785C at this height.");
    nb::class_<Dryden>(m, "Dryden", "Dryden turbulence at the vehicle, MIL-F-8785C. See sim/native/dryden.hpp.")
        .def(nb::init<const nb::tuple &, double, double>(), nb::kw_only(), "normals"_a, "wind_20ft_mps"_a, "dt_s"_a)
        .def("sample", &Dryden::sample, "height_m"_a, "Return the current velocity along, left of and up from the wind [m/s].")
        .def("step", &Dryden::step, "height_m"_a, "airspeed_mps"_a, "normals"_a,
             "Advance by dt with 5 standard normals; return the velocity along, left of and up from the wind [m/s].");
}
