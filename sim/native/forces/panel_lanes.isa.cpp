// Loads of four or eight panels at a time. Contract: panel_lanes.hpp; equations: panels.hpp, slipstream.hpp.
//
// Divisions and roots take most of the time, so that fractions of one panel share a denominator: with V the speed,
// P = S - m V, S = s V, C = c V,
//   f   = (V + C)^2 (2 V - C) h^8 V^5 / (4 (h^8 V^8 + P^8))
//   C_n = C_90 S V / (V (0.56 V + 0.44 sqrt(S^2 + 0.05^2 V^2)))
#include "panel_lanes.hpp"
#include "quad.hpp"

namespace hil::sim::HIL_ISA {

namespace {

constexpr double kCalm2 = 0.09;    // V_0^2
constexpr double kSlack2 = 4.0;    // of a slipstream
constexpr double kFlat2 = 0.0025;  // of |s|

template <int N>
HIL_QUAD Quads<N> dot(const Quads<N> &ax, const Quads<N> &ay, const Quads<N> &az, const Quads<N> &bx, const Quads<N> &by,
                      const Quads<N> &bz) {
    return (ax * bx + ay * by) + az * bz;
}

// f as a fraction.
template <int N>
struct Share {
    Quads<N> above, below;
};

template <int N>
HIL_QUAD Share<N> attached(const PanelLanes &l, int at, const Quads<N> &V, const Quads<N> &V2, const Quads<N> &S,
                           const Quads<N> &C) {
    const Quads<N> P = S - load<N>(l.stall_middle + at) * V, P2 = P * P, P4 = P2 * P2, V4 = V2 * V2, ahead = V + C;
    const Quads<N> width8 = load<N>(l.stall_width8 + at);
    return {0.25 * (ahead * ahead) * (V + V - C) * (width8 * (V4 * V)), width8 * (V4 * V4) + P4 * P4};
}

// Places of the panels in the slipstream `k`.
template <int N>
HIL_QUAD void place(PanelLanes &l, int k, const Slipstream &from, int at) {
    const double *n = from.axis, *o = from.place_m;
    const Quads<N> dx = load<N>(l.seen[0] + at) - splat<N>(o[0]), dy = load<N>(l.seen[1] + at) - splat<N>(o[1]),
                   dz = load<N>(l.seen[2] + at) - splat<N>(o[2]);
    const Quads<N> ahead = (n[0] * dx + n[1] * dy) + n[2] * dz, ahead2 = ahead * ahead;
    store(l.off2[k] + at, dot(dx, dy, dz, dx, dy, dz) - ahead2);
    store(l.grown[k] + at, splat<N>(1.0) - ahead / sqrt(ahead2 + splat<N>(from.radius_m * from.radius_m)));
}

// Sine and cosine of t by its half angle.
template <int N>
HIL_QUAD void shift(PanelLanes &l, int at) {
    const Quads<N> half = 0.5 * (load<N>(l.bend + at) - load<N>(l.zero_lift + at)), half2 = half * half;
    const Quads<N> inverse = splat<N>(1.0) / (splat<N>(1.0) + half2);
    store(l.shift_sine + at, (half + half) * inverse);
    store(l.shift_cosine + at, (splat<N>(1.0) - half2) * inverse);
}

// Velocities of the panels through the air in their own axes, and what lifting ones pass to the influence.
template <int N>
HIL_QUAD void flow(PanelLanes &l, int at, bool lifting) {
    const Quads<N> rx = load<N>(l.seen[0] + at), ry = load<N>(l.seen[1] + at), rz = load<N>(l.seen[2] + at);
    const double *w = l.w;
    Quads<N> ux = splat<N>(l.air_B[0]) + (w[1] * rz - w[2] * ry);
    Quads<N> uy = splat<N>(l.air_B[1]) + (w[2] * rx - w[0] * rz);
    Quads<N> uz = splat<N>(l.air_B[2]) + (w[0] * ry - w[1] * rx);
    Quads<N> stirred = splat<N>(0.0);
    const int streams = l.slipstreams ? l.slipstreams->count : 0;
    for (int k = 0; k < streams; ++k) {
        const Slipstream &from = l.slipstreams->of[k];
        const double v = from.induced_mps;
        if (v == 0.0) {
            stirred = stirred + splat<N>(from.rate_mps2);
            continue;
        }
        const double *n = from.axis;
        const double v2 = v * v, speed2 = from.axial_mps * from.axial_mps + from.across2 + kSlack2;
        const double through = from.axial_mps + v, through2 = through * through;
        const double strength = v * through2 / (through2 + from.across2 + kSlack2);
        const double narrowed = 1.0 / (from.radius_m * from.radius_m * (speed2 + v2));
        const Quads<N> grown = load<N>(l.grown[k] + at);
        const Quads<N> off = narrowed * (load<N>(l.off2[k] + at) * (splat<N>(speed2) + v2 * grown)), off2 = off * off;
        const Quads<N> added = strength * grown / (splat<N>(1.0) + off2 * off2);
        stirred = stirred + (from.rate_mps2 / v) * added;
        ux = ux + n[0] * added;
        uy = uy + n[1] * added;
        uz = uz + n[2] * added;
    }
    const Quads<N> u = dot(ux, uy, uz, load<N>(l.x[0] + at), load<N>(l.x[1] + at), load<N>(l.x[2] + at));
    const Quads<N> v = splat<N>(0.0) - dot(ux, uy, uz, load<N>(l.z[0] + at), load<N>(l.z[1] + at), load<N>(l.z[2] + at));
    store(l.stirred + at, stirred);
    store(l.along + at, u);
    store(l.across + at, dot(ux, uy, uz, load<N>(l.y[0] + at), load<N>(l.y[1] + at), load<N>(l.y[2] + at)));
    store(l.through + at, v);
    if (!lifting) return;
    const Quads<N> sine = load<N>(l.shift_sine + at), cosine = load<N>(l.shift_cosine + at);
    const Quads<N> S = v * cosine + u * sine, C = u * cosine - v * sine;
    const Quads<N> V2 = (u * u + v * v) + splat<N>(kCalm2);
    const Share<N> f = attached<N>(l, at, sqrt(V2), V2, load<N>(l.reduced + at) * S, C);
    store(l.passed + at, f.above * S / f.below);
}

// Velocities induced at the panels from `at` on by what all pass, in the order of the panels.
template <int N>
HIL_QUAD void induce(PanelLanes &l, int at) {
    Quads<N> even = splat<N>(0.0), odd = even, even_tilt = even, odd_tilt = even;
    for (int j = 0; j < l.lifting; j += 2) {
        even = even + l.passed[j] * load<N>(l.influence[j] + at);
        odd = odd + l.passed[j + 1] * load<N>(l.influence[j + 1] + at);
        even_tilt = even_tilt + l.passed[j] * load<N>(l.tilting[j] + at);
        odd_tilt = odd_tilt + l.passed[j + 1] * load<N>(l.tilting[j + 1] + at);
    }
    Quads<N> w = even + odd, tilt = even_tilt + odd_tilt;
    if (l.near_ground) {
        const Quads<N> height = splat<N>(l.height_m) + ((l.up_B[0] * load<N>(l.middle[0] + at) +
                                                         l.up_B[1] * load<N>(l.middle[1] + at)) +
                                                        l.up_B[2] * load<N>(l.middle[2] + at));
        const Quads<N> height2 = height * height;
        const Quads<N> fade = positive(splat<N>(1.0) - l.ground_fade_per_m2 * height2), fade2 = fade * fade;
        const Quads<N> spans2 = (l.ground_per_m * l.ground_per_m) * height2;
        const Quads<N> left = splat<N>(1.0) - fade2 * fade2 / (splat<N>(1.0) + spans2);
        w = w * left;
        tilt = tilt * left;
    }
    store(l.induced + at, w);
    store(l.tilted + at, tilt);
}

template <int N>
HIL_QUAD void loads_of(PanelLanes &l, int at, bool lifting) {
    const Quads<N> u = load<N>(l.along + at), through = load<N>(l.through + at);
    const Quads<N> cd0 = load<N>(l.drag + at), c90 = load<N>(l.plate + at);
    Quads<N> leaning = through, V, lift, drag, moment, c_chord;
    if (lifting) {
        const Quads<N> v = through - load<N>(l.induced + at);
        leaning = through - load<N>(l.tilted + at);
        const Quads<N> sine = load<N>(l.shift_sine + at), cosine = load<N>(l.shift_cosine + at);
        const Quads<N> V2 = (u * u + v * v) + splat<N>(kCalm2);
        const Quads<N> S = v * cosine + u * sine, C = u * cosine - v * sine, S2 = S * S;
        V = sqrt(V2);
        const Share<N> f = attached<N>(l, at, V, V2, S, C);
        const Quads<N> blunt = 0.56 * V + 0.44 * sqrt(S2 + kFlat2 * V2), plate_below = V * blunt;
        const Quads<N> inverse = splat<N>(1.0) / (f.below * plate_below);
        const Quads<N> per_plate = inverse * f.below, per_speed = per_plate * blunt;
        const Quads<N> share = f.above * (inverse * plate_below), rest = splat<N>(1.0) - share;
        const Quads<N> s = S * per_speed, normal = rest * (c90 * (S * (V * per_plate)));
        const Quads<N> section = load<N>(l.slope + at) * s;
        lift = share * section + normal * (C * per_speed);
        drag = cd0 + (share * (load<N>(l.drag_of_lift + at) * (section * section)) + normal * s);
        const Quads<N> turning = (l.w[0] * load<N>(l.y[0] + at) + l.w[1] * load<N>(l.y[1] + at)) + l.w[2] * load<N>(l.y[2] + at);
        const Quads<N> chord = load<N>(l.chord + at), damped = 0.0625 * (load<N>(l.slope + at) * chord * turning);
        moment = share * ((load<N>(l.moment + at) + load<N>(l.flap_moment + at)) * V + damped) * chord;
        c_chord = u * per_speed;
    } else {
        const Quads<N> V2 = (u * u + through * through) + splat<N>(kCalm2);
        V = sqrt(V2);
        const Quads<N> per_speed = splat<N>(1.0) / V, s = through * per_speed;
        const Quads<N> normal = c90 * (s * sqrt(s * s + splat<N>(kFlat2)));
        c_chord = u * per_speed;
        lift = normal * c_chord;
        drag = cd0 + normal * s;
        moment = splat<N>(0.0);
    }
    const Quads<N> pressure = l.half_density * (load<N>(l.area + at) * V);
    const Quads<N> fx = pressure * (lift * leaning - drag * u), fz = pressure * (lift * u + drag * leaning);
    const Quads<N> fy = splat<N>(0.0) - pressure * (cd0 * load<N>(l.across + at));
    const Quads<N> turn = splat<N>(0.0) - pressure * moment;
    Quads<N> f[3], r[3];
    for (int j = 0; j < 3; ++j) {
        f[j] = dot(fx, fy, fz, load<N>(l.x[j] + at), load<N>(l.y[j] + at), load<N>(l.z[j] + at));
        r[j] = load<N>(l.middle[j] + at) + c_chord * load<N>(l.ahead[j] + at);
        store(l.force[j] + at, f[j]);
    }
    store(l.torque[0] + at, (r[1] * f[2] - r[2] * f[1]) + turn * load<N>(l.y[0] + at));
    store(l.torque[1] + at, (r[2] * f[0] - r[0] * f[2]) + turn * load<N>(l.y[1] + at));
    store(l.torque[2] + at, (r[0] * f[1] - r[1] * f[0]) + turn * load<N>(l.y[2] + at));
}

// Notes where the slipstreams are, if any has moved in the body since it was last seen.
void look(PanelLanes &l) {
    if (!l.slipstreams) return;
    const int streams = l.slipstreams->count;
    for (int k = 0; k < streams; ++k) {
        const Slipstream &from = l.slipstreams->of[k];
        const double now[7] = {from.place_m[0], from.place_m[1], from.place_m[2], from.axis[0],
                               from.axis[1],    from.axis[2],    from.radius_m};
        bool same = k < l.seen_streams;
        for (int j = 0; j < 7 && same; ++j) same = l.seen_place[k][j] == now[j];
        if (same) continue;
        for (int j = 0; j < 7; ++j) l.seen_place[k][j] = now[j];
        for (int at = 0; at < l.lanes; at += 4) place<kQuadParts>(l, k, from, at);
    }
    l.seen_streams = streams;
}

// Sum over the lanes: of every fourth, then of these four.
double sum_of(const double *lanes, int count) {
    Quads<kQuadParts> all = load<kQuadParts>(lanes);
    for (int at = 4; at < count; at += 4) all = all + load<kQuadParts>(lanes + at);
    double four[4];
    store(four, all);
    return (four[0] + four[1]) + (four[2] + four[3]);
}

void loads(PanelLanes &l) {
    constexpr int kOne = kQuadParts, kTwo = 2 * kQuadParts;
    look(l);
    if (l.bent) {
        for (int first = 0; first < l.lifting; first += 4) shift<kOne>(l, first);
        l.bent = false;
    }
    int at = 0;
    for (; at + 8 <= l.lifting; at += 8) flow<kTwo>(l, at, true);
    if (at < l.lifting) flow<kOne>(l, at, true);
    for (at = l.lifting; at < l.lanes; at += 4) flow<kOne>(l, at, false);
    for (at = 0; at + 8 <= l.lifting; at += 8) induce<kTwo>(l, at);
    if (at < l.lifting) induce<kOne>(l, at);
    for (at = 0; at + 8 <= l.lifting; at += 8) loads_of<kTwo>(l, at, true);
    if (at < l.lifting) loads_of<kOne>(l, at, true);
    for (at = l.lifting; at < l.lanes; at += 4) loads_of<kOne>(l, at, false);
    for (int j = 0; j < 3; ++j) {
        l.all_force[j] = sum_of(l.force[j], l.lanes);
        l.all_torque[j] = sum_of(l.torque[j], l.lanes);
    }
}

}  // namespace

extern const PanelKernel panel_kernel;
const PanelKernel panel_kernel{&loads};

}  // namespace hil::sim::HIL_ISA
