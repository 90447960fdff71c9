#include "control.hpp"

#include <algorithm>
#include <cmath>

namespace hil::flight {
namespace {

constexpr double kDeg = det::kPi / 180.0;
constexpr double kAccelerationCutoffHz = 5.0;  // low-pass of the measured acceleration in the D term

// Gain of a first-order low-pass, backward Euler.
double low_pass_gain(double cutoff_hz, double dt) { return dt / (dt + 1.0 / (2.0 * det::kPi * cutoff_hz)); }

double or_else(double value, double otherwise) { return std::isnan(value) ? otherwise : value; }

// Speed towards a target at distance d with gain k, such that braking at `a` stops there:
// k d while that needs less than a, then sqrt(2 a (d - a / 2 k^2)); both meet with equal slope.
double shaped_speed(double distance, double k, double a) {
    const double linear = a / (k * k);
    return distance <= linear ? k * distance : std::sqrt(2.0 * a * (distance - 0.5 * linear));
}

Vec3 limit_norm(Vec3 v, double most) {
    const double n = norm(v);
    return n > most ? (most / n) * v : v;
}

// Horizontal part limited, vertical kept.
Vec3 limit_horizontal(Vec3 v, double most) {
    const double n = std::sqrt(v.x * v.x + v.y * v.y);
    return n > most ? Vec3{v.x * (most / n), v.y * (most / n), v.z} : v;
}

}  // namespace

void Controller::reset() {
    fresh_ = true;
    integral_ = rate_integral_ = Vec3{};
    collective_ = 0.0;
    wants_up_ = wants_down_ = false;
    saturation_ = Saturation{};
}

Vec3 Controller::position_loop(const Setpoint &sp, const Motion &m, double dt) {
    const bool hold = sp.kind == SetpointKind::Position;
    const Vec3 ff{or_else(sp.v.x, 0.0), or_else(sp.v.y, 0.0), or_else(sp.v.z, 0.0)};
    Vec3 target = ff;
    if (hold && m.position_ok) {
        const Vec3 e{or_else(sp.p.x, m.p_N.x) - m.p_N.x, or_else(sp.p.y, m.p_N.y) - m.p_N.y, 0.0};
        const double distance = norm(e);
        if (distance > 1.0e-9) {
            // Brake at half the acceleration limit: the other half is for tracking and wind.
            const double speed = shaped_speed(distance, params_[MPC_XY_P], 0.5 * params_[MPC_ACC_HOR_MAX]);
            target = target + (speed / distance) * e;
        }
    }
    if (hold && !std::isnan(sp.p.z)) {
        const double e = sp.p.z - m.p_N.z;
        const double a = 0.5 * (e > 0.0 ? params_[MPC_ACC_UP_MAX] : params_[MPC_ACC_DOWN_MAX]);
        target.z += std::copysign(shaped_speed(std::fabs(e), params_[MPC_Z_P], a), e);
    }
    target = limit_horizontal(target, params_[MPC_XY_VEL_MAX]);
    target.z = clamp(target.z, -params_[MPC_Z_VEL_MAX_UP], params_[MPC_Z_VEL_MAX_DN]);
    if (!m.velocity_ok) target.x = target.y = 0.0;

    const double step_h = params_[MPC_ACC_HOR_MAX] * dt;
    const Vec3 change = target - v_sp_;
    const Vec3 level = limit_norm(Vec3{change.x, change.y, 0.0}, step_h);
    v_sp_ = v_sp_ + Vec3{level.x, level.y, clamp(change.z, -params_[MPC_ACC_UP_MAX] * dt, params_[MPC_ACC_DOWN_MAX] * dt)};
    return v_sp_;
}

// Returns the thrust vector, NED, fractions of full thrust.
Vec3 Controller::velocity_loop(const Setpoint &sp, const Motion &m, Vec3 v_target, bool on_ground, double dt) {
    const double g = params_[EKF_GRAVITY], hover = params_[MPC_THR_HOVER];
    a_filtered_ = a_filtered_ + low_pass_gain(kAccelerationCutoffHz, dt) * (m.a_N - a_filtered_);
    const Vec3 ff{or_else(sp.a.x, 0.0), or_else(sp.a.y, 0.0), or_else(sp.a.z, 0.0)};
    const Vec3 e = v_target - m.v_N, damping = ff - a_filtered_;
    Vec3 want{ff.x + params_[MPC_XY_VEL_P_ACC] * e.x + params_[MPC_XY_VEL_D_ACC] * damping.x + integral_.x,
              ff.y + params_[MPC_XY_VEL_P_ACC] * e.y + params_[MPC_XY_VEL_D_ACC] * damping.y + integral_.y,
              ff.z + params_[MPC_Z_VEL_P_ACC] * e.z + params_[MPC_Z_VEL_D_ACC] * damping.z + integral_.z};
    if (!m.velocity_ok || on_ground) want.x = want.y = 0.0;
    const Vec3 before_jerk = a_sp_;
    a_sp_ = a_sp_ + limit_norm(want - before_jerk, params_[MPC_JERK_MAX] * dt);

    const double most = params_[MPC_THR_MAX], margin = params_[MPC_THR_XY_MARG];
    // The vertical integrator's correction of the hover thrust applies to the horizontal axes too.
    const double learned = clamp(1.0 - integral_.z / g, 0.6, 1.6);
    Vec3 thrust = (hover / g) * Vec3{learned * a_sp_.x, learned * a_sp_.y, a_sp_.z - g};
    const double up_most = std::sqrt(std::max(0.0, most * most - margin * margin));
    const double up = clamp(-thrust.z, params_[MPC_THR_MIN], up_most);
    const bool z_saturated_up = -thrust.z > up || saturation_.thrust_excess > 1.0e-6;
    const bool z_saturated_down = -thrust.z < up;
    thrust.z = -up;
    const double tilt = params_[MPC_TILTMAX_AIR] * kDeg;
    const double level_most =
        std::min(up * det::sin(tilt) / det::cos(tilt), std::sqrt(std::max(0.0, most * most - up * up)));
    const double level = std::sqrt(thrust.x * thrust.x + thrust.y * thrust.y);
    const bool xy_saturated = level > level_most;
    thrust = limit_horizontal(thrust, level_most);

    if (!on_ground && m.velocity_ok) {
        // Saturated: integrate only errors that reduce the demand.
        const bool outward = e.x * a_sp_.x + e.y * a_sp_.y > 0.0;
        if (!(xy_saturated && outward)) {
            integral_.x += params_[MPC_XY_VEL_I_ACC] * e.x * dt;
            integral_.y += params_[MPC_XY_VEL_I_ACC] * e.y * dt;
            integral_ = limit_horizontal(integral_, 0.5 * g);
        }
    }
    const bool may_z = on_ground ? wants_up_ && e.z < 0.0 : true;
    if (may_z && !(z_saturated_up && e.z < 0.0) && !(z_saturated_down && e.z > 0.0)) {
        integral_.z = clamp(integral_.z + params_[MPC_Z_VEL_I_ACC] * e.z * dt, -0.7 * g, 0.7 * g);
    }
    return thrust;
}

double Controller::slew_yaw(const Setpoint &sp, const Motion &m, bool on_ground, double dt) {
    if (on_ground) {
        yaw_sp_ = yaw_of(m.q_NF);
        yaw_rate_ff_ = 0.0;
        return yaw_sp_;
    }
    const double most = params_[MPC_YAWRAUTO_MAX] * kDeg;
    const double ff = clamp(or_else(sp.yawspeed, 0.0), -most, most);
    if (std::isnan(sp.yaw)) {
        yaw_sp_ = wrap_pi(yaw_sp_ + ff * dt);
        yaw_rate_ff_ = ff;
        return yaw_sp_;
    }
    // Rate-limited, with a gain of 4 /s near the target: faster than the yaw loop that follows it.
    const double error = wrap_pi(sp.yaw - yaw_sp_);
    const double rate = clamp(ff + 4.0 * error, -most, most);
    yaw_sp_ = wrap_pi(yaw_sp_ + rate * dt);
    yaw_rate_ff_ = rate;
    return yaw_sp_;
}

Vec3 Controller::attitude_loop(const Motion &m, double yawspeed) const {
    const Quat q = m.q_NF, qd = q_sp_;
    const Vec3 down{0.0, 0.0, 1.0};
    const Vec3 e_z = rotate(q, down), e_z_d = rotate(qd, down);
    // Shortest rotation from the actual to the desired body z, in the world, then the remaining yaw by weight.
    const double c = dot(e_z, e_z_d);
    Quat reduced;
    if (c > -0.9999) {
        const Vec3 axis = cross(e_z, e_z_d);
        reduced = normalized(Quat{1.0 + c, axis.x, axis.y, axis.z}) * q;
    } else {
        reduced = qd;  // upside down: all rotations are equally long
    }
    Quat mix = conjugate(reduced) * qd;
    if (mix.w < 0.0) mix = {-mix.w, -mix.x, -mix.y, -mix.z};
    const double weight = params_[MC_YAW_WEIGHT];
    const double half_yaw = det::atan2(mix.z, mix.w);
    const Quat wanted = reduced * Quat{det::cos(weight * half_yaw), 0.0, 0.0, det::sin(weight * half_yaw)};
    const Quat qe = conjugate(q) * wanted;
    const double s = qe.w >= 0.0 ? 2.0 : -2.0;
    const double yaw_gain = weight > 1.0e-3 ? params_[MC_YAW_P] / weight : 0.0;
    const Vec3 world_yaw = rotate(conjugate(q), Vec3{0.0, 0.0, yawspeed});
    const double roll_most = params_[MC_ROLLRATE_MAX] * kDeg, pitch_most = params_[MC_PITCHRATE_MAX] * kDeg,
                 yaw_most = params_[MC_YAWRATE_MAX] * kDeg;
    return {clamp(s * qe.x * params_[MC_ROLL_P] + world_yaw.x, -roll_most, roll_most),
            clamp(s * qe.y * params_[MC_PITCH_P] + world_yaw.y, -pitch_most, pitch_most),
            clamp(s * qe.z * yaw_gain + world_yaw.z, -yaw_most, yaw_most)};
}

void Controller::rate_loop(const Motion &m, bool on_ground, double dt, Demand &out) {
    w_filtered_ = w_filtered_ + low_pass_gain(params_[IMU_GYRO_CUTOFF], dt) * (m.w_F - w_filtered_);
    const Vec3 dw = (1.0 / dt) * (w_filtered_ - w_last_);
    w_last_ = w_filtered_;
    dw_filtered_ = dw_filtered_ + low_pass_gain(params_[IMU_DGYRO_CUTOFF], dt) * (dw - dw_filtered_);
    const Vec3 e = w_sp_ - w_filtered_;
    if (on_ground) {
        rate_integral_ = Vec3{};
    } else {
        const bool tilt_short = saturation_.roll_pitch < 1.0, yaw_short = saturation_.yaw < 1.0;
        const auto integrate = [dt](double &i, double error, double gain, double most, bool saturated) {
            if (saturated && i * error > 0.0) return;
            // Large errors are manoeuvres, not trim: fade out the integrator, at 400 deg/s as in PX4.
            const double fade = std::max(0.0, 1.0 - (error / 7.0) * (error / 7.0));
            i = clamp(i + fade * gain * error * dt, -most, most);
        };
        integrate(rate_integral_.x, e.x, params_[MC_ROLLRATE_I], params_[MC_RR_INT_LIM], tilt_short);
        integrate(rate_integral_.y, e.y, params_[MC_PITCHRATE_I], params_[MC_PR_INT_LIM], tilt_short);
        integrate(rate_integral_.z, e.z, params_[MC_YAWRATE_I], params_[MC_YR_INT_LIM], yaw_short);
    }
    out.roll = params_[MC_ROLLRATE_P] * e.x + rate_integral_.x - params_[MC_ROLLRATE_D] * dw_filtered_.x +
               params_[MC_ROLLRATE_FF] * w_sp_.x;
    out.pitch = params_[MC_PITCHRATE_P] * e.y + rate_integral_.y - params_[MC_PITCHRATE_D] * dw_filtered_.y +
                params_[MC_PITCHRATE_FF] * w_sp_.y;
    out.yaw = params_[MC_YAWRATE_P] * e.z + rate_integral_.z - params_[MC_YAWRATE_D] * dw_filtered_.z +
              params_[MC_YAWRATE_FF] * w_sp_.z;
    out.roll = clamp(out.roll, -1.0, 1.0);
    out.pitch = clamp(out.pitch, -1.0, 1.0);
    out.yaw = clamp(out.yaw, -1.0, 1.0);
}

Demand Controller::step(const Setpoint &sp, const Motion &m, bool on_ground, double thrust_limit, double dt) {
    if (fresh_) {
        fresh_ = false;
        v_sp_ = m.velocity_ok ? m.v_N : Vec3{0.0, 0.0, m.v_N.z};
        a_sp_ = a_filtered_ = dw_filtered_ = Vec3{};
        w_filtered_ = w_last_ = m.w_F;
        yaw_sp_ = yaw_of(m.q_NF);
    }
    const double hover = params_[MPC_THR_HOVER];
    Demand out;
    if (sp.kind == SetpointKind::Rate) {
        w_sp_ = sp.p;
        collective_ = clamp(or_else(sp.v.x, 0.0), 0.0, params_[MPC_THR_MAX]);
        wants_up_ = collective_ > 0.7 * hover;
        wants_down_ = collective_ < 0.4 * hover;
        integral_ = Vec3{};
        q_sp_ = m.q_NF;
        yaw_sp_ = yaw_of(m.q_NF);
        v_sp_ = m.v_N;
    } else if (sp.kind == SetpointKind::Attitude) {
        const double yaw = slew_yaw(sp, m, on_ground, dt);
        q_sp_ = from_euler(or_else(sp.p.x, 0.0), or_else(sp.p.y, 0.0), yaw);
        collective_ = clamp(or_else(sp.p.z, 0.0), 0.0, params_[MPC_THR_MAX]);
        wants_up_ = collective_ > 0.7 * hover;
        wants_down_ = collective_ < 0.4 * hover;
        integral_ = Vec3{};
        v_sp_ = m.v_N;
        w_sp_ = attitude_loop(m, yaw_rate_ff_);
    } else {
        const Vec3 target = position_loop(sp, m, dt);
        wants_up_ = target.z < -0.15;
        wants_down_ = target.z > 0.15;
        const Vec3 thrust = velocity_loop(sp, m, target, on_ground, dt);
        const Vec3 body_z = (-1.0 / norm(thrust)) * thrust;
        const double yaw = slew_yaw(sp, m, on_ground, dt);
        const Vec3 right{-det::sin(yaw), det::cos(yaw), 0.0};
        Vec3 body_x = cross(right, body_z);
        body_x = (1.0 / norm(body_x)) * body_x;
        q_sp_ = from_axes(body_x, cross(body_z, body_x), body_z);
        // Along the actual body z, not the desired one: a vehicle that is still tilting must not climb.
        const Vec3 actual = rotate(m.q_NF, Vec3{0.0, 0.0, 1.0});
        collective_ = clamp(-dot(thrust, actual), params_[MPC_THR_MIN], params_[MPC_THR_MAX]);
        w_sp_ = attitude_loop(m, yaw_rate_ff_);
    }
    if (on_ground && !wants_up_) {
        collective_ = 0.0;  // landed: motors idle until a climb is commanded
        a_sp_ = integral_ = Vec3{};
    }
    collective_ = std::min(collective_, thrust_limit);
    rate_loop(m, on_ground, dt, out);
    if (on_ground && collective_ < 0.3 * hover) out = Demand{};  // too little thrust to steer, and on the ground
    out.thrust = collective_;
    return out;
}

}  // namespace hil::flight
