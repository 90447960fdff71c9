#include "ekf.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "ekf_jacobians.hpp"

namespace hil::flight {
namespace {

constexpr int kTheta = 0, kVel = 3, kPos = 6, kGyroBias = 9, kAccelBias = 12, kBaro = 15;
constexpr double kDeg = det::kPi / 180.0;

// Beyond these a sample is a wire fault, not motion: 4000 deg/s, 80 g, 1 km/s, 2 gauss.
constexpr double kMaxRate = 70.0, kMaxForce = 800.0, kMaxSpeed = 1000.0, kMaxField = 2.0, kMinField = 0.05;
constexpr double kLongestStep = 0.1;  // s; a longer gap is propagated as this and the rest left to the noise
constexpr double kFieldGain = 0.005;  // per sample: the field's mean over some seconds
constexpr int kYawSamples = 5;        // field samples averaged into the first yaw

// Bounds of the variances: floors keep gains alive, ceilings keep a long outage from overflowing.
constexpr double kFloor[kErrors] = {1e-9, 1e-9, 1e-9, 1e-7, 1e-7, 1e-7, 1e-7,  1e-7,
                                    1e-7, 1e-14, 1e-14, 1e-14, 1e-9, 1e-9, 1e-9, 1e-8};
constexpr double kCeiling[kErrors] = {10.0, 10.0, 10.0, 1e4, 1e4, 1e4, 1e8, 1e8,
                                      1e8,  0.04, 0.04, 0.04, 1.0, 1.0, 1.0, 1e6};

double square(double x) { return x * x; }

double component(Vec3 v, int i) { return i == 0 ? v.x : (i == 1 ? v.y : v.z); }

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
        // Time goes on: carry the last good sample, and let the noise say that it is a guess.
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
    const double *const arg[4] = {x_, imu, &dt, &gravity};
    double *const res[2] = {next, a_N};
    generated::ekf_predict(arg, res);
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

    ring_head_ = (ring_head_ + 1) % kRing;
    ring_[static_cast<std::size_t>(ring_head_)] = {t_us_, v_N(), p_N()};
    ring_count_ = std::min(ring_count_ + 1, kRing);

    const bool no_gps = !has_origin_ || t_us_ - last_gps_ok_us_ > 500000;
    if (may_rest && no_gps && t_us_ - last_hold_us_ >= 100000) hold_still();
    check_finite();
}

// P' = F P F^T with F's sparsity: rows theta (theta, bg), v (theta, v, bg, ba), p (theta, v, p, bg, ba); biases and
// the barometer's offset are random walks (identity rows).
void Ekf::propagate_covariance(const double *imu, double dt) {
    double tt[9], tg[9], vt[9], vg[9], va[9], pt[9], pg[9], pa[9];
    const double *const arg[3] = {x_, imu, &dt};
    double *const res[8] = {tt, tg, vt, vg, va, pt, pg, pa};
    generated::ekf_transition(arg, res);

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

// ------------------------------------------------------------------------------------------------ fusion

double Ekf::innovation_variance(const Row &row) const {
    double s = row.noise_variance;
    for (int i = 0; i < kErrors; ++i) {
        if (row.h[i] == 0.0) continue;
        for (int j = 0; j < kErrors; ++j) s += row.h[i] * P_[i][j] * row.h[j];
    }
    return s;
}

double Ekf::ratio_of(const Row &row, double gate) const {
    return square(row.innovation) / (gate * gate * innovation_variance(row));
}

// One scalar. dx collects the correction of the whole group, so the innovation is taken against what the rows
// before it have already moved. Returns false (nothing changed) if a variance would become negative.
bool Ekf::fuse_row(const Row &row, double (&dx)[kErrors]) {
    double PHt[kErrors] = {};
    double innovation = row.innovation;
    for (int i = 0; i < kErrors; ++i) {
        if (row.h[i] == 0.0) continue;
        innovation -= row.h[i] * dx[i];
        for (int j = 0; j < kErrors; ++j) PHt[j] += row.h[i] * P_[i][j];
    }
    double s = row.noise_variance;
    for (int i = 0; i < kErrors; ++i) s += row.h[i] * PHt[i];
    if (!(s > 0.0) || !std::isfinite(innovation)) {
        ++rejections_.numeric;
        return false;
    }
    double K[kErrors];
    for (int i = 0; i < kErrors; ++i) {
        K[i] = PHt[i] / s;
        if (P_[i][i] - K[i] * PHt[i] < 0.0) {
            ++rejections_.numeric;
            return false;
        }
    }
    for (int i = 0; i < kErrors; ++i) {
        for (int j = i; j < kErrors; ++j) {
            P_[i][j] -= K[i] * PHt[j];
            P_[j][i] = P_[i][j];
        }
        dx[i] += K[i] * innovation;
    }
    return true;
}

void Ekf::inject(const double (&dx)[kErrors]) {
    const Quat before = q_NF();
    const Quat q = normalized(before * Quat{1.0, 0.5 * dx[0], 0.5 * dx[1], 0.5 * dx[2]});
    x_[0] = q.w, x_[1] = q.x, x_[2] = q.y, x_[3] = q.z;
    for (int i = 0; i < 12; ++i) x_[4 + i] += dx[3 + i];
    const double gyro_limit = params_[EKF_GBL_LIM], accel_limit = params_[EKF_ABL_LIM];
    for (int i = 10; i < 13; ++i) x_[i] = clamp(x_[i], -gyro_limit, gyro_limit);
    for (int i = 13; i < 16; ++i) x_[i] = clamp(x_[i], -accel_limit, accel_limit);
    baro_offset_ += dx[kBaro];

    // The ring: with da_N = -R [f]x dtheta - R db_a,  dv(t-tau) = dv - tau da,  dp(t-tau) = dp - tau dv + tau^2/2 da.
    const Vec3 f = last_force_ - accel_bias();
    const Vec3 da =
        rotate(before, cross(Vec3{dx[0], dx[1], dx[2]}, f) - Vec3{dx[kAccelBias], dx[kAccelBias + 1], dx[kAccelBias + 2]});
    const Vec3 dv{dx[kVel], dx[kVel + 1], dx[kVel + 2]}, dp{dx[kPos], dx[kPos + 1], dx[kPos + 2]};
    for (int i = 0; i < ring_count_; ++i) {
        Past &past = ring_[static_cast<std::size_t>((ring_head_ - i + kRing) % kRing)];
        const double tau = 1.0e-6 * static_cast<double>(t_us_ - past.t_us);
        past.v = past.v + dv - tau * da;
        past.p = past.p + dp - tau * dv + (0.5 * tau * tau) * da;
    }
    bound_covariance();
}

bool Ekf::past_at(std::int64_t t_us, Past &out) const {
    if (ring_count_ == 0) return false;
    const Past *newer = nullptr;
    for (int i = 0; i < ring_count_; ++i) {
        const Past &past = ring_[static_cast<std::size_t>((ring_head_ - i + kRing) % kRing)];
        if (past.t_us <= t_us) {
            if (newer == nullptr) {  // newer than the last prediction: at most a few ticks ahead
                const double ahead = 1.0e-6 * static_cast<double>(t_us - past.t_us);
                if (ahead > 0.05) return false;
                out = {t_us, past.v + ahead * a_N_, past.p + ahead * past.v};
                return true;
            }
            const double w = static_cast<double>(t_us - past.t_us) / static_cast<double>(newer->t_us - past.t_us);
            out = {t_us, past.v + w * (newer->v - past.v), past.p + w * (newer->p - past.p)};
            return true;
        }
        newer = &past;
    }
    return false;
}

void Ekf::fuse_gps(const GpsFix &fix) {
    const bool sane = std::isfinite(fix.position.lat_deg) && std::isfinite(fix.position.lon_deg) &&
                      std::fabs(fix.position.lat_deg) <= 89.9 && std::fabs(fix.position.lon_deg) <= 360.0 &&
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
        if (ring_count_ == kRing) ++rejections_.gps;  // older than the ring remembers
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
    const double *const arg[3] = {x_, force, &tau};
    double *const res[4] = {vt, va, pt, pa};
    generated::ekf_delayed(arg, res);

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
    const double patience_us = 1.0e6 * params_[EKF_REJECT_T];
    if (!p_ok || !v_ok || !d_ok) {
        ++rejections_.gps;
        // A fix that is good by its own account but keeps disagreeing: the state is what is wrong.
        const auto agreed_us = std::min(p_ok && d_ok ? t_us_ : last_gps_ok_us_, v_ok ? t_us_ : last_gps_v_ok_us_);
        if (static_cast<double>(t_us_ - agreed_us) > patience_us) {
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
    --resets_;  // the first fix is no reset
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

// Without GPS and on the ground: the velocity is zero, give or take 0.1 m/s.
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
            // Its offset has changed (pressure, sealing); the height itself has GPS to lean on.
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
    // The Jacobian is taken at the smoothed field, not at this sample: a row that jitters with the sample's own noise
    // pretends to see the tilt, which a dipping field couples to heading, and biases it within seconds.
    const auto heading_row = [&](double value) {
        const Vec3 smooth_F = rotate(conjugate(q_NF()), field_N_);
        const double q[4] = {x_[0], x_[1], x_[2], x_[3]}, field[3] = {smooth_F.x, smooth_F.y, smooth_F.z};
        double h[3];
        const double *const arg[2] = {q, field};
        double *const res[1] = {h};
        generated::ekf_heading(arg, res);
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
        // In the air a disturbed compass is the likelier culprit: the gyro carries yaw. On the ground believe it.
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

// Sanity of last resort: inputs are screened and gains bounded, so this has no known way to fire; if it does, the
// filter starts over rather than hand NaN to the controller.
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
