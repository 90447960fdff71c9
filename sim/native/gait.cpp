#include "gait.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "detmath.hpp"

namespace hil::sim {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kStrike = -0.30, kPush = 1.0;  // foot pitch at heel strike (toe up) and toe-off (heel up)
constexpr double kFlatFrom = 0.18, kFlatTo = 0.58;  // shares of stance during which the sole is flat
constexpr double kLean = 0.04;
constexpr double kElbow = 0.22, kElbowSwing = 0.35;
constexpr double kTorsoYaw = 0.07, kPelvisYaw = 0.10;
constexpr double kReach = 0.992;  // greatest hip-to-ankle distance / leg: the knee is never fully extended
constexpr int kTries = 9;         // number of tries for the start of a flat foot before the hip

using Row = LimbRow;

Row limb(double x, double y, double z, double s, double c, double dx, double dy, double dz, double d_theta) {
    const double half_c = std::sqrt(0.5 * (1.0 + c));
    return {x, y, z, half_c, 0.5 * s / half_c, 1.0, 0.0, dx, dy, dz, d_theta, 0.0};
}

struct Pitch {
    double value, slope;
};

struct Point {
    double x, z, dx, dz;
};

Pitch foot_pitch(const GaitShape &g, double phase) {
    const double flat_from = kFlatFrom * g.stance, flat_to = kFlatTo * g.stance;
    double u, span, start, change;
    if (phase < flat_from) {
        u = phase / flat_from, span = flat_from, start = kStrike, change = -kStrike;
    } else if (phase < flat_to) {
        return {0.0, 0.0};
    } else if (phase < g.stance) {
        span = g.stance - flat_to;
        u = (phase - flat_to) / span, start = 0.0, change = kPush;
    } else {
        span = 1.0 - g.stance;
        u = (phase - g.stance) / span, start = kPush, change = kStrike - kPush;
    }
    return {start + change * smoothstep(u), change * smoothstep_slope(u) / span};
}

Point ankle(const GaitShape &g, double phase) {
    if (phase <= g.stance) {
        const Pitch pitch = phase < g.stance ? foot_pitch(g, phase) : Pitch{kPush, 0.0};
        const double flat = g.ahead - g.cycle * phase;
        // Relative to the pivot of the sole: the heel before the sole is flat, the ball after.
        const double px = phase < kFlatTo * g.stance ? g.heel : -g.ball, pz = g.ankle;
        const double s = det::sin(pitch.value), c = det::cos(pitch.value);
        const double rx = px * c + pz * s, rz = pz * c - px * s;
        return {flat - px + rx, rz, -g.cycle + pitch.slope * rz, -pitch.slope * rx};
    }
    const double span = 1.0 - g.stance, u = (phase - g.stance) / span;
    const double x0 = g.swing_from_x, z0 = g.swing_from_z, x1 = g.swing_to_x, z1 = g.swing_to_z;
    // x: slopes at both ends as in stance, second derivatives zero; the rest is a smoothstep.
    const double slope = -g.cycle * span, change = x1 - x0 - slope;
    const double blend = smoothstep(u), d_blend = smoothstep_slope(u), v = u * (1.0 - u);
    const double z = z0 + (z1 - z0) * blend + g.lift * 64.0 * v * v * v;
    const double dz = (z1 - z0) * d_blend + g.lift * 192.0 * v * v * (1.0 - 2.0 * u);
    return {x0 + slope * u + change * blend, z, (slope + change * d_blend) / span, dz / span};
}

// Thigh, shank and foot. With d = ankle - hip and n = (-d_z, d_x): knee = hip + k d + w n, k = (a^2 - b^2 + r^2) / 2
// r^2, w = sqrt(a^2 / r^2 - k^2), with a and b thigh and shank, r = |d|: the knee bends forward.
void leg_rows(const FigureLengths &g, double y, const Point &hip, const Point &foot, Pitch pitch, Row *rows) {
    const double a = g.thigh, b = g.shank;
    const double x = foot.x - hip.x, z = foot.z - hip.z, dx = foot.dx - hip.dx, dz = foot.dz - hip.dz;
    const double rr = x * x + z * z, drr = 2.0 * (x * dx + z * dz);
    const double k = (a * a - b * b + rr) / (2.0 * rr), dk = -(a * a - b * b) * drr / (2.0 * rr * rr);
    const double w = std::sqrt(a * a / rr - k * k), dw = (-a * a * drr / (rr * rr) - 2.0 * k * dk) / (2.0 * w);
    const double kx = hip.x + k * x - w * z, kz = hip.z + k * z + w * x;
    const double dkx = hip.dx + dk * x + k * dx - dw * z - w * dz;
    const double dkz = hip.dz + dk * z + k * dz + dw * x + w * dx;
    const double us = (hip.x - kx) / a, uc = (hip.z - kz) / a, vs = (kx - foot.x) / b, vc = (kz - foot.z) / b;
    const double d_thigh = ((hip.dx - dkx) * uc - (hip.dz - dkz) * us) / a;
    const double d_shank = ((dkx - foot.dx) * vc - (dkz - foot.dz) * vs) / b;
    rows[0] = limb(0.5 * (hip.x + kx), y, 0.5 * (hip.z + kz), us, uc, 0.5 * (hip.dx + dkx), 0.0,
                   0.5 * (hip.dz + dkz), d_thigh);
    rows[1] = limb(0.5 * (kx + foot.x), y, 0.5 * (kz + foot.z), vs, vc, 0.5 * (dkx + foot.dx), 0.0,
                   0.5 * (dkz + foot.dz), d_shank);
    const double half = 0.5 * pitch.value;
    rows[2] = {foot.x, y,       foot.z, det::cos(half), det::sin(half), 1.0,
               0.0,    foot.dx, 0.0,    foot.dz,        pitch.slope,    0.0};
}

struct Shoulder {
    double x, y, z, dx, dy, dz;
};

// Upper arm, forearm and hand.
void arm_rows(const FigureLengths &g, const Shoulder &shoulder, Pitch upper, Pitch fore, Row *rows) {
    double x = shoulder.x, z = shoulder.z, dx = shoulder.dx, dz = shoulder.dz;
    const double y = shoulder.y, dy = shoulder.dy;
    double s = det::sin(upper.value), c = det::cos(upper.value);
    double half = 0.5 * g.upper_arm;
    double px = half * s, pz = half * c, dpx = half * c * upper.slope, dpz = -half * s * upper.slope;
    rows[0] = limb(x - px, y, z - pz, s, c, dx - dpx, dy, dz - dpz, upper.slope);
    x = x - 2.0 * px, z = z - 2.0 * pz, dx = dx - 2.0 * dpx, dz = dz - 2.0 * dpz;
    s = det::sin(fore.value), c = det::cos(fore.value);
    half = 0.5 * g.forearm;
    px = half * s, pz = half * c, dpx = half * c * fore.slope, dpz = -half * s * fore.slope;
    rows[1] = limb(x - px, y, z - pz, s, c, dx - dpx, dy, dz - dpz, fore.slope);
    const double reach = 2.0 + g.hand / half;
    rows[2] = limb(x - reach * px, y, z - reach * pz, s, c, dx - reach * dpx, dy, dz - reach * dpz, fore.slope);
}

// Height of the pelvis above its base, yaw, and their derivatives.
struct Pelvis {
    double bob, yaw, d_bob, d_yaw;
};

Pelvis pelvis(const GaitShape &g, double phase) {
    const double bob_angle = 2.0 * kTurn * phase - 0.35 * kTurn, turn = kTurn * phase;
    // The left hip (y > 0) leads when the left foot strikes: yaw to the right, negative.
    return {g.bob * det::sin(bob_angle), -kPelvisYaw * det::cos(turn), 2.0 * kTurn * g.bob * det::cos(bob_angle),
            kTurn * kPelvisYaw * det::sin(turn)};
}

void place_feet(GaitShape &g, double ahead) {
    g.ahead = ahead;
    const Point from = ankle(g, g.stance), to = ankle(g, 0.0);
    g.swing_from_x = from.x, g.swing_from_z = from.z, g.swing_to_x = to.x, g.swing_to_z = to.z;
}

// Highest base height of the pelvis at which the leg reaches the ankle at `count` phases evenly spaced over a cycle.
double highest_hip(const GaitShape &g, int count) {
    const double reach = kReach * (g.thigh + g.shank);
    double lowest = INFINITY;
    for (int i = 0; i < count; ++i) {
        const double phase = static_cast<double>(i) / count;
        const Point foot = ankle(g, phase);
        const Pelvis at = pelvis(g, phase);
        const double x = foot.x + g.hip_half * det::sin(at.yaw);
        const double high = foot.z + std::sqrt(reach * reach - x * x) - at.bob;
        if (!(high > 0.0)) {
            throw std::invalid_argument("the walker's steps are longer than the legs: lower its speed");
        }
        lowest = std::min(lowest, high);
    }
    return lowest;
}

}  // namespace

GaitShape fit_gait(const FigureLengths &figure, double speed_mps, double cycle_m) {
    GaitShape g{figure};
    const double leg = figure.thigh + figure.shank, relative = speed_mps / leg;
    g.cycle = cycle_m;
    g.stance = std::min(std::max(0.752 - 0.143 * speed_mps / cycle_m, 0.55), 0.70);
    g.bob = 0.015 * relative * leg;
    g.arm_rad = 9.88 * relative * kTurn / 360.0;
    g.lift = 0.030 * figure.height;
    const double middle = 0.5 * (g.stance * cycle_m - 0.063 * figure.height);
    double best = -INFINITY, best_ahead = middle;
    for (int step = 0; step < kTries; ++step) {
        place_feet(g, middle - 0.008 * step * figure.height);
        const double high = highest_hip(g, 64);
        if (high > best) {
            best = high, best_ahead = g.ahead;
        }
    }
    place_feet(g, best_ahead);
    g.hip = highest_hip(g, 128);
    return g;
}

void resting_leg(const FigureLengths &figure, double y, double hip_z, double ankle_x, double ankle_z, LimbRow *rows) {
    const double below = hip_z - ankle_z, far = std::sqrt(ankle_x * ankle_x + below * below);
    if (!(far < figure.thigh + figure.shank && far > std::abs(figure.thigh - figure.shank))) {
        throw std::invalid_argument("a leg at rest does not reach its foot: this person is too small or too tall here");
    }
    leg_rows(figure, y, {0.0, hip_z, 0.0, 0.0}, {ankle_x, ankle_z, 0.0, 0.0}, {0.0, 0.0}, rows);
}

void resting_arm(const FigureLengths &figure, double y, double z, double upper_rad, double fore_rad, LimbRow *rows) {
    arm_rows(figure, {0.0, y, z, 0.0, 0.0, 0.0}, {upper_rad, 0.0}, {fore_rad, 0.0}, rows);
}

void gait_rows(const GaitShape &g, double phase, LimbRows &rows) {
    const double turn = kTurn * phase;
    const auto [bob, yaw, d_bob, d_yaw] = pelvis(g, phase);
    const double sy = det::sin(yaw), cy = det::cos(yaw);
    const double hip_z = g.hip + bob;
    const double st = det::sin(turn), ct = det::cos(turn);
    const double torso_yaw = kTorsoYaw * ct, d_torso_yaw = -kTurn * kTorsoYaw * st;
    const double lean_s = det::sin(kLean), lean_c = det::cos(kLean);
    const double ts = det::sin(torso_yaw), tc = det::cos(torso_yaw);
    double up = g.torso_above_hip;
    rows[0] = {0.0, 0.0, hip_z, 1.0, 0.0, det::cos(0.5 * yaw), det::sin(0.5 * yaw), 0.0, 0.0, d_bob, 0.0, d_yaw};
    rows[1] = {up * lean_s, 0.0, hip_z + up * lean_c, det::cos(0.5 * kLean), det::sin(0.5 * kLean),
               det::cos(0.5 * torso_yaw), det::sin(0.5 * torso_yaw), 0.0, 0.0, d_bob, 0.0, d_torso_yaw};
    rows[2] = {g.head_above_hip * lean_s, 0.0, hip_z + g.head_above_hip * lean_c, 1.0, 0.0, 1.0,
               0.0, 0.0, 0.0, d_bob, 0.0, 0.0};
    up = g.shoulder_above_hip;
    for (int i = 0; i < 2; ++i) {
        // The left arm is back when the left foot strikes.
        const double sign = i == 0 ? 1.0 : -1.0, side = i == 0 ? g.shoulder_half : -g.shoulder_half;
        const double swing = sign * g.arm_rad * ct, d_swing = -sign * kTurn * g.arm_rad * st;
        const double elbow = kElbow + 0.5 * kElbowSwing * (1.0 - sign * ct);
        const double d_elbow = 0.5 * kElbowSwing * sign * kTurn * st;
        const Shoulder shoulder{up * lean_s - side * ts, side * tc, hip_z + up * lean_c,
                                -side * tc * d_torso_yaw, -side * ts * d_torso_yaw, d_bob};
        arm_rows(g, shoulder, {swing - 0.05, d_swing}, {swing - 0.05 - elbow, d_swing - d_elbow}, &rows[3 + 3 * i]);
    }
    for (int i = 0; i < 2; ++i) {
        const double side = i == 0 ? g.hip_half : -g.hip_half;
        double own = phase + (i == 0 ? 0.0 : 0.5);
        own = own >= 1.0 ? own - 1.0 : own;
        const Point hip{-side * sy, hip_z, -side * cy * d_yaw, d_bob};
        leg_rows(g, side, hip, ankle(g, own), foot_pitch(g, own), &rows[9 + 3 * i]);
    }
}

void pedalling_legs(const Pedalling &legs, double phase, LimbRow *rows) {
    const double radius_turn = kTurn * legs.crank;
    for (int i = 0; i < 2; ++i) {
        const double sign = i == 0 ? 1.0 : -1.0;
        const double c = sign * det::cos(kTurn * phase), s = sign * det::sin(kTurn * phase);
        const Point ankle{legs.axle_x + legs.crank * c, legs.axle_z - legs.crank * s, -radius_turn * s, -radius_turn * c};
        leg_rows(legs, sign * legs.half_width, {legs.hip_x, legs.hip_z, 0.0, 0.0}, ankle, {legs.foot_rad, 0.0},
                 rows + 3 * i);
    }
}

Walker::Walker(const GaitShape &shape, WalkPath path, double cycles_per_m, double ground_m, double bound_z_m,
               double bound_radius_m)
    : shape_(shape), path_(std::move(path)), cycles_per_m_(cycles_per_m), ground_m_(ground_m), bound_z_m_(bound_z_m),
      bound_radius_m_(bound_radius_m) {}

Walker::Walker(const LimbRows &seated, WalkPath path, double ground_m, double bound_z_m, double bound_radius_m)
    : seated_(seated), path_(std::move(path)), cycles_per_m_(0.0), ground_m_(ground_m), bound_z_m_(bound_z_m),
      bound_radius_m_(bound_radius_m) {}

Walker::Walker(const LimbRows &seated, const Pedalling &legs, WalkPath path, double cycles_per_m, double ground_m,
               double bound_z_m, double bound_radius_m)
    : seated_(seated), legs_(legs), path_(std::move(path)), cycles_per_m_(cycles_per_m), ground_m_(ground_m),
      bound_z_m_(bound_z_m), bound_radius_m_(bound_radius_m) {
    const double x = legs.hip_x - legs.axle_x, z = legs.hip_z - legs.axle_z, distance = std::sqrt(x * x + z * z);
    if (!(distance + legs.crank < legs.thigh + legs.shank && distance - legs.crank > std::abs(legs.thigh - legs.shank))) {
        throw std::invalid_argument("the cyclist's legs do not reach the pedals all the way round: move the hips");
    }
}

Sphere Walker::bound(std::int64_t t_ns) const {
    const WalkPlace place = path_.place(path_.progress(t_ns).s_m);
    return {{place.x_m, place.y_m, bound_z_m_}, bound_radius_m_};
}

double Walker::phase(std::int64_t t_ns) const { return phase_at(path_.progress(t_ns).s_m); }

double Walker::phase_at(double s_m) const {
    const double cycles = s_m * cycles_per_m_;
    return cycles - std::floor(cycles);
}

void Walker::pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const {
    const WalkProgress progress = path_.progress(t_ns);
    const WalkPlace place = path_.place(progress.s_m);
    LimbRows rows;
    if (seated_) {
        rows = *seated_;
        if (legs_) pedalling_legs(*legs_, phase_at(progress.s_m), &rows[9]);
    } else {
        gait_rows(shape_, phase_at(progress.s_m), rows);
    }
    const double c = place.cos, s = place.sin;
    const double rate = progress.speed_mps * cycles_per_m_, yaw_rate = progress.speed_mps * place.yaw_per_m;
    const auto [hc, hs] = place.half_heading();
    for (int i = 0; i < kLimbs; ++i) {
        const auto &[x, y, z, tc, ts, yc, ys, dx_phase, dy_phase, dz, d_theta_phase, d_yaw] = rows[i];
        double *p = p_WB + 3 * i, *q = q_WB + 4 * i, *v = v_WB_W + 3 * i, *w = w_WB_W + 3 * i;
        const double rx = c * x - s * y, ry = s * x + c * y;
        p[0] = place.x_m + rx, p[1] = place.y_m + ry, p[2] = z + ground_m_;
        const double dx = dx_phase * rate, dy = dy_phase * rate;
        v[0] = progress.speed_mps * place.dx_ds - yaw_rate * ry + (c * dx - s * dy);
        v[1] = progress.speed_mps * place.dy_ds + yaw_rate * rx + (s * dx + c * dy);
        v[2] = dz * rate;
        const double zc = hc * yc - hs * ys, zs = hs * yc + hc * ys;  // heading and the limb's own yaw
        q[0] = zc * tc, q[1] = -zs * ts, q[2] = zc * ts, q[3] = zs * tc;
        const double d_theta = d_theta_phase * rate;
        w[0] = -d_theta * (2.0 * zc * zs), w[1] = d_theta * (zc * zc - zs * zs), w[2] = yaw_rate + d_yaw * rate;
    }
}

}  // namespace hil::sim
