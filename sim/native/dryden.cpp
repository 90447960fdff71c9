#include "dryden.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {

namespace {

constexpr double kMetresPerFoot = 0.3048;
constexpr double kSqrt3 = 1.73205080756887729353, kInvSqrt2 = 0.70710678118654752440;

// Advances a pair of states by d = dt / T.
void second_order(double *x, double d, const double *n) {
    const double e = det::exp(-d);
    const double q11 = 1.0 - e * e;
    const double q12 = 0.5 - (e * e) * (0.5 + d);
    // 1/2 - e^{-2d} (1/2 + d + d^2) cancels for small d, where it is about 2/3 d^3.
    const double q22 = d > 0.02 ? 0.5 - (e * e) * (0.5 + d + d * d)
                                : d * d * d * (2.0 / 3.0 + d * (-1.0 + d * (0.8 - d * (4.0 / 9.0))));
    const double l11 = std::sqrt(q11);
    const double l21 = q12 / l11;
    const double rest = q22 - l21 * l21;
    const double l22 = rest > 0.0 ? std::sqrt(rest) : 0.0;
    const double before = x[0];
    x[0] = e * before + l11 * n[0];
    x[1] = e * (x[1] + d * before) + (l21 * n[0] + l22 * n[1]);
}

}  // namespace

DrydenScale dryden_scale(double height_m, double wind_20ft_mps) {
    double h = height_m / kMetresPerFoot;
    h = h < 10.0 ? 10.0 : (h > 1000.0 ? 1000.0 : h);
    const double shape = 0.177 + 0.000823 * h;
    const double root = det::exp(0.4 * det::log(shape));  // shape^0.4
    DrydenScale scale;
    scale.sigma_w = 0.1 * wind_20ft_mps;
    scale.sigma_uv = scale.sigma_w / root;
    scale.length_w = h * kMetresPerFoot;
    scale.length_uv = scale.length_w / (root * root * root);
    return scale;
}

DrydenState dryden_start(const double *n) {
    // Cholesky factor of ((1, 1/2), (1/2, 1/2)): rows (1, 0) and (1/2, 1/2).
    return {n[0], {n[1], 0.5 * (n[1] + n[2])}, {n[3], 0.5 * (n[3] + n[4])}};
}

void dryden_sample(const DrydenState &state, const DrydenScale &scale, double *out) {
    out[0] = scale.sigma_uv * state.u;
    out[1] = scale.sigma_uv * (kInvSqrt2 * (kSqrt3 * state.v[0] + (1.0 - kSqrt3) * state.v[1]));
    out[2] = scale.sigma_w * (kInvSqrt2 * (kSqrt3 * state.w[0] + (1.0 - kSqrt3) * state.w[1]));
}

void dryden_step(DrydenState &state, const DrydenScale &scale, double airspeed_mps, double dt_s, const double *n,
                 double *out) {
    const double along = dt_s * airspeed_mps / scale.length_uv;
    const double e = det::exp(-along);
    state.u = e * state.u + std::sqrt(1.0 - e * e) * n[0];
    second_order(state.v, along, n + 1);
    second_order(state.w, dt_s * airspeed_mps / scale.length_w, n + 3);
    dryden_sample(state, scale, out);
}

}  // namespace hil::sim
