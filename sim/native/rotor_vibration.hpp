// Vibration of the airframe as one inertial sensor feels it: lines of the rotors and a broadband part, through the mount
// and the sensor's own low-pass, at the instants of the sensor's internal readings.
//
// Line l of rotor r, order h_l, theta_r = integral of its speed O_r (trapezoids between samples), channel i (0..2 specific
// force, 3..5 rate):
//   v_i(t) = O_r^2 (C_i cos h theta + S_i sin h theta)    force   (a rigid body: F / m + alpha x p)
//   v_i(t) = O_r   (C_i cos h theta + S_i sin h theta)    rate    (its integral over time)
// Broadband (random phases, Shinozuka and Deodatis, Appl. Mech. Rev. 44, 1991): in each of overlapping blocks of 0.1 s,
// kTones tones of equal size, one at a random frequency in each of kTones equal bands between two limits:
//   b_i(t) = s (O^2 / O_ref^2) sqrt(2 / kTones) sum_m w(t) cos(2 pi f_m t + psi_im),   O^2 the mean over the rotors
// Neighbouring blocks are weighted by cos and sin of the same angle, so that the RMS is s at every t, and the spectrum is
// flat over runs of many blocks. A block is a function of the key and its number alone.
// Each line and tone of angular frequency W passes
//   H_mount = (1 + 2 z j u) / (1 - u^2 + 2 z j u),      u = W / W_mount     (base excitation of a damped oscillator)
//   H_low   = 1 / (1 - u^2 + sqrt(2) j u),              u = W / W_low       (Butterworth, order 2; -3 dB at W_low)
// as in steady state: a rotor's speed changes little over the time in which these settle (a few periods).
//
// Determinism: + - * / sqrt and detmath.hpp only, fixed order. Nothing is allocated after construction.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace hil::sim {

struct RotorVibrationParams {
    int rotors = 0;
    std::vector<double> order;         // of each line
    std::vector<double> cosine, sine;  // C and S, [rotor][line][6]
    double mount_radps = 0.0, mount_damping = 0.0;  // 0: rigid
    double broadband[6] = {};          // s
    double broadband_radps[2] = {};    // limits
    double reference_radps = 1.0;      // O_ref
    std::uint64_t key[2] = {};
    double step_s = 0.0;
};

class RotorVibration {
  public:
    static constexpr int kTones = 16;

    explicit RotorVibration(RotorVibrationParams params);

    int rotors() const { return p_.rotors; }

    // Advances the rotors' phases to the end of a step at `t_ns`. Samples need not follow each other.
    void advance(const double *speed_radps, int rotors, std::int64_t t_ns);

    // Adds channels first .. first + 2 at `readings` instants that divide the step just taken, the last of them at its end,
    // to out [readings][3], after a low-pass (0: none). `force_gain`, row-major 3 x 3 or null: adds this times the
    // specific force.
    void add(int first, int readings, double low_pass_radps, const double *force_gain, double *out);

  private:
    struct Block {
        std::int64_t index = -1;
        double radps[kTones], cosine[kTones][6], sine[kTones][6];  // of the phase, times s sqrt(2 / kTones)
    };
    const Block &block(std::int64_t index);

    RotorVibrationParams p_;
    std::vector<double> theta_, speed_, mean_;
    std::int64_t t_ns_ = 0;
    bool started_ = false;
    double load_ = 0.0;  // mean O^2 / O_ref^2
    Block blocks_[2];
};

}  // namespace hil::sim
