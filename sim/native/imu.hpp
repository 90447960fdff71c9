// Strapdown inertial measurement unit with its errors.
//
// Truth at the sensor, at r in B from the centre of mass (means over the step that just ended):
//   f = R(q_mid)^T (a + g z_W) + alpha x r + w_m x (w_m x r)          specific force [m/s2]
//   w = w_m = log(q_before^-1 q) / dt - dt^2/12 w x alpha             angular rate [rad/s]
// The second term turns the rotation vector into the integral of the rate (Bortz 1971, first coning term, rate linear in
// the step). Without the attitude one step before (first sample, or after a gap): w_m = w - alpha dt/2, which is exact
// for a rate linear in the step, and off by dt^2/12 d2w/dt2 otherwise.
// Vibration by rotor r and harmonic h of its speed O, phase theta = integral of O dt, mean over the step dt:
//   v_i = A_hi (O / O_ref)^2 sinc(h O dt / 2) sin(h theta_mid + psi_rhi)
// so vibration above half the output rate aliases from the step mean, as in an IMU that averages over a boxcar.
// Errors of channel i (0..2 accel, 3..5 gyro), y = M f or M w with its vibration:
//   out_i = Q(y_i + b_i + c_i (T(t) - T_ref) + k_i[n] + sum_p x_ip[n] + sigma_i w_i[n])
//   k[n]   = k[n-1] + K_i sqrt(period) n,                   k[0] = 0     rate (acceleration) random walk
//   x_p[n] = phi_p x_p[n-1] + step_ip n,  x_p[0] = start_ip n            bias instability (table: flicker.py)
//   T(t)   = T_end - rise e^{-t / tau}                                   temperature of the warming sensor
// Q rounds to `lsb_i` and saturates at -limit_i and limit_i - word_i. With `take_readings`, y_i + b_i + c_i (T - T_ref) is
// the mean of readings that the rotors shake and that saturate one by one: imu_readings.hpp.
//
// State advances with `index`: reading sample n advances the processes to n, one step per index. For an index before the
// last one, they restart from 0. The rotor phases advance with the time between samples. The attitude of the last sample
// is kept.
//
// Determinism: + - * / sqrt and detmath.hpp only. Nothing is allocated after construction. Not thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "imu_readings.hpp"
#include "noise_stream.hpp"

namespace hil::sim {

inline constexpr int kImuChannels = 6;  // accel x y z, gyro x y z

struct ImuErrorParams {
    double gain[2][9];                  // row-major M of accel and of gyro: identity + scale errors + misalignment
    double bias[kImuChannels];          // turn-on
    double white[kImuChannels + 1];     // deviation of one sample; the last is the temperature reading's
    double walk_step[kImuChannels];     // K sqrt(period)
    double temperature_gain[kImuChannels];
    double temperature_end_degc, temperature_rise_degc, temperature_reference_degc, warm_up_time_s;
    double lsb[kImuChannels], word[kImuChannels], limit[kImuChannels];
    double lever_arm_B_m[3];
    double step_s, gravity_mps2;
    // Flicker: per process a decay, and per channel and process the first and the later steps, [channel][process].
    std::vector<double> flicker_phi, flicker_start, flicker_step;
    // Vibration: harmonic orders; amplitudes [harmonic][channel] at the reference speed; phases as unit phasors
    // cos psi and sin psi, [rotor][harmonic][channel].
    std::vector<double> order, amplitude, phase_cos, phase_sin;
    double reference_speed_radps;
};

struct ImuTruth {
    double q_WB[4], a_WB_W[3], w_WB_B[3], alpha_WB_B[3];
    const double *rotor_speed_radps;
    int rotors;
    std::int64_t t_ns;
};

class Imu {
  public:
    // Keys of the streams of white noise (7 lanes), walks (6) and flicker (6 x processes).
    Imu(ImuErrorParams params, const std::uint64_t white_key[2], const std::uint64_t walk_key[2],
        const std::uint64_t flicker_key[2]);

    // Sample `index`: out = accel[3], gyro[3], temperature.
    void sample(const ImuTruth &truth, std::uint64_t index, double *out);

    // Walk + flicker + white noise alone of samples first .. first + count - 1, [count][7], before rounding: exactly
    // the values that `sample` adds at those indices.
    void noise(std::uint64_t first, std::size_t count, double *out);

    // From now on the airframe vibrates, and a sample is the mean of internal readings.
    void take_readings(ImuReadingsParams params, RotorVibration vibration) {
        readings_ = std::make_unique<ImuReadings>(params, std::move(vibration));
    }
    const ImuReadings *readings() const { return readings_.get(); }

    bool needs_rotors() const { return !rotor_phase_.empty() || readings_; }

  private:
    void noise_at(std::uint64_t index, double *out);
    void restart();
    void add_vibration(const ImuTruth &truth, double *y);
    void mean_rate(const ImuTruth &truth, double *w);

    ImuErrorParams params_;
    NoiseStream white_, walk_, flicker_;
    std::size_t processes_;
    bool started_ = false;
    std::uint64_t index_ = 0;
    double walk_state_[kImuChannels] = {};
    std::vector<double> flicker_state_;
    std::vector<double> rotor_phase_;
    std::unique_ptr<ImuReadings> readings_;
    bool phase_started_ = false;
    std::int64_t phase_t_ns_ = 0;
    bool q_known_ = false;
    double q_before_[4] = {};
    std::int64_t q_t_ns_ = 0;
};

}  // namespace hil::sim
