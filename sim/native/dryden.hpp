// Dryden turbulence of MIL-F-8785C (3.7.2.2, low-altitude model 3.7.3), one sample per tick.
//
// h height [ft], limited to the model's 10..1000 ft; W20 mean wind at 20 ft; V speed through the air:
//   sigma_w = 0.1 W20                                     L_w = h
//   sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4     L_u = L_v = h / (0.177 + 0.000823 h)^1.2
//   H_u(s) = sigma_u sqrt(2 L_u / pi V) 1 / (1 + L_u s / V)
//   H_v(s) = sigma_v sqrt(L_v / pi V) (1 + sqrt(3) L_v s / V) / (1 + L_v s / V)^2,  H_w likewise with sigma_w, L_w
//
// The filters are discretised exactly. With T = L / V, d = dt / T, e = e^{-d} and unit-variance states
//   x1' = e x1 + n1,  x2' = e (x2 + d x1) + n2,   cov(n) from the stationary covariance ((1, 1/2), (1/2, 1/2))
//   u = sigma x1,   v, w = sigma (sqrt(3) x1 + (1 - sqrt(3)) x2) / sqrt(2)
// so variance and spectrum are those of the continuous filters for any tick, also while h and V change.
//
// Deterministic: + - * / sqrt and detmath.hpp. No allocation.
#pragma once

namespace hil::sim {

inline constexpr int kDrydenLanes = 5;  // standard normals per sample: u 1, v 2, w 2

struct DrydenState {
    double u;
    double v[2];
    double w[2];
};

struct DrydenScale {
    double sigma_uv, sigma_w;  // m/s
    double length_uv, length_w;  // m
};
DrydenScale dryden_scale(double height_m, double wind_20ft_mps);

// Stationary start from kDrydenLanes standard normals.
DrydenState dryden_start(const double *normals);

// Next sample after dt at `airspeed_mps` (> 0). `out`: along, left of, and up from the wind's direction [m/s].
void dryden_step(DrydenState &state, const DrydenScale &scale, double airspeed_mps, double dt_s, const double *normals,
                 double *out);

// Sample of `state`, without a step.
void dryden_sample(const DrydenState &state, const DrydenScale &scale, double *out);

}  // namespace hil::sim
