#include "flight_core.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hil::flight {
namespace {

void put(double *out, Vec3 v) {
    out[0] = v.x;
    out[1] = v.y;
    out[2] = v.z;
}

// A component of a set-point: a number within limits, or NaN for "not commanded".
bool acceptable(double x, double most) { return std::isnan(x) || std::fabs(x) <= most; }
bool acceptable(Vec3 v, double most) { return acceptable(v.x, most) && acceptable(v.y, most) && acceptable(v.z, most); }

}  // namespace

FlightCore::FlightCore(const Params &params, bool rotors)
    : rotors_(rotors), params_(params), ekf_(params_), controller_(params_), land_(params_) {
    mixer_ok_ = rotors_ && mixer_.configure(params_);
    publish_estimate();
    publish_control();
}

bool FlightCore::set_param(std::size_t index, double value) {
    const double old = params_[index];
    params_[index] = value;
    if (rotors_ && index >= THR_MDL_FAC && !mixer_.configure(params_)) {
        params_[index] = old;
        return false;
    }
    if (index == EKF_MAG_DECL && value != old && landed() && ekf_.yaw_aligned()) ekf_.realign_yaw();
    return true;
}

bool FlightCore::set_setpoint(const Setpoint &sp) {
    const int kind = static_cast<int>(sp.kind);
    const bool sane = kind >= 0 && kind <= 5 && acceptable(sp.p, 1.0e6) && acceptable(sp.v, 1.0e3) &&
                      acceptable(sp.a, 1.0e3) && acceptable(sp.yaw, 1.0e3) && acceptable(sp.yawspeed, 1.0e3);
    const bool complete = sp.kind != SetpointKind::Rate || (is_finite(sp.p) && std::isfinite(sp.v.x));
    const bool tilt_sane = sp.kind != SetpointKind::Attitude || (is_finite(sp.p) && std::fabs(sp.p.x) < 3.2 &&
                                                                 std::fabs(sp.p.y) < 1.6);
    if (!sane || !complete || !tilt_sane) {
        ++rejected_setpoints_;
        return false;
    }
    const bool was_flying = static_cast<int>(setpoint_.kind) >= 2, flies = kind >= 2;
    if (flies && !was_flying) {
        controller_.reset();
        ramp_s_ = 0.0;
    }
    setpoint_ = sp;
    return true;
}

void FlightCore::step(std::int64_t t_us, Vec3 gyro_F, Vec3 force_F) {
    const double dt = t_us_ < 0 || t_us <= t_us_ ? 0.0 : std::min(0.02, 1.0e-6 * static_cast<double>(t_us - t_us_));
    // Rest is trusted only with the motors off or idling.
    const bool may_rest = landed() && static_cast<int>(setpoint_.kind) <= 1;
    ekf_.predict(t_us, gyro_F, force_F, may_rest);
    if (dt > 0.0) control(dt);
    if (t_us > t_us_) t_us_ = t_us;
    publish_estimate();
    publish_control();
}

void FlightCore::control(double dt) {
    std::fill(controls_, controls_ + kControlSize, 0.0);
    saturation_ = 1.0;
    if (setpoint_.kind == SetpointKind::Off || !mixer_ok_) {
        land_.disarmed();
        controller_.reset();
        return;
    }
    const bool idle = setpoint_.kind == SetpointKind::Idle;
    if (idle || !ekf_.tilt_aligned()) {
        if (idle && land_.landed()) land_.disarmed();
        for (int i = 0; i < mixer_.rotor_count(); ++i) controls_[i] = mixer_.lifts(i) ? mixer_.idle_command() : 0.0;
        controller_.reset();
        return;
    }
    Motion m;
    m.p_N = ekf_.p_N();
    m.v_N = ekf_.v_N();
    m.a_N = ekf_.acceleration_N();
    m.q_NF = ekf_.q_NF();
    m.w_F = ekf_.rate_F();
    m.position_ok = ekf_.position_ok();
    m.velocity_ok = ekf_.velocity_ok();

    ramp_s_ = land_.landed() && !controller_.wants_up() ? 0.0 : ramp_s_ + dt;
    const double ramp = params_[MPC_TKO_RAMP_T];
    double limit = ramp > 0.0 ? std::min(1.0, ramp_s_ / ramp) : 1.0;
    limit *= land_.thrust_scale();
    const Demand d = controller_.step(setpoint_, m, land_.landed() || land_.contact(), limit, dt);
    const Saturation s = mixer_.allocate(d.roll, d.pitch, d.yaw, d.thrust, controls_);
    controller_.saturated(s);
    saturation_ = s.roll_pitch;
    land_.step(controller_.wants_up(), controller_.wants_down(), controller_.velocity_setpoint().z, m.v_N, m.p_N.z, m.w_F,
               controller_.collective(), dt);
}

void FlightCore::update_gps(const GpsFix &fix) {
    ekf_.fuse_gps(fix);
    publish_estimate();
}

void FlightCore::update_baro(std::int64_t t_us, double altitude_m) {
    ekf_.fuse_baro(t_us, altitude_m);
    publish_estimate();
}

void FlightCore::update_mag(std::int64_t t_us, Vec3 field_F_gauss) {
    ekf_.fuse_mag(t_us, field_F_gauss, landed());
    publish_estimate();
}

void FlightCore::publish_estimate() {
    double *s = state_;
    s[0] = static_cast<double>(ekf_.t_us());
    put(s + 1, ekf_.p_N());
    put(s + 4, ekf_.v_N());
    const Quat q = ekf_.q_NF();
    s[7] = q.w, s[8] = q.x, s[9] = q.y, s[10] = q.z;
    put(s + 11, ekf_.rate_F());
    put(s + 14, ekf_.gyro_bias());
    put(s + 17, ekf_.accel_bias());
    put(s + 20, ekf_.acceleration_N());
    const Geodetic origin = ekf_.plane().origin();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const bool has = ekf_.has_origin();
    put(s + 23, has ? Vec3{origin.lat_deg, origin.lon_deg, origin.alt_m} : Vec3{nan, nan, nan});
    for (int i = 0; i < 3; ++i) {
        s[26 + i] = std::sqrt(ekf_.variance(6 + i));
        s[29 + i] = std::sqrt(ekf_.variance(3 + i));
        s[32 + i] = std::sqrt(ekf_.variance(i));
    }
    s[35] = ekf_.ratio_gps_p, s[36] = ekf_.ratio_gps_v, s[37] = ekf_.ratio_baro, s[38] = ekf_.ratio_mag;
    s[39] = ekf_.attitude_ok() ? 1.0 : 0.0;
    s[40] = ekf_.velocity_ok() ? 1.0 : 0.0;
    s[41] = ekf_.position_ok() ? 1.0 : 0.0;
    s[42] = ekf_.tilt_aligned() ? 1.0 : 0.0;
    s[43] = ekf_.yaw_aligned() ? 1.0 : 0.0;
    s[44] = ekf_.resets();
    const Rejections &r = ekf_.rejections();
    s[45] = static_cast<double>(r.imu), s[46] = static_cast<double>(r.gps), s[47] = static_cast<double>(r.baro);
    s[48] = static_cast<double>(r.mag), s[49] = static_cast<double>(r.numeric);
    put(s + 51, euler_of(q));
    s[60] = ekf_.baro_offset();
    s[61] = ekf_.nis_gps_p, s[62] = ekf_.nis_gps_v;
}

void FlightCore::publish_control() {
    double *s = state_;
    s[50] = static_cast<double>(rejected_setpoints_);
    put(s + 54, euler_of(controller_.attitude_setpoint()));
    s[57] = controller_.collective();
    s[58] = landed() ? 1.0 : 0.0;
    s[59] = land_.contact() ? 1.0 : 0.0;
    s[63] = saturation_;
}

}  // namespace hil::flight
