// Loads of four rotors at a time. Contract: blade_lanes.hpp; equations: blade_rotors.hpp.
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

struct Flux {
    Quad square, half_slope;  // W^2, dW^2/dv / 2
};

HIL_QUAD Flux flux(const Quad &u, const Quad &u2, const Quad &spread0, const Quad &across2, const Quad &v) {
    const Quad v2 = v * v, lean = u + kShift * v;
    const Quad inverse = splat(1.0) / (v2 + kInverseWidth2 * (lean * lean) + spread0);
    const Quad share = v2 * inverse, share2 = share * share;
    const Quad curve = (kDip * v2 + kSkew * (u * v)) + kMixing * u2;
    const Quad pull = u2 * inverse, through = u + v;
    const Quad spread_slope = v + (kInverseWidth2 * kShift) * lean;  // half of dE/dv
    const Quad curve_slope = kDip * v + (0.5 * kSkew) * u;           // half
    const Quad square = (across2 + through * through) + pull * (share2 * share * curve);
    const Quad slope = through + pull * share2 *
                                     (share * (curve_slope - 4.0 * (curve * spread_slope * inverse)) +
                                      3.0 * (v * curve * inverse));
    return {square + splat(kTiny), slope};
}

HIL_QUAD void block(BladeLanes &l, int at, const Quad &wake) {
    const Quad rx = load(l.r[0] + at), ry = load(l.r[1] + at), rz = load(l.r[2] + at);
    const Quad nx = load(l.n[0] + at), ny = load(l.n[1] + at), nz = load(l.n[2] + at);
    const double *w = l.w;
    const Quad ux = splat(l.air_B[0]) + (w[1] * rz - w[2] * ry);
    const Quad uy = splat(l.air_B[1]) + (w[2] * rx - w[0] * rz);
    const Quad uz = splat(l.air_B[2]) + (w[0] * ry - w[1] * rx);
    const Quad along = (ux * nx + uy * ny) + uz * nz;
    const Quad ax = ux - along * nx, ay = uy - along * ny, az = uz - along * nz;
    const Quad across2 = (ax * ax + ay * ay) + az * az;
    const Quad u = along + wake;

    const Quad speed = load(l.speed + at), speed2 = speed * speed;
    const Quad induced2 = load(l.kappa + at) * speed2;
    const double radius2 = l.radius_m * l.radius_m;
    const Quad per_speed = radius2 * speed / (radius2 * speed2 + across2 + splat(kTiny));  // p / O
    const Quad edgewise = per_speed * speed;
    const Quad edge = edgewise * across2;
    Quad left = splat(1.0);  // 1 - gamma
    if (l.ground_floor > 0.0) {
        const Quad height = splat(l.height_m) + ((l.up_B[0] * rx + l.up_B[1] * ry) + l.up_B[2] * rz);
        const Quad level = positive((l.up_B[0] * nx + l.up_B[1] * ny) + l.up_B[2] * nz), level2 = level * level;
        const double reach = kGroundReachRadii * l.radius_m;
        const Quad near = positive(splat(1.0) - (1.0 / (reach * reach)) * (height * height)), near2 = near * near;
        const Quad fade = (level2 * level2) * (near2 * near2) * induced2;
        const Quad z = (4.0 / l.radius_m) * height;
        left = left - kHayden * fade / ((splat(l.ground_floor) + z * z) * (induced2 + across2 + splat(kTiny)));
    }

    const Quad loading = load(l.l_disc + at) * speed, slowed = loading * left;
    const Quad pushed = (load(l.t_disc + at) * speed2 + load(l.v_disc + at) * edge) - loading * u;
    const Quad u2 = u * u, spread0 = kAcross * across2 + splat(kTiny);
    Quad v = pushed / (slowed + sqrt(across2 + induced2 + 0.3 * u2 + splat(kTiny)) + 0.3 * u);
    Quad flow, square, half_slope, step;
    for (int k = 0; k < kMostSteps; ++k) {
        const Flux f = flux(u, u2, spread0, across2, v);
        square = f.square;
        half_slope = f.half_slope;
        flow = sqrt(square);
        step = (v * (flow + slowed) - pushed) * flow / (square + v * half_slope + slowed * flow);
        v = v - step;
        if (!any_above(step * step, kSettled2 * (v * v) + splat(kTiny))) break;
    }
    const Quad induced = left * v, through = u + induced;
    const Quad c_t = load(l.c_t + at), c_l = load(l.c_l + at), c_v = load(l.c_v + at), c_q = load(l.c_q + at);
    const Quad ratio = splat(l.density_ratio);
    const Quad thrust_per_speed = (c_t * speed + c_v * (per_speed * across2)) - c_l * through;
    const Quad across_per_speed = (splat(l.k_d) + c_v * (per_speed * through)) + (2.0 / radius2) * c_q;
    const Quad torque = (thrust_per_speed * (u + l.induced_power_factor * induced) - across_per_speed * across2) +
                        c_q * (speed2 + (l.profile_power_growth / radius2) * edge);
    const Quad strength = ratio * speed;
    const Quad thrust = strength * thrust_per_speed, drag = strength * across_per_speed;
    const Quad share = splat(l.hub_moment_share) * ratio;
    const Quad roll = load(l.spin + at) * share * edgewise * (c_t * speed - 0.5 * (c_l * through));
    // W at the new v to first order: the last step is small.
    const Quad pitch = (0.25 * 1.4142135623730951 * l.radius_m) * (share * c_l * induced * speed * flow) /
                       (square - half_slope * step);
    const Quad fx = thrust * nx - drag * ax, fy = thrust * ny - drag * ay, fz = thrust * nz - drag * az;
    store(l.force[0] + at, fx);
    store(l.force[1] + at, fy);
    store(l.force[2] + at, fz);
    store(l.moment[0] + at, (ry * fz - rz * fy) - (roll * ax + pitch * (ny * az - nz * ay)));
    store(l.moment[1] + at, (rz * fx - rx * fz) - (roll * ay + pitch * (nz * ax - nx * az)));
    store(l.moment[2] + at, (rx * fy - ry * fx) - (roll * az + pitch * (nx * ay - ny * ax)));
    store(l.torque + at, ratio * torque);
    store(l.induced + at, v);
}

void loads(BladeLanes &l) {
    for (int at = 0; at < l.uppers; at += 4) block(l, at, splat(0.0));
    for (int at = l.uppers; at < l.lanes; at += 4) {
        double wake[4];
        for (int k = 0; k < 4; ++k) wake[k] = l.wake[at + k] * l.induced[l.above[at + k]];
        block(l, at, load(wake));
    }
}

}  // namespace

extern const BladeKernel blade_kernel;
const BladeKernel blade_kernel{&loads};

}  // namespace hil::sim::HIL_ISA
