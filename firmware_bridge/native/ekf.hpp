// Error-state extended Kalman filter: IMU, delayed GPS, barometer, magnetic heading.
//
// Model and Jacobians: mock_pixhawk/estimate/ekf_model.py, from which CasADi generates C++ at build. Error state, 16:
// attitude (3, body frame), velocity (3), position (3), gyro bias (3), accelerometer bias (3), barometer offset (1).
// NED/FRD, SI, double. The covariance is kept exactly symmetric (upper triangle computed, then mirrored) and its
// diagonal bounded; a fusion that would make a variance negative is skipped and counted.
//
// Delay. A GPS fix is tau = EKF_GPS_DELAY old when it arrives. The innovation is taken against the velocity and
// position at that time, from a ring buffer of the last 256 ms, and the measurement row is transformed to that time:
// p(t-tau) = p - tau v + ..., which ties the fix to velocity, attitude and accelerometer bias as well (ekf_model.py,
// "ekf_delayed"). Corrections are applied to the ring too. This costs one row per scalar instead of a second filter
// on a delayed horizon; it neglects the change of attitude error within tau (gyro noise and bias over
// 100 ms: 1e-4 rad).
//
// Measurements are fused one scalar at a time; the three of a group are gated together on the prior, so that one
// outlier rejects its group. Test ratio = innovation^2 / (gate^2 S), limit 1.
//
// Phases: RESTING (averaging gyro, accelerometer and field while the vehicle is still), RUNNING. Yaw comes with the
// first 5 field samples after levelling; the origin with the first acceptable GPS fix after that.
// Bad samples (not finite, out of any sensor's range, stale or repeated time) change nothing and are counted.
//
// No allocation, detmath only: equal inputs give equal bits on every machine.
#pragma once

#include <array>
#include <cstdint>

#include "geodesy.hpp"
#include "params.hpp"
#include "rotation.hpp"

namespace hil::flight {

inline constexpr int kErrors = 16;

struct GpsFix {
    std::int64_t t_us;  // arrival; measured EKF_GPS_DELAY earlier
    Geodetic position;
    Vec3 velocity_N;
    double eph_m, epv_m;
};

struct Rejections {
    std::int64_t imu = 0, gps = 0, baro = 0, mag = 0, numeric = 0;
};

class Ekf {
   public:
    explicit Ekf(const Params &params) : params_(params) { restart(); }

    // Resets the state as at power-up; counters are kept.
    void restart();

    // One IMU sample ending at t_us: gyro [rad/s], specific force [m/s^2], FRD, means over the interval.
    // `may_rest`: the vehicle is on the ground, so that without GPS its velocity may be taken as zero.
    void predict(std::int64_t t_us, Vec3 gyro_F, Vec3 force_F, bool may_rest);

    void fuse_gps(const GpsFix &fix);
    void fuse_baro(std::int64_t t_us, double altitude_m);
    void fuse_mag(std::int64_t t_us, Vec3 field_F_gauss, bool on_ground);
    // Takes yaw from the compass again after the declination changed on the ground.
    void realign_yaw();

    bool tilt_aligned() const { return tilt_aligned_; }
    bool yaw_aligned() const { return yaw_aligned_; }
    bool has_origin() const { return has_origin_; }
    bool attitude_ok() const;
    bool velocity_ok() const;
    bool position_ok() const;

    Quat q_NF() const { return {x_[0], x_[1], x_[2], x_[3]}; }
    Vec3 v_N() const { return {x_[4], x_[5], x_[6]}; }
    Vec3 p_N() const { return {x_[7], x_[8], x_[9]}; }
    Vec3 gyro_bias() const { return {x_[10], x_[11], x_[12]}; }
    Vec3 accel_bias() const { return {x_[13], x_[14], x_[15]}; }
    Vec3 acceleration_N() const { return a_N_; }
    Vec3 rate_F() const { return rate_F_; }
    double baro_offset() const { return baro_offset_; }
    double variance(int i) const { return P_[i][i]; }
    double covariance(int i, int j) const { return P_[i][j]; }
    const LocalTangentPlane &plane() const { return plane_; }
    const Rejections &rejections() const { return rejections_; }
    int resets() const { return resets_; }
    std::int64_t t_us() const { return t_us_; }

    // Largest test ratio of the last sample of each kind, and the normalised innovations squared (3 degrees of
    // freedom for GPS position and velocity) for consistency tests.
    double ratio_gps_p = 0.0, ratio_gps_v = 0.0, ratio_baro = 0.0, ratio_mag = 0.0;
    double nis_gps_p = 0.0, nis_gps_v = 0.0;

   private:
    struct Past {
        std::int64_t t_us;
        Vec3 v, p;
    };
    static constexpr int kRing = 64;
    static constexpr std::int64_t kRingSpacing_us = 3500;  // smallest spacing of entries; 64 entries at 4 ms are 256 ms
    // First index of each part of the error state.
    static constexpr int kTheta = 0, kVel = 3, kPos = 6, kGyroBias = 9, kAccelBias = 12, kBaro = 15;

    struct Row {
        double h[kErrors];
        double innovation, noise_variance;
    };

    bool rest_step(Vec3 gyro_F, Vec3 force_F, double dt);
    void level(Vec3 gyro_mean, Vec3 force_mean);
    void propagate_covariance(const double *imu, double dt);
    bool past_at(std::int64_t t_us, Past &out) const;
    double innovation_variance(const Row &row) const;
    double ratio_of(const Row &row, double gate) const;
    bool fuse_row(const Row &row, double (&dx)[kErrors]);
    void inject(const double (&dx)[kErrors]);
    void set_variance(int i, double variance);
    void bound_covariance();
    void reset_to_gps(const GpsFix &fix, Vec3 p_N, double tau, double var_h, double var_d, double var_v);
    void set_origin(const GpsFix &fix);
    void hold_still();
    void check_finite();

    const Params &params_;
    double x_[16];
    double P_[kErrors][kErrors];
    double baro_offset_;
    Vec3 a_N_, rate_F_, last_gyro_, last_force_;
    std::array<Past, kRing> ring_;
    int ring_head_, ring_count_;
    LocalTangentPlane plane_;

    bool started_, tilt_aligned_, yaw_aligned_, has_origin_, has_baro_;
    std::int64_t t_us_, rest_us_, last_gps_us_, last_gps_ok_us_, last_gps_v_ok_us_, last_baro_us_, last_baro_ok_us_;
    std::int64_t last_mag_us_, last_mag_ok_us_, last_hold_us_;
    int bad_imu_run_;
    double last_baro_m_;
    Vec3 rest_gyro_, rest_force_, mag_sum_, field_N_;
    int rest_count_, mag_count_;
    int resets_ = 0;
    Rejections rejections_;
};

}  // namespace hil::flight
