// Ekf: GPS, barometer and compass, each screened, gated and fused; origin, resets, rest. See ekf.hpp.
#include <algorithm>
#include <cmath>

#include "ekf.hpp"
#include "ekf_jacobians.h"

namespace hil::flight {
namespace {

constexpr double kDeg = det::kPi / 180.0;

// A sample beyond these is a fault: 1 km/s, 2 gauss; the Earth's field is above 0.05 gauss.
constexpr double kMaxSpeed = 1000.0, kMaxField = 2.0, kMinField = 0.05;
constexpr double kFieldGain = 0.005;  // per sample: the field's mean over some seconds
constexpr int kYawSamples = 5;        // field samples averaged into the first yaw

double square(double x) { return x * x; }

double component(Vec3 v, int i) { return i == 0 ? v.x : (i == 1 ? v.y : v.z); }

}  // namespace

void Ekf::fuse_gps(const GpsFix &fix) {
    const bool sane = std::isfinite(fix.position.lat_deg) && std::isfinite(fix.position.lon_deg) &&
                      std::fabs(fix.position.lat_deg) <= 90.0 && std::fabs(fix.position.lon_deg) <= 360.0 &&
                      std::isfinite(fix.position.alt_m) && std::fabs(fix.position.alt_m) < 1.0e5 &&
                      is_finite(fix.velocity_N) && norm(fix.velocity_N) < kMaxSpeed && fix.eph_m > 0.0 &&
                      fix.epv_m > 0.0 && fix.eph_m <= params_[EKF_REQ_EPH] && fix.epv_m <= params_[EKF_REQ_EPV];
    if (!sane || fix.t_us <= last_gps_us_ || !started_ || fix.t_us > t_us_ + 1000000) {
        ++rejections_.gps;
        return;
    }
    last_gps_us_ = fix.t_us;
    if (!yaw_aligned_) return;
    if (!has_origin_) {
        set_origin(fix);
        return;
    }
    Past past;
    const auto measured_us = fix.t_us - static_cast<std::int64_t>(params_[EKF_GPS_DELAY] * 1000.0);
    if (!past_at(measured_us, past)) {
        if (ring_count_ == kRing) ++rejections_.gps;  // older than the ring buffer
        return;
    }
    const double tau = std::max(0.0, 1.0e-6 * static_cast<double>(t_us_ - measured_us));
    const Vec3 p_N = plane_.to_ned(fix.position);
    Vec3 force_N{};
    if (tau > 1.0e-3) {
        force_N = (1.0 / tau) * (v_N() - past.v);
        force_N.z -= params_[EKF_GRAVITY];
    }
    const double force[3] = {force_N.x, force_N.y, force_N.z};
    double vt[9], va[9], pt[9], pa[9];
    const double *arg[3] = {x_, force, &tau};
    double *res[4] = {vt, va, pt, pa};
    ::ekf_delayed(arg, res, nullptr, nullptr, 0);

    const double timing = params_[EKF_GPS_T_NOISE];
    const double floor_p = params_[EKF_GPS_P_NOISE];
    const double var_h = square(std::max(fix.eph_m, floor_p)), var_d = square(std::max(fix.epv_m, floor_p));
    const double var_v = square(params_[EKF_GPS_V_NOISE]);
    Row position[3], velocity[3];
    for (int i = 0; i < 3; ++i) {
        std::fill(std::begin(position[i].h), std::end(position[i].h), 0.0);
        std::fill(std::begin(velocity[i].h), std::end(velocity[i].h), 0.0);
        for (int k = 0; k < 3; ++k) {
            position[i].h[kTheta + k] = pt[3 * i + k];
            position[i].h[kAccelBias + k] = pa[3 * i + k];
            velocity[i].h[kTheta + k] = vt[3 * i + k];
            velocity[i].h[kAccelBias + k] = va[3 * i + k];
        }
        position[i].h[kPos + i] = 1.0;
        position[i].h[kVel + i] = -tau;
        velocity[i].h[kVel + i] = 1.0;
        position[i].innovation = component(p_N - past.p, i);
        velocity[i].innovation = component(fix.velocity_N - past.v, i);
        position[i].noise_variance = (i < 2 ? var_h : var_d) + square(timing * component(past.v, i));
        velocity[i].noise_variance = var_v + square(timing * component(a_N_, i));
    }
    const double gate = params_[EKF_GPS_GATE];
    const double ratio_h = std::max(ratio_of(position[0], gate), ratio_of(position[1], gate));
    const double ratio_d = ratio_of(position[2], gate);
    ratio_gps_p = std::max(ratio_h, ratio_d);
    ratio_gps_v =
        std::max(ratio_of(velocity[0], gate), std::max(ratio_of(velocity[1], gate), ratio_of(velocity[2], gate)));
    const bool p_ok = ratio_h <= 1.0, d_ok = ratio_d <= 1.0, v_ok = ratio_gps_v <= 1.0;
    const double reject_us = 1.0e6 * params_[EKF_REJECT_T];
    if (!p_ok || !v_ok || !d_ok) {
        ++rejections_.gps;
        // Fixes of good reported accuracy are rejected again and again: the state is wrong.
        const auto agreed_us = std::min(p_ok && d_ok ? t_us_ : last_gps_ok_us_, v_ok ? t_us_ : last_gps_v_ok_us_);
        if (static_cast<double>(t_us_ - agreed_us) > reject_us) {
            reset_to_gps(fix, p_N, tau, var_h, var_d, var_v);
            return;
        }
    }
    double dx[kErrors] = {};
    const auto fuse = [&](const Row &row, double &nis) {
        double expected = row.innovation;
        for (int i = 0; i < kErrors; ++i) expected -= row.h[i] * dx[i];
        nis += square(expected) / innovation_variance(row);
        fuse_row(row, dx);
    };
    nis_gps_v = nis_gps_p = 0.0;
    if (v_ok) {
        for (const Row &row : velocity) fuse(row, nis_gps_v);
        last_gps_v_ok_us_ = t_us_;
    }
    if (p_ok) {
        fuse(position[0], nis_gps_p);
        fuse(position[1], nis_gps_p);
    }
    if (d_ok) fuse(position[2], nis_gps_p);
    if (p_ok && d_ok) last_gps_ok_us_ = t_us_;
    inject(dx);
    check_finite();
}

void Ekf::set_origin(const GpsFix &fix) {
    plane_.set_origin(fix.position);
    has_origin_ = true;
    const double var_h = square(std::max(fix.eph_m, params_[EKF_GPS_P_NOISE]));
    const double var_d = square(std::max(fix.epv_m, params_[EKF_GPS_P_NOISE]));
    const double tau = 1.0e-3 * params_[EKF_GPS_DELAY];
    reset_to_gps(fix, Vec3{}, tau, var_h, var_d, square(params_[EKF_GPS_V_NOISE]));
    --resets_;  // the first fix is not a reset
    if (has_baro_) {
        // offset = altitude_baro - (altitude_0 - p_D): its error is p_D's plus the barometer's own.
        baro_offset_ = last_baro_m_ - (fix.position.alt_m - x_[9]);
        set_variance(kBaro, P_[kPos + 2][kPos + 2] + square(params_[EKF_BARO_NOISE]));
        P_[kBaro][kPos + 2] = P_[kPos + 2][kBaro] = P_[kPos + 2][kPos + 2];
        last_baro_ok_us_ = t_us_;
    }
}

void Ekf::reset_to_gps(const GpsFix &fix, Vec3 p_N, double tau, double var_h, double var_d, double var_v) {
    const Vec3 v = fix.velocity_N, p = p_N + tau * v;
    const Vec3 dv = v - v_N(), dp = p - this->p_N();
    x_[4] = v.x, x_[5] = v.y, x_[6] = v.z;
    x_[7] = p.x, x_[8] = p.y, x_[9] = p.z;
    for (int i = 0; i < ring_count_; ++i) {
        Past &past = ring_[static_cast<std::size_t>((ring_head_ - i + kRing) % kRing)];
        past.v = past.v + dv;
        past.p = past.p + dp - (1.0e-6 * static_cast<double>(t_us_ - past.t_us)) * dv;
    }
    for (int i = 0; i < 3; ++i) {
        set_variance(kVel + i, var_v + square(0.1));
        set_variance(kPos + i, (i < 2 ? var_h : var_d) + tau * tau * var_v);
    }
    last_gps_ok_us_ = last_gps_v_ok_us_ = t_us_;
    ++resets_;
}

// Without GPS and on the ground: the velocity is zero with 0.1 m/s deviation.
void Ekf::hold_still() {
    last_hold_us_ = t_us_;
    double dx[kErrors] = {};
    for (int i = 0; i < 3; ++i) {
        Row row{};
        row.h[kVel + i] = 1.0;
        row.innovation = -x_[4 + i];
        row.noise_variance = square(0.1);
        fuse_row(row, dx);
    }
    inject(dx);
    if (!has_origin_) {
        for (int i = 0; i < 3; ++i) {
            x_[7 + i] = 0.0;
            set_variance(kPos + i, square(0.1));
        }
    }
}

void Ekf::fuse_baro(std::int64_t t_us, double altitude_m) {
    if (!std::isfinite(altitude_m) || std::fabs(altitude_m) > 5.0e4 || t_us <= last_baro_us_) {
        ++rejections_.baro;
        return;
    }
    last_baro_us_ = t_us;
    if (!has_origin_) {
        last_baro_m_ = has_baro_ ? last_baro_m_ + 0.1 * (altitude_m - last_baro_m_) : altitude_m;
        has_baro_ = true;
        return;
    }
    const double height = plane_.origin().alt_m - x_[9];
    if (!has_baro_) {
        has_baro_ = true;
        baro_offset_ = altitude_m - height;
        set_variance(kBaro, P_[kPos + 2][kPos + 2] + square(params_[EKF_BARO_NOISE]));
        P_[kBaro][kPos + 2] = P_[kPos + 2][kBaro] = P_[kPos + 2][kPos + 2];
        last_baro_ok_us_ = t_us_;
        return;
    }
    Row row{};
    row.h[kPos + 2] = -1.0;
    row.h[kBaro] = 1.0;
    row.innovation = altitude_m - (height + baro_offset_);
    row.noise_variance = square(params_[EKF_BARO_NOISE]);
    ratio_baro = ratio_of(row, params_[EKF_BARO_GATE]);
    if (ratio_baro > 1.0) {
        ++rejections_.baro;
        if (static_cast<double>(t_us_ - last_baro_ok_us_) > 1.0e6 * params_[EKF_REJECT_T]) {
            // The barometer's offset has changed (pressure, sealing); GPS still measures the height.
            baro_offset_ += row.innovation;
            set_variance(kBaro, P_[kPos + 2][kPos + 2] + square(params_[EKF_BARO_NOISE]));
            last_baro_ok_us_ = t_us_;
            ++resets_;
        }
        return;
    }
    last_baro_ok_us_ = t_us_;
    double dx[kErrors] = {};
    fuse_row(row, dx);
    inject(dx);
    check_finite();
}

void Ekf::fuse_mag(std::int64_t t_us, Vec3 field_F, bool on_ground) {
    const bool sane = is_finite(field_F) && norm(field_F) < kMaxField && norm(field_F) > kMinField;
    if (!sane || t_us <= last_mag_us_) {
        ++rejections_.mag;
        return;
    }
    last_mag_us_ = t_us;
    if (!tilt_aligned_) return;
    if (!yaw_aligned_) {
        mag_sum_ = mag_sum_ + field_F;
        if (++mag_count_ < kYawSamples) return;
        field_F = (1.0 / mag_count_) * mag_sum_;
    }
    const Vec3 seen_N = rotate(q_NF(), field_F);
    if (square(seen_N.x) + square(seen_N.y) < square(0.05 * norm(field_F))) {
        ++rejections_.mag;  // the field points along gravity: no heading in it
        return;
    }
    const double innovation = wrap_pi(params_[EKF_MAG_DECL] * kDeg - det::atan2(seen_N.y, seen_N.x));
    const double var = square(params_[EKF_HEAD_NOISE]);
    // The Jacobian is taken at the smoothed field, not at this sample: a row with the sample's own noise
    // appears to measure the tilt, which a dipping field couples to heading, and biases it within seconds.
    const auto heading_row = [&](double value) {
        const Vec3 smooth_F = rotate(conjugate(q_NF()), field_N_);
        const double q[4] = {x_[0], x_[1], x_[2], x_[3]}, field[3] = {smooth_F.x, smooth_F.y, smooth_F.z};
        double h[3];
        const double *arg[2] = {q, field};
        double *res[1] = {h};
        ::ekf_heading(arg, res, nullptr, nullptr, 0);
        Row row{};
        for (int k = 0; k < 3; ++k) row.h[kTheta + k] = h[k];
        row.innovation = value;
        row.noise_variance = var;
        return row;
    };

    const auto take_heading = [&] {
        // Turn about NED down, so that the innovation is zero. The error along body-down becomes unknown,
        // P <- T P T^T + (1 rad)^2 d d^T with T = I - d d^T on the attitude rows, and the heading is then fused as a
        // measurement: a dipping field ties the yaw error to the tilt error, and fusing keeps that correlation.
        const Quat q_next = normalized(Quat{det::cos(0.5 * innovation), 0.0, 0.0, det::sin(0.5 * innovation)} * q_NF());
        x_[0] = q_next.w, x_[1] = q_next.x, x_[2] = q_next.y, x_[3] = q_next.z;
        const Vec3 down = rotate(conjugate(q_next), Vec3{0.0, 0.0, 1.0});
        const double d[3] = {down.x, down.y, down.z};
        double along[kErrors];
        for (int j = 0; j < kErrors; ++j) along[j] = d[0] * P_[0][j] + d[1] * P_[1][j] + d[2] * P_[2][j];
        const double both = d[0] * along[0] + d[1] * along[1] + d[2] * along[2];
        for (int i = 0; i < 3; ++i) {
            for (int j = i; j < kErrors; ++j) {
                double value = P_[i][j] - d[i] * along[j];
                if (j < 3) value += -along[i] * d[j] + d[i] * d[j] * (both + 1.0);
                P_[i][j] = P_[j][i] = value;
            }
        }
        field_N_ = rotate(q_next, field_F);
        const Row heading = heading_row(0.0);
        double dx[kErrors] = {};
        fuse_row(heading, dx);
        yaw_aligned_ = true;
        last_mag_ok_us_ = t_us_;
        bound_covariance();
    };
    if (!yaw_aligned_) {
        take_heading();
        return;
    }
    const Row row = heading_row(innovation);
    ratio_mag = ratio_of(row, params_[EKF_HEAD_GATE]);
    if (ratio_mag > 1.0) {
        ++rejections_.mag;
        // In the air a disturbed compass is the likelier cause: keep the gyro's yaw. On the ground use the compass.
        if (on_ground && static_cast<double>(t_us_ - last_mag_ok_us_) > 1.0e6 * params_[EKF_REJECT_T]) {
            take_heading();
            ++resets_;
        }
        return;
    }
    last_mag_ok_us_ = t_us_;
    double dx[kErrors] = {};
    fuse_row(row, dx);
    inject(dx);
    field_N_ = field_N_ + kFieldGain * (rotate(q_NF(), field_F) - field_N_);
    check_finite();
}

}  // namespace hil::flight
