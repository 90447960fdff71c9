#include "ideal_controller.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {
namespace {

constexpr double kPi = 3.141592653589793, kTwoPi = 2.0 * kPi;
constexpr double kMostLevelAccel = 6.0, kMostClimbAccel = 5.0;
constexpr double kMostAccelTan = 0.7;  // 35 degrees of tilt for acceleration; more against wind and drag
constexpr double kBrakeAccel = 3.5;
// Speeding up in all axes at once keeps the way to a position straight.
constexpr double kStraightAccel = 5.0, kLead_s = 0.3125;
constexpr double kYawBrakeShare = 0.5;  // of the greatest yaw acceleration
constexpr double kMostTiltTan = 1.7320508075688772, kLeastTiltCos = 0.5;  // 60 degrees
constexpr double kMostTiltRate = 5.0, kMostYawRate = 2.5;
constexpr double kMostMissing = 0.5;  // thrust over weight
constexpr double kSteerable = 0.1;    // thrust over weight below which all rotors get the same command
constexpr double kLockYawRate = 0.05, kLockYawError = 0.3;
constexpr double kLockClimb = 0.05, kLockHeightError = 0.5;
constexpr double kDescent = -0.05;   // a commanded vertical speed below it is a descent
constexpr double kPressPer_s = 2.0;  // of g
constexpr double kTouchDown_s = 0.3;
constexpr double kIdle = 0.05;

double larger(double a, double b) { return b > a ? b : a; }
double smaller(double a, double b) { return b < a ? b : a; }

struct Approach {
    double speed, slope;
};

// Speed s(distance) towards a target, at most `limit`, and its slope s'.
Approach approach(double distance, double gain, double brake, double limit) {
    Approach a{};
    if (gain * gain * distance <= brake) {
        a = {gain * distance, gain};
    } else {
        a.speed = std::sqrt(2.0 * brake * (distance - 0.5 * brake / (gain * gain)));
        a.slope = brake / a.speed;
    }
    return a.speed > limit ? Approach{limit, 0.0} : a;
}

void saturate(const Allocation &a, const double wanted[4], double *thrust_n) {
    const int n = a.rotors;
    const double least = a.least_n, most = a.most_n, thrust = wanted[3];
    double tilt[kMaxRotors], yaw[kMaxRotors], turn[kMaxRotors];
    for (int i = 0; i < n; ++i) {
        tilt[i] = a.mix[i][0] * wanted[0] + a.mix[i][1] * wanted[1];
        yaw[i] = a.mix[i][2] * wanted[2];
    }
    const double bound = larger(thrust, a.raised_n);
    double fit = 1.0;
    for (int i = 0; i < n; ++i) {
        const double t = tilt[i], s = a.mix[i][3];
        if (s > 0.0 && t < 0.0 && fit * t + s * bound < least) fit = larger(0.0, (least - s * bound) / t);
    }
    double lowest = fit * tilt[0], highest = lowest;
    for (int i = 0; i < n; ++i) {
        tilt[i] = fit * tilt[i];
        lowest = smaller(lowest, tilt[i]);
        highest = larger(highest, tilt[i]);
    }
    const double spread = highest - lowest;
    if (spread > most - least) {
        const double scale = (most - least) / spread;
        for (int i = 0; i < n; ++i) {
            tilt[i] = scale * tilt[i];
            yaw[i] = 0.0;
        }
    } else {
        double share = 1.0;  // of the yaw torque; every pair of rotors bounds it
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < n; ++j) {
                const double apart = yaw[i] - yaw[j], before = tilt[i] - tilt[j];
                if (apart > 0.0 && before + share * apart > most - least) share = ((most - least) - before) / apart;
            }
        }
        for (int i = 0; i < n; ++i) yaw[i] = share * yaw[i];
    }
    for (int i = 0; i < n; ++i) turn[i] = tilt[i] + yaw[i];
    double level = thrust;
    for (int i = 0; i < n; ++i) {
        const double s = a.mix[i][3];
        if (s > 0.0 && turn[i] + s * level < least) level = (least - turn[i]) / s;
    }
    for (int i = 0; i < n; ++i) {
        const double s = a.mix[i][3];
        if (s > 0.0 && turn[i] + s * level > most) level = (most - turn[i]) / s;
    }
    for (int i = 0; i < n; ++i) thrust_n[i] = smaller(larger(turn[i] + a.mix[i][3] * level, least), most);
}

}  // namespace

void allocate(const Allocation &a, const double wanted[4], double *thrust_n) {
    bool fits = true;
    for (int i = 0; i < a.rotors; ++i) {
        const double *m = a.mix[i];
        thrust_n[i] = ((m[0] * wanted[0] + m[1] * wanted[1]) + m[2] * wanted[2]) + m[3] * wanted[3];
        fits = fits && thrust_n[i] >= a.least_n && thrust_n[i] <= a.most_n;
    }
    if (!fits) saturate(a, wanted, thrust_n);
}

void IdealController::reset() {
    fresh_ = true;
    flown_ = false;
    spin_up_nm_ = yaw_torque_nm_ = made_n_ = 0.0;
    touched_s_ = kTouchDown_s;
    forget_disturbance();
}

void IdealController::step(const Flown &truth, double *commands) {
    const ControllerParams &c = params;
    const int n = c.allocation.rotors;
    const double w = truth.q_WB[0], x = truth.q_WB[1], y = truth.q_WB[2], z = truth.q_WB[3];
    const double R[9] = {
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z),       2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),       1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),       2.0 * (y * z + w * x),       1.0 - 2.0 * (x * x + y * y),
    };
    if (fresh_) {
        fresh_ = false;
        for (int i = 0; i < n; ++i) speeds_[i] = truth.rotor_speed_radps[i];
    }
    if (target.level == Target::kRotors) {
        forget_disturbance();
        direct(target.rotors, commands);
        return;
    }
    const double wx = truth.w_WB_B[0], wy = truth.w_WB_B[1], wz = truth.w_WB_B[2];
    const double ix = c.inertia_kgm2[0], iy = c.inertia_kgm2[1], iz = c.inertia_kgm2[2];
    const double gyroscopic[3] = {(iz - iy) * wy * wz, (ix - iz) * wz * wx, (iy - ix) * wx * wy};
    if (truth.in_contact) {
        fade_disturbance();
    } else if (flown_) {
        observe(truth, R, gyroscopic);
    }

    double f[3];
    force(truth, f);
    double same[kMaxRotors] = {};
    if (truth.in_contact && R[8] < kLeastTiltCos) {  // lies on its side: thrust would only press it there
        direct(same, commands);
        return;
    }
    if (press_ >= 1.0) {
        yaw_locked_ = false;
        for (double &each : same) each = kIdle;
        direct(same, commands);
        return;
    }
    double thrust;
    if (R[8] > kLeastTiltCos) {
        thrust = smaller(f[2] / R[8], std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
    } else {
        thrust = f[2] * larger(R[8], 0.0) / (kLeastTiltCos * kLeastTiltCos);
    }
    const double weight_n = c.mass_kg * c.gravity_mps2;
    if (target.height == Target::kThrust) {
        thrust = target.height_value * weight_n;
        if (target.height_value < kSteerable) {
            for (double &each : same) each = target.height_value * c.hover_n;
            to_commands(same, commands);
            return;
        }
    } else if (target.level != Target::kPosition && target.level != Target::kVelocity) {
        thrust = f[2] / larger(R[8], kLeastTiltCos);  // height is held at any attitude
    }
    thrust = smaller(larger(thrust, 0.0), c.most_thrust_n);
    if (flown_ && !truth.in_contact) {
        const double most = kMostMissing * weight_n;
        missing_n_ = smaller(larger(missing_n_ + c.fade * (thrust - made_n_), -most), most);
    }
    thrust = larger(thrust + missing_n_, 0.0);

    double rates[2];
    tilt_rates(R, f, rates);
    const double most = c.most_yaw_accel;
    const double yaw_accel = smaller(larger(gains.rate[2] * (yaw_rate(R, wz) - wz) - e_[2], -most), most);
    yaw_torque_nm_ += c.yaw_share * (iz * yaw_accel + gyroscopic[2] - yaw_torque_nm_);
    const double wanted[4] = {
        ix * (gains.rate[0] * (rates[0] - wx) - e_[0]) + gyroscopic[0],
        iy * (gains.rate[1] * (rates[1] - wy) - e_[1]) + gyroscopic[1],
        yaw_torque_nm_,
        thrust,
    };
    double thrusts[kMaxRotors];
    allocate(c.allocation, wanted, thrusts);
    to_commands(thrusts, commands);
}

// -- disturbance -----------------------------------------------------------------------------------------------------

void IdealController::forget_disturbance() {
    for (int j = 0; j < 3; ++j) d_[j] = e_[j] = 0.0;
    missing_n_ = 0.0;
    press_ = 0.0;
    yaw_locked_ = height_locked_ = false;
}

void IdealController::fade_disturbance() {
    const double left = 1.0 - params.fade;
    missing_n_ *= left;
    for (int j = 0; j < 3; ++j) {
        d_[j] *= left;
        e_[j] *= left;
    }
}

// Updates d_a and d_alpha with the mean acceleration of the last tick and that of the rotors' thrust.
void IdealController::observe(const Flown &truth, const double *R, const double *gyroscopic) {
    const ControllerParams &c = params;
    double tx = 0.0, ty = 0.0, tz = 0.0, f = 0.0;
    for (int i = 0; i < c.allocation.rotors; ++i) {
        const double force = c.thrust_coefficient * squares_[i];
        tx += c.columns[i][0] * force;
        ty += c.columns[i][1] * force;
        tz += c.columns[i][2] * force;
        f += c.columns[i][3] * force;
    }
    made_n_ = f;
    f /= c.mass_kg;
    const double *a = truth.a_WB_W, *alpha = truth.alpha_WB_B, *inertia = c.inertia_kgm2;
    d_[0] += c.fade * (a[0] - R[2] * f - d_[0]);
    d_[1] += c.fade * (a[1] - R[5] * f - d_[1]);
    d_[2] += c.fade * (a[2] + c.gravity_mps2 - R[8] * f - d_[2]);
    e_[0] += c.fade * (alpha[0] - (tx - gyroscopic[0]) / inertia[0] - e_[0]);
    e_[1] += c.fade * (alpha[1] - (ty - gyroscopic[1]) / inertia[1] - e_[1]);
    e_[2] += c.fade * (alpha[2] - (tz + spin_up_nm_ - gyroscopic[2]) / inertia[2] - e_[2]);
}

// -- position and velocity -------------------------------------------------------------------------------------------

// f_d in W, limited. Only z counts if no horizontal motion is commanded.
void IdealController::force(const Flown &truth, double *out) {
    const ControllerParams &c = params;
    const Target &t = target;
    const double *p = truth.p_WB, *v = truth.v_WB_W, *kp = gains.position, *kv = gains.velocity;
    const bool places = t.level == Target::kPosition;
    const double tx = places ? t.level_value[0] : p[0], ty = places ? t.level_value[1] : p[1];
    const double tz = t.height == Target::kHeight ? t.height_value : p[2];
    double dx = tx - p[0], dy = ty - p[1], dz = tz - p[2];
    const double distance = std::sqrt(dx * dx + dy * dy + dz * dz);
    dx = kp[0] * dx;
    dy = kp[1] * dy;
    dz = kp[2] * dz;
    const double wanted = std::sqrt(dx * dx + dy * dy + dz * dz);
    double sx = 0.0, sy = 0.0, sz = 0.0;  // commanded velocity
    double ax = 0.0, ay = 0.0, az = 0.0;
    if (wanted > 1e-9) {
        dx = dx / wanted;
        dy = dy / wanted;
        dz = dz / wanted;
        const Approach to = approach(distance, wanted / distance, kBrakeAccel, t.speed_limit_mps);
        const double ahead = dx * v[0] + dy * v[1] + dz * v[2];
        const double speed = smaller(to.speed, larger(ahead, 0.0) + kLead_s * kStraightAccel);
        sx = speed * dx;
        sy = speed * dy;
        sz = speed * dz;
        const double slope = to.slope * ahead;
        ax = -slope * dx;
        ay = -slope * dy;
        az = -slope * dz;
    }
    if (t.level == Target::kVelocity) {
        sx = t.level_value[0];
        sy = t.level_value[1];
        ax = ay = 0.0;
    }
    const bool climbs = t.height == Target::kClimb;
    if (climbs) {
        sz = t.height_value != 0.0 ? t.height_value : hold_height(truth);
        az = 0.0;
    }
    if (!climbs || t.height_value != 0.0) height_locked_ = false;
    ax = ax + kv[0] * (sx - v[0]);
    ay = ay + kv[1] * (sy - v[1]);
    az = az + kv[2] * (sz - v[2]);
    az = smaller(larger(az, -kMostClimbAccel), kMostClimbAccel);
    double level = std::sqrt(ax * ax + ay * ay);
    double most = larger(0.0, smaller(kMostLevelAccel, kMostAccelTan * (c.gravity_mps2 + az)));
    if (level > most) {
        ax = ax * (most / level);
        ay = ay * (most / level);
    }
    press_down(truth, sz);

    const double weight_n = c.mass_kg * c.gravity_mps2;
    double fz = c.mass_kg * (az + c.gravity_mps2 * (1.0 - press_) - d_[2]);
    fz = smaller(larger(fz, 0.1 * weight_n * (1.0 - press_)), c.most_thrust_n);
    double fx = c.mass_kg * (ax - d_[0]), fy = c.mass_kg * (ay - d_[1]);
    if (touched_s_ < kTouchDown_s && sz < kDescent) {
        // Touch-down: upright, so that a skidding vehicle does not tip over.
        fx = fy = 0.0;
    } else {
        level = std::sqrt(fx * fx + fy * fy);
        most = smaller(kMostTiltTan * fz, std::sqrt(larger(0.0, c.most_thrust_n * c.most_thrust_n - fz * fz)));
        if (level > most) {
            fx = fx * (most / level);
            fy = fy * (most / level);
        }
    }
    out[0] = fx;
    out[1] = fy;
    out[2] = fz;
}

// Climb that holds the height at which the vehicle stopped climbing; 0 until then.
double IdealController::hold_height(const Flown &truth) {
    const double z_m = truth.p_WB[2];
    if (truth.in_contact || touched_s_ < kTouchDown_s) {
        height_locked_ = false;
    } else if (!height_locked_ && std::fabs(truth.v_WB_W[2]) < kLockClimb) {
        height_locked_ = true;
        locked_z_m_ = z_m;
    } else if (height_locked_ && std::fabs(locked_z_m_ - z_m) > kLockHeightError) {
        height_locked_ = false;  // pushed away from outside: do not fly back
    }
    return height_locked_ ? gains.position[2] * (locked_z_m_ - z_m) : 0.0;
}

// On the ground, gives the weight to the ground while a descent is commanded, and takes it back otherwise.
void IdealController::press_down(const Flown &truth, double climb_mps) {
    const double step = kPressPer_s * params.dt_s;
    touched_s_ = truth.in_contact ? 0.0 : touched_s_ + params.dt_s;
    if (truth.in_contact && climb_mps < kDescent && truth.v_WB_W[2] > 0.5 * climb_mps) {
        press_ = smaller(1.0, press_ + step);
    } else if (press_ > 0.0) {
        press_ = larger(0.0, press_ - 2.0 * step);
    }
}

// -- attitude --------------------------------------------------------------------------------------------------------

// w_d about x and y of B.
void IdealController::tilt_rates(const double *R, const double *force, double *out) const {
    if (target.level == Target::kRates) {
        out[0] = target.level_value[0];
        out[1] = target.level_value[1];
        return;
    }
    double turn = 0.0;  // rate about z of W at which the wanted axis turns
    double zx = 0.0, zy = 0.0, zz = 1.0;
    if (target.level == Target::kAttitude) {
        const double roll = target.level_value[0], pitch = target.level_value[1];
        const double cr = det::cos(roll), sr = det::sin(roll), cp = det::cos(pitch), sp = det::sin(pitch);
        const double forward = std::sqrt(R[0] * R[0] + R[3] * R[3]);
        const double cy = forward > 1e-6 ? R[0] / forward : 1.0, sy = forward > 1e-6 ? R[3] / forward : 0.0;
        zx = cy * sp * cr + sy * sr;
        zy = sy * sp * cr - cy * sr;
        zz = cp * cr;
        turn = target.turns ? target.yaw_value : 0.0;
    } else {
        const double size = std::sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
        if (size > 0.0) {
            zx = force[0] / size;
            zy = force[1] / size;
            zz = force[2] / size;
        }
    }
    // z of B x z_d, turned into B: its components along x and y of B.
    const double bx = -(R[1] * zx + R[4] * zy + R[7] * zz), by = R[0] * zx + R[3] * zy + R[6] * zz;
    const double cosine = R[2] * zx + R[5] * zy + R[8] * zz;
    const double half = std::sqrt(larger(0.0, 2.0 * (1.0 + cosine)));  // 2 cos(theta/2)
    double wx = kMostTiltRate, wy = 0.0;  // upside down: over the side
    if (half > 0.02) {
        wx = gains.attitude[0] * 2.0 * bx / half;
        wy = gains.attitude[1] * 2.0 * by / half;
    }
    const double size = std::sqrt(wx * wx + wy * wy);
    if (size > kMostTiltRate) {
        wx = wx * (kMostTiltRate / size);
        wy = wy * (kMostTiltRate / size);
    }
    out[0] = wx + turn * R[6];
    out[1] = wy + turn * R[7];
}

// w_d about z of B. A commanded rate of zero holds the heading once the vehicle has stopped turning.
double IdealController::yaw_rate(const double *R, double wz) {
    const double yaw = det::atan2(R[3], R[0]);
    double aim = target.yaw_value;
    if (target.turns) {
        if (target.yaw_value != 0.0) {
            yaw_locked_ = false;
            return target.yaw_value;
        }
        if (!yaw_locked_) {
            if (std::fabs(wz) > kLockYawRate) return 0.0;
            yaw_locked_ = true;
            locked_yaw_ = yaw;
        }
        aim = locked_yaw_;
    } else {
        yaw_locked_ = false;
    }
    double error = std::fmod(aim - yaw, kTwoPi);  // exact, and so the same everywhere
    error += error < -kPi ? kTwoPi : error > kPi ? -kTwoPi : 0.0;
    if (yaw_locked_ && std::fabs(error) > kLockYawError) {
        yaw_locked_ = false;  // pushed away from outside: do not turn back
        return 0.0;
    }
    const double speed =
        approach(std::fabs(error), gains.attitude[2], kYawBrakeShare * params.most_yaw_accel, kMostYawRate).speed;
    return error > 0.0 ? speed : -speed;
}

// -- rotors ----------------------------------------------------------------------------------------------------------

// Writes the commands that bring the rotors to their thrust, and advances the model of the motors.
void IdealController::to_commands(const double *thrust_n, double *commands) {
    const ControllerParams &c = params;
    const double top = c.max_speed_radps, f = c.curve;
    spin_up_nm_ = 0.0;
    for (int i = 0; i < c.allocation.rotors; ++i) {
        const double now = speeds_[i];
        const double aim = thrust_n[i] > 0.0 ? std::sqrt(thrust_n[i] / c.thrust_coefficient) : 0.0;
        double command = now + (aim - now) * (aim > now ? c.lead_up : c.lead_down);
        command = smaller(larger(command, 0.0), top);
        const double after = command + (now - command) * (command > now ? c.decay_up : c.decay_down);
        speeds_[i] = after;
        squares_[i] = (now * now + now * after + after * after) / 3.0;
        spin_up_nm_ += c.reaction_nm_per_radps[i] * (after - now);
        double u = command / top;
        if (f != 1.0) {
            u *= u;
            if (f > 0.0) u = (std::sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * u) - (1.0 - f)) / (2.0 * f);
        }
        commands[i] = u;
    }
    flown_ = true;
}

// Writes the commands themselves, limited, and advances the model of the motors.
void IdealController::direct(const double *wanted, double *commands) {
    const ControllerParams &c = params;
    const double f = c.curve;
    for (int i = 0; i < c.allocation.rotors; ++i) {
        const double u = smaller(larger(wanted[i], 0.0), 1.0);
        const double now = speeds_[i], command = c.max_speed_radps * std::sqrt(f * u * u + (1.0 - f) * u);
        speeds_[i] = command + (now - command) * (command > now ? c.decay_up : c.decay_down);
        squares_[i] = (now * now + now * speeds_[i] + speeds_[i] * speeds_[i]) / 3.0;
        commands[i] = u;
    }
    flown_ = true;
}

}  // namespace hil::sim
