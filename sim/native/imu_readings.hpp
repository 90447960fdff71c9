// Internal readings of an inertial sensor that vibrates: what reaches a sample when the sensor's own chain is in the way.
//
// In the step that just ended the sensor takes N readings, the last at its end. Reading j of channel i:
//   x_ij = (low-passed motion)_i + v_ij                            v: rotor_vibration.hpp, low-passed too
//   x_ij = x_ij + k v_ij^2                                         accelerometer: rectification of vibration
//   x_3ij += G (specific force - its value at rest, level)         gyroscope: sensitivity to acceleration
//   r_ij = clamp(M x_j + bias, -limit_i, limit_i - word_i)         full scale; counted where it cuts
// and the sample is the mean of r_ij over j, to which imu.hpp adds noise and rounding. What lies above half the rate of
// the readings folds, and so does what lies above half the rate of the samples, by the mean's own attenuation
// sin(N x) / (N sin x), x = W Delta / 2: nothing else filters it, as in a driver that averages its FIFO.
//
// Motion passes the same Butterworth low-pass, whose delay for slow motion is sqrt(2) / W_low. The motion's mean over the
// step is its input, constant over the time since the last sample, and the mean of the output is what the readings see,
// in closed form: with a = W_low / sqrt(2), e the filter's state less its input, T the time since,
//   e(T) = e^{-a T} ((cos + sin) e1 + sin / a e2,  -2 a sin e1 + (cos - sin) e2),  all of a T
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "detmath.hpp"
#include "rotor_vibration.hpp"

namespace hil::sim {

// Butterworth low-pass of order 2 of three channels with a piecewise constant input.
class MotionLowPass {
  public:
    explicit MotionLowPass(double radps) : a_(radps / std::sqrt(2.0)) {}

    // Replaces the input over the last `since_s` by the mean of the output over it. 0: starts at rest there.
    void pass(double since_s, double *u) {
        if (!(a_ > 0.0)) return;
        if (!(since_s > 0.0)) {
            for (int i = 0; i < 3; ++i) state_[i][0] = u[i], state_[i][1] = 0.0;
            return;
        }
        if (since_s != known_s_) find(since_s);
        for (int i = 0; i < 3; ++i) {
            const double e1 = state_[i][0] - u[i], e2 = state_[i][1], input = u[i];
            u[i] = input + (mean_[0] * e1 + mean_[1] * e2);
            state_[i][0] = input + (phi_[0] * e1 + phi_[1] * e2);
            state_[i][1] = phi_[2] * e1 + phi_[3] * e2;
        }
    }

  private:
    void find(double since_s) {
        known_s_ = since_s;
        const double decay = det::exp(-a_ * since_s), c = det::cos(a_ * since_s), s = det::sin(a_ * since_s);
        phi_[0] = decay * (c + s);
        phi_[1] = decay * s / a_;
        phi_[2] = -2.0 * a_ * decay * s;
        phi_[3] = decay * (c - s);
        mean_[0] = ((1.0 - phi_[0]) / a_ - phi_[2] / (2.0 * a_ * a_)) / since_s;
        mean_[1] = (-phi_[1] / a_ + (1.0 - phi_[3]) / (2.0 * a_ * a_)) / since_s;
    }

    double a_, known_s_ = 0.0;
    double phi_[4] = {}, mean_[2] = {}, state_[3][2] = {};
};

struct ImuReadingsParams {
    int count[2];              // of accelerometer and gyroscope in a step
    double low_pass_radps[2];  // 0: none
    double g_sensitivity[9];   // G, row-major [rad/s per m/s2]
    double rectification_s2pm;  // k
};

class ImuReadings {
  public:
    ImuReadings(ImuReadingsParams params, RotorVibration vibration)
        : p_(params),
          vibration_(std::move(vibration)),
          low_pass_{MotionLowPass(params.low_pass_radps[0]), MotionLowPass(params.low_pass_radps[1])},
          shaken_(3 * static_cast<std::size_t>(params.count[0] > params.count[1] ? params.count[0] : params.count[1])) {}

    int rotors() const { return vibration_.rotors(); }
    const std::uint64_t *clipped() const { return clipped_; }

    // Mean readings from the motion y [6] (specific force, rate). gain: M of both, row-major; bias, limit, word [6].
    void take(const double *speed_radps, int rotors, std::int64_t t_ns, double gravity_mps2, const double (&gain)[2][9],
              const double *bias, const double *limit, const double *word, const double *y, double *out) {
        const double since_s = started_ ? static_cast<double>(t_ns - t_ns_) * 1e-9 : 0.0;
        started_ = true;
        t_ns_ = t_ns;
        vibration_.advance(speed_radps, rotors, t_ns);
        for (int part = 0; part < 2; ++part) {
            const int first = 3 * part, n = p_.count[part];
            double x[3], sum[3] = {0.0, 0.0, 0.0};
            for (int i = 0; i < 3; ++i) x[i] = y[first + i];
            const double *G = part == 1 ? p_.g_sensitivity : nullptr;
            if (G) {
                for (int i = 0; i < 3; ++i) {
                    x[i] += (G[3 * i] * y[0] + G[3 * i + 1] * y[1]) + G[3 * i + 2] * (y[2] - gravity_mps2);
                }
            }
            low_pass_[part].pass(since_s, x);
            for (int k = 0; k < 3 * n; ++k) shaken_[static_cast<std::size_t>(k)] = 0.0;
            vibration_.add(first, n, p_.low_pass_radps[part], G, shaken_.data());
            for (int j = 0; j < n; ++j) {
                const double *v = shaken_.data() + 3 * j;
                double z[3];
                for (int i = 0; i < 3; ++i) {
                    z[i] = x[i] + v[i];
                    if (part == 0) z[i] += p_.rectification_s2pm * (v[i] * v[i]);
                }
                for (int i = 0; i < 3; ++i) {
                    const double *m = gain[part] + 3 * i;
                    const int channel = first + i;
                    double reading = (m[0] * z[0] + m[1] * z[1] + m[2] * z[2]) + bias[channel];
                    const double top = limit[channel] - word[channel];
                    if (reading > top || reading < -limit[channel]) {
                        ++clipped_[channel];
                        reading = reading > top ? top : -limit[channel];
                    }
                    sum[i] += reading;
                }
            }
            for (int i = 0; i < 3; ++i) out[first + i] = sum[i] / n;
        }
    }

  private:
    ImuReadingsParams p_;
    RotorVibration vibration_;
    MotionLowPass low_pass_[2];
    std::vector<double> shaken_;
    std::uint64_t clipped_[6] = {};
    bool started_ = false;
    std::int64_t t_ns_ = 0;
};

}  // namespace hil::sim
