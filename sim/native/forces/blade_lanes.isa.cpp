// Loads of four or eight rotors at a time. Contract: blade_lanes.hpp; equations: blade_rotors.hpp.
#include "blade_lanes.hpp"
#include "quad.hpp"

namespace hil::sim::HIL_ISA {

namespace {

constexpr double kShift = 0.19, kInverseWidth2 = 1.21, kAcross = 2.0;  // s, 1/d^2, e
constexpr double kDip = -1.24, kSkew = 0.46, kMixing = 2.73;           // a, b, c
constexpr double kHayden = 16.0 * 4.0 * 0.0379;
constexpr double kGroundReachRadii = 32.0;
constexpr double kTiny = 1e-30;      // (m/s)^2: 0/0 of a rotor that stands in still air is 0
constexpr int kMostSteps = 12;       // 8 are enough from the start below (rotor_equations.py)
constexpr double kSettled2 = 1e-16;  // (last step / v)^2: the next one would be below the rounding

template <int N>
struct Flux {
    Quads<N> square, half_slope;  // W^2, dW^2/dv / 2
};

template <int N>
HIL_QUAD Flux<N> flux(const Quads<N> &u, const Quads<N> &u2, const Quads<N> &spread0, const Quads<N> &across2, const Quads<N> &v) {
    const Quads<N> v2 = v * v, lean = u + kShift * v;
    const Quads<N> inverse = splat<N>(1.0) / (v2 + kInverseWidth2 * (lean * lean) + spread0);
    const Quads<N> share = v2 * inverse, share2 = share * share;
    const Quads<N> curve = (kDip * v2 + kSkew * (u * v)) + kMixing * u2;
    const Quads<N> pull = u2 * inverse, through = u + v;
    const Quads<N> spread_slope = v + (kInverseWidth2 * kShift) * lean;  // half of dE/dv
    const Quads<N> curve_slope = kDip * v + (0.5 * kSkew) * u;           // half
    const Quads<N> square = (across2 + through * through) + pull * (share2 * share * curve);
    const Quads<N> slope = through + pull * share2 *
                                     (share * (curve_slope - 4.0 * (curve * spread_slope * inverse)) +
                                      3.0 * (v * curve * inverse));
    return {square + splat<N>(kTiny), slope};
}

template <int N>
HIL_QUAD void block(BladeLanes &l, int at, const Quads<N> &wake) {
    const Quads<N> rx = load<N>(l.r[0] + at), ry = load<N>(l.r[1] + at), rz = load<N>(l.r[2] + at);
    const Quads<N> nx = load<N>(l.n[0] + at), ny = load<N>(l.n[1] + at), nz = load<N>(l.n[2] + at);
    const double *w = l.w;
    Quads<N> ux = splat<N>(l.air_B[0]) + (w[1] * rz - w[2] * ry);
    Quads<N> uy = splat<N>(l.air_B[1]) + (w[2] * rx - w[0] * rz);
    Quads<N> uz = splat<N>(l.air_B[2]) + (w[0] * ry - w[1] * rx);
    if (l.drifts) {
        ux = ux + load<N>(l.drift[0] + at);
        uy = uy + load<N>(l.drift[1] + at);
        uz = uz + load<N>(l.drift[2] + at);
    }
    const Quads<N> along = (ux * nx + uy * ny) + uz * nz;
    const Quads<N> ax = ux - along * nx, ay = uy - along * ny, az = uz - along * nz;
    const Quads<N> across2 = (ax * ax + ay * ay) + az * az;
    const Quads<N> u = along + wake;

    const Quads<N> speed = load<N>(l.speed + at), speed2 = speed * speed;
    const Quads<N> induced2 = load<N>(l.kappa + at) * speed2;
    const double radius2 = l.radius_m * l.radius_m;
    const Quads<N> per_speed = radius2 * speed / (radius2 * speed2 + across2 + splat<N>(kTiny));  // p / O
    const Quads<N> edgewise = per_speed * speed;
    const Quads<N> edge = edgewise * across2;
    Quads<N> left = splat<N>(1.0);  // 1 - gamma
    if (l.ground_floor > 0.0) {
        const Quads<N> height = splat<N>(l.height_m) + ((l.up_B[0] * rx + l.up_B[1] * ry) + l.up_B[2] * rz);
        const Quads<N> level = positive((l.up_B[0] * nx + l.up_B[1] * ny) + l.up_B[2] * nz), level2 = level * level;
        const double reach = kGroundReachRadii * l.ground_radius_m;
        const Quads<N> near = positive(splat<N>(1.0) - (1.0 / (reach * reach)) * (height * height)), near2 = near * near;
        const Quads<N> fade = (level2 * level2) * (near2 * near2) * induced2;
        const Quads<N> z = (4.0 / l.ground_radius_m) * height;
        left = left - kHayden * fade / ((splat<N>(l.ground_floor) + z * z) * (induced2 + across2 + splat<N>(kTiny)));
    }

    const Quads<N> loading = load<N>(l.l_disc + at) * speed, slowed = loading * left;
    const Quads<N> pushed = (load<N>(l.t_disc + at) * speed2 + load<N>(l.v_disc + at) * edge) - loading * u;
    const Quads<N> u2 = u * u, spread0 = kAcross * across2 + splat<N>(kTiny);
    Quads<N> v = pushed / (slowed + sqrt(across2 + induced2 + 0.3 * u2 + splat<N>(kTiny)) + 0.3 * u);
    Quads<N> flow, square, half_slope, step;
    for (int k = 0; k < kMostSteps; ++k) {
        const Flux<N> f = flux(u, u2, spread0, across2, v);
        square = f.square;
        half_slope = f.half_slope;
        flow = sqrt(square);
        step = (v * (flow + slowed) - pushed) * flow / (square + v * half_slope + slowed * flow);
        v = v - step;
        if (!any_above(step * step, kSettled2 * (v * v) + splat<N>(kTiny))) break;
    }
    const Quads<N> induced = left * v, through = u + induced;
    const Quads<N> c_t = load<N>(l.c_t + at), c_l = load<N>(l.c_l + at), c_v = load<N>(l.c_v + at), c_q = load<N>(l.c_q + at);
    const Quads<N> ratio = splat<N>(l.density_ratio);
    const Quads<N> thrust_per_speed = (c_t * speed + c_v * (per_speed * across2)) - c_l * through;
    const Quads<N> across_per_speed = (splat<N>(l.k_d) + c_v * (per_speed * through)) + (2.0 / radius2) * c_q;
    const Quads<N> torque = (thrust_per_speed * (u + l.induced_power_factor * induced) - across_per_speed * across2) +
                        c_q * (speed2 + (l.profile_power_growth / radius2) * edge);
    const Quads<N> strength = ratio * speed;
    const Quads<N> thrust = strength * thrust_per_speed, drag = strength * across_per_speed;
    const Quads<N> share = splat<N>(l.hub_moment_share) * ratio;
    const Quads<N> roll = load<N>(l.spin + at) * share * edgewise * (c_t * speed - 0.5 * (c_l * through));
    // W at the new v to first order: the last step is small.
    const Quads<N> pitch = (0.25 * 1.4142135623730951 * l.radius_m) * (share * c_l * induced * speed * flow) /
                       (square - half_slope * step);
    const Quads<N> fx = thrust * nx - drag * ax, fy = thrust * ny - drag * ay, fz = thrust * nz - drag * az;
    store(l.force[0] + at, fx);
    store(l.force[1] + at, fy);
    store(l.force[2] + at, fz);
    store(l.moment[0] + at, (ry * fz - rz * fy) - (roll * ax + pitch * (ny * az - nz * ay)));
    store(l.moment[1] + at, (rz * fx - rx * fz) - (roll * ay + pitch * (nz * ax - nx * az)));
    store(l.moment[2] + at, (rx * fy - ry * fx) - (roll * az + pitch * (nx * ay - ny * ax)));
    store(l.torque + at, ratio * torque);
    store(l.induced + at, v);
}

// Rotors `from` to `to` - 1, each with the flow of `wake` from above.
void group(BladeLanes &l, int from, int to, const double *wake) {
    int at = from;
    for (; at + 8 <= to; at += 8) block<2 * kQuadParts>(l, at, load<2 * kQuadParts>(wake + at));
    if (at < to) block<kQuadParts>(l, at, load<kQuadParts>(wake + at));
}

void loads(BladeLanes &l) {
    double wake[kBladeLanes] = {};
    group(l, 0, l.uppers, wake);
    for (int at = l.uppers; at < l.lanes; ++at) wake[at] = l.wake[at] * l.induced[l.above[at]];
    group(l, l.uppers, l.lanes, wake);
}

}  // namespace

extern const BladeKernel blade_kernel;
const BladeKernel blade_kernel{&loads};

}  // namespace hil::sim::HIL_ISA
