// Ekf: alignment at rest, prediction, bounds of the covariance. See ekf.hpp; measurements in ekf_sensors.cpp.
#include "ekf.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "ekf_jacobians.h"

namespace hil::flight {
namespace {

// A sample beyond these is a fault, not motion: 4000 deg/s, 80 g.
constexpr double kMaxRate = 70.0, kMaxForce = 800.0;
constexpr double kLongestStep = 0.1;  // s; a longer gap is propagated over this time only; noise covers the rest

// Bounds of the variances: the lower ones keep gains above zero, the upper ones prevent overflow in a long outage.
constexpr double kFloor[kErrors] = {1e-9, 1e-9, 1e-9, 1e-7, 1e-7, 1e-7, 1e-7,  1e-7,
                                    1e-7, 1e-14, 1e-14, 1e-14, 1e-9, 1e-9, 1e-9, 1e-8};
constexpr double kCeiling[kErrors] = {10.0, 10.0, 10.0, 1e4, 1e4, 1e4, 1e8, 1e8,
                                      1e8,  0.04, 0.04, 0.04, 1.0, 1.0, 1.0, 1e6};

double square(double x) { return x * x; }

}  // namespace

void Ekf::restart() {
    std::fill(std::begin(x_), std::end(x_), 0.0);
    x_[0] = 1.0;
    std::memset(P_, 0, sizeof(P_));
    baro_offset_ = 0.0;
    a_N_ = rate_F_ = last_gyro_ = Vec3{};
    last_force_ = Vec3{0.0, 0.0, -params_[EKF_GRAVITY]};
    ring_head_ = ring_count_ = 0;
    started_ = tilt_aligned_ = yaw_aligned_ = has_origin_ = has_baro_ = false;
    t_us_ = rest_us_ = 0;
    last_gps_us_ = last_baro_us_ = last_mag_us_ = -1;
    last_gps_ok_us_ = last_gps_v_ok_us_ = last_baro_ok_us_ = last_mag_ok_us_ = last_hold_us_ = 0;
    bad_imu_run_ = 0;
    last_baro_m_ = 0.0;
    rest_gyro_ = rest_force_ = mag_sum_ = field_N_ = Vec3{};
    rest_count_ = mag_count_ = 0;
}

bool Ekf::attitude_ok() const {
    return tilt_aligned_ && bad_imu_run_ < 50 && P_[0][0] + P_[1][1] + P_[2][2] < 0.25;
}

bool Ekf::velocity_ok() const {
    if (!attitude_ok() || !yaw_aligned_ || !has_origin_) return false;
    const double age_s = 1.0e-6 * static_cast<double>(t_us_ - std::max(last_gps_ok_us_, last_gps_v_ok_us_));
    return age_s < params_[EKF_NOAID_T] && P_[kVel][kVel] + P_[kVel + 1][kVel + 1] < 4.0;
}

bool Ekf::position_ok() const {
    return velocity_ok() && P_[kPos][kPos] + P_[kPos + 1][kPos + 1] < square(2.0 * params_[EKF_REQ_EPH]);
}

// ------------------------------------------------------------------------------------------------ alignment

bool Ekf::rest_step(Vec3 gyro_F, Vec3 force_F, double dt) {
    const double g = params_[EKF_GRAVITY];
    bool still = norm(gyro_F) < 0.35 && std::fabs(norm(force_F) - g) < 1.5;
    if (still && rest_count_ >= 10) {
        const double n = 1.0 / rest_count_;
        still = norm(gyro_F - n * rest_gyro_) < 0.1 && norm(force_F - n * rest_force_) < 1.0;
    }
    if (!still) {
        rest_gyro_ = rest_force_ = Vec3{};
        rest_count_ = 0;
        rest_us_ = t_us_;
        return false;
    }
    if (rest_count_ == 0) rest_us_ = t_us_ - static_cast<std::int64_t>(dt * 1.0e6);
    rest_gyro_ = rest_gyro_ + gyro_F;
    rest_force_ = rest_force_ + force_F;
    ++rest_count_;
    return rest_count_ >= 10 && 1.0e-6 * static_cast<double>(t_us_ - rest_us_) >= params_[EKF_ALIGN_T];
}

// At rest the specific force is -R^T (0, 0, g): its direction gives roll and pitch. An accelerometer bias db_a
// tilts that by dtheta = (f x db_a) / |f|^2, so attitude and bias start correlated; yaw starts with no variance of
// its own and gets it from the compass.
void Ekf::level(Vec3 gyro_mean, Vec3 force_mean) {
    const Vec3 down = (-1.0 / norm(force_mean)) * force_mean;  // NED down in the body frame
    const double roll = det::atan2(down.y, down.z), pitch = det::asin(clamp(-down.x, -1.0, 1.0));
    const Quat q = from_euler(roll, pitch, 0.0);
    std::fill(std::begin(x_), std::end(x_), 0.0);
    x_[0] = q.w, x_[1] = q.x, x_[2] = q.y, x_[3] = q.z;
    x_[10] = gyro_mean.x, x_[11] = gyro_mean.y, x_[12] = gyro_mean.z;

    const double seconds = params_[EKF_ALIGN_T];
    const double g = norm(force_mean);
    const double accel_bias_var = square(0.1);
    const double tilt_var = square(params_[EKF_ACC_NOISE]) / seconds / square(g) + square(1.0e-4);
    const double gyro_bias_var = square(params_[EKF_GYR_NOISE]) / seconds + square(1.0e-5);
    const double f[3] = {force_mean.x, force_mean.y, force_mean.z};
    const double skew[3][3] = {{0.0, -f[2], f[1]}, {f[2], 0.0, -f[0]}, {-f[1], f[0], 0.0}};
    std::memset(P_, 0, sizeof(P_));
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            double outer = 0.0;
            for (int k = 0; k < 3; ++k) outer += skew[i][k] * skew[j][k];
            P_[i][j] = outer * (accel_bias_var / square(g * g) + tilt_var / square(g));
            P_[i][kAccelBias + j] = P_[kAccelBias + j][i] = skew[i][j] * accel_bias_var / square(g);
        }
        P_[kVel + i][kVel + i] = square(0.1);
        P_[kPos + i][kPos + i] = square(0.1);
        P_[kGyroBias + i][kGyroBias + i] = gyro_bias_var;
        P_[kAccelBias + i][kAccelBias + i] = accel_bias_var;
    }
    P_[kBaro][kBaro] = 1.0;
    tilt_aligned_ = true;
    last_hold_us_ = t_us_;
    bound_covariance();
}

void Ekf::realign_yaw() {
    yaw_aligned_ = false;
    mag_sum_ = Vec3{};
    mag_count_ = 0;
}

// ------------------------------------------------------------------------------------------------ prediction

void Ekf::predict(std::int64_t t_us, Vec3 gyro_F, Vec3 force_F, bool may_rest) {
    const bool sane = is_finite(gyro_F) && is_finite(force_F) && norm(gyro_F) < kMaxRate && norm(force_F) < kMaxForce;
    if (started_ && t_us <= t_us_) {
        ++rejections_.imu;
        return;
    }
    if (!sane) {
        // Bad sample: propagate with the last good one and increased noise.
        ++rejections_.imu;
        ++bad_imu_run_;
        gyro_F = last_gyro_;
        force_F = last_force_;
    } else {
        bad_imu_run_ = 0;
        last_gyro_ = gyro_F;
        last_force_ = force_F;
    }
    if (!started_) {
        started_ = true;
        t_us_ = rest_us_ = t_us;
        return;
    }
    const double gap = 1.0e-6 * static_cast<double>(t_us - t_us_);
    const double dt = std::min(gap, kLongestStep);
    t_us_ = t_us;
    if (!tilt_aligned_) {
        rate_F_ = gyro_F;
        if (sane && rest_step(gyro_F, force_F, dt)) {
            const double n = 1.0 / rest_count_;
            level(n * rest_gyro_, n * rest_force_);
        }
        return;
    }
    const double imu[6] = {gyro_F.x, gyro_F.y, gyro_F.z, force_F.x, force_F.y, force_F.z};
    propagate_covariance(imu, dt);
    const double gravity = params_[EKF_GRAVITY];
    double next[16], a_N[3];
    const double *arg[4] = {x_, imu, &dt, &gravity};
    double *res[2] = {next, a_N};
    ::ekf_predict(arg, res, nullptr, nullptr, 0);
    std::copy(next, next + 16, x_);
    a_N_ = {a_N[0], a_N[1], a_N[2]};
    rate_F_ = gyro_F - gyro_bias();

    const double doubt = (sane ? 0.0 : 100.0) + (gap > dt ? 100.0 * gap / dt : 0.0);
    const double var_gyro = square(params_[EKF_GYR_NOISE]) * dt * (1.0 + doubt);
    const double var_force = square(params_[EKF_ACC_NOISE]) * dt * (1.0 + doubt);
    const double var_bg = square(params_[EKF_GYR_B_NOISE]) * dt, var_ba = square(params_[EKF_ACC_B_NOISE]) * dt;
    for (int i = 0; i < 3; ++i) {
        P_[kTheta + i][kTheta + i] += var_gyro;
        P_[kVel + i][kVel + i] += var_force;
        P_[kGyroBias + i][kGyroBias + i] += var_bg;
        P_[kAccelBias + i][kAccelBias + i] += var_ba;
    }
    P_[kBaro][kBaro] += square(params_[EKF_BARO_DRIFT]) * dt;
    bound_covariance();

    // At IMU rates above 250 Hz the newest entry is overwritten until it is a spacing ahead of the one before, so that
    // the ring reaches equally far into the past at any rate.
    const auto entry = [this](int back) -> Past & {
        return ring_[static_cast<std::size_t>((ring_head_ - back + kRing) % kRing)];
    };
    if (ring_count_ < 2 || entry(0).t_us - entry(1).t_us >= kRingSpacing_us) {
        ring_head_ = (ring_head_ + 1) % kRing;
        ring_count_ = std::min(ring_count_ + 1, kRing);
    }
    entry(0) = {t_us_, v_N(), p_N()};

    const bool no_gps = !has_origin_ || t_us_ - last_gps_ok_us_ > 500000;
    if (may_rest && no_gps && t_us_ - last_hold_us_ >= 100000) hold_still();
    check_finite();
}

// P' = F P F^T with F's sparsity: rows theta (theta, bg), v (theta, v, bg, ba), p (theta, v, p, bg, ba); biases and
// the barometer's offset are random walks (identity rows).
void Ekf::propagate_covariance(const double *imu, double dt) {
    double tt[9], tg[9], vt[9], vg[9], va[9], pt[9], pg[9], pa[9];
    const double *arg[3] = {x_, imu, &dt};
    double *res[8] = {tt, tg, vt, vg, va, pt, pg, pa};
    ::ekf_transition(arg, res, nullptr, nullptr, 0);

    double M[9][kErrors];  // the first 9 rows of F P
    for (int i = 0; i < 3; ++i) {
        for (int c = 0; c < kErrors; ++c) {
            double t = 0.0, v = P_[kVel + i][c], p = P_[kPos + i][c] + dt * P_[kVel + i][c];
            for (int k = 0; k < 3; ++k) {
                const double Pt = P_[kTheta + k][c], Pg = P_[kGyroBias + k][c], Pa = P_[kAccelBias + k][c];
                t += tt[3 * i + k] * Pt + tg[3 * i + k] * Pg;
                v += vt[3 * i + k] * Pt + vg[3 * i + k] * Pg + va[3 * i + k] * Pa;
                p += pt[3 * i + k] * Pt + pg[3 * i + k] * Pg + pa[3 * i + k] * Pa;
            }
            M[i][c] = t;
            M[kVel + i][c] = v;
            M[kPos + i][c] = p;
        }
    }
    for (int r = 0; r < 9; ++r) {
        const double *m = M[r];
        for (int j = 0; j < 3; ++j) {
            double t = 0.0, v = m[kVel + j], p = m[kPos + j] + dt * m[kVel + j];
            for (int k = 0; k < 3; ++k) {
                t += m[kTheta + k] * tt[3 * j + k] + m[kGyroBias + k] * tg[3 * j + k];
                v += m[kTheta + k] * vt[3 * j + k] + m[kGyroBias + k] * vg[3 * j + k] +
                     m[kAccelBias + k] * va[3 * j + k];
                p += m[kTheta + k] * pt[3 * j + k] + m[kGyroBias + k] * pg[3 * j + k] +
                     m[kAccelBias + k] * pa[3 * j + k];
            }
            if (kTheta + j >= r) P_[r][kTheta + j] = t;
            if (kVel + j >= r) P_[r][kVel + j] = v;
            if (kPos + j >= r) P_[r][kPos + j] = p;
        }
        for (int c = 9; c < kErrors; ++c) P_[r][c] = m[c];
    }
    for (int r = 1; r < kErrors; ++r) {
        for (int c = 0; c < std::min(r, 9); ++c) P_[r][c] = P_[c][r];
    }
}

// ------------------------------------------------------------------------------------------------ covariance

void Ekf::set_variance(int i, double variance) {
    for (int j = 0; j < kErrors; ++j) P_[i][j] = P_[j][i] = 0.0;
    P_[i][i] = variance;
}

void Ekf::bound_covariance() {
    for (int i = 0; i < kErrors; ++i) {
        if (P_[i][i] > kCeiling[i]) set_variance(i, kCeiling[i]);
        if (!(P_[i][i] >= kFloor[i])) P_[i][i] = kFloor[i];
    }
}

// Last safeguard: inputs are checked and gains bounded, so no known case reaches this. If one does, the
// filter restarts instead of passing NaN to the controller.
void Ekf::check_finite() {
    double sum = baro_offset_;
    for (const double v : x_) sum += v;
    for (int i = 0; i < kErrors; ++i) sum += P_[i][i];
    if (std::isfinite(sum)) return;
    ++rejections_.numeric;
    ++resets_;
    const std::int64_t t = t_us_;
    restart();
    started_ = true;
    t_us_ = rest_us_ = t;
}

}  // namespace hil::flight
