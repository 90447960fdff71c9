#include "imu.hpp"

#include <utility>

#include "detmath.hpp"
#include "body.hpp"
#include "rotation.hpp"

namespace hil::sim {
namespace {

// sin(x) / x; the series below 1e-4 is exact to rounding (next term x^4/120 < 1e-18).
double sinc(double x) { return x < 1e-4 ? 1.0 - x * x / 6.0 : det::sin(x) / x; }

constexpr double kMostTurn = 2.0;  // rad

}  // namespace

Imu::Imu(ImuErrorParams params, const std::uint64_t white_key[2], const std::uint64_t walk_key[2],
         const std::uint64_t flicker_key[2])
    : params_(std::move(params)),
      white_(white_key[0], white_key[1], kImuChannels + 1),
      walk_(walk_key[0], walk_key[1], kImuChannels),
      flicker_(flicker_key[0], flicker_key[1], kImuChannels * (params_.flicker_phi.empty() ? 1 : params_.flicker_phi.size())),
      processes_(params_.flicker_phi.size()),
      flicker_state_(kImuChannels * processes_),
      rotor_phase_(params_.order.empty() ? 0 : params_.phase_cos.size() / (params_.order.size() * kImuChannels)) {}

void Imu::restart() {
    for (double &value : walk_state_) value = 0.0;
    if (processes_ != 0) {
        const double *n = flicker_.normal(0);
        for (std::size_t i = 0; i < flicker_state_.size(); ++i) flicker_state_[i] = params_.flicker_start[i] * n[i];
    }
    index_ = 0;
    started_ = true;
}

void Imu::noise_at(std::uint64_t index, double *out) {
    if (!started_ || index < index_) restart();
    while (index_ < index) {
        ++index_;
        const double *n = walk_.normal(index_);
        for (int i = 0; i < kImuChannels; ++i) walk_state_[i] += params_.walk_step[i] * n[i];
        if (processes_ == 0) continue;
        const double *m = flicker_.normal(index_);
        std::size_t at = 0;
        for (int i = 0; i < kImuChannels; ++i) {
            for (std::size_t p = 0; p < processes_; ++p, ++at) {
                flicker_state_[at] = params_.flicker_phi[p] * flicker_state_[at] + params_.flicker_step[at] * m[at];
            }
        }
    }
    const double *white = white_.normal(index);
    for (int i = 0; i < kImuChannels; ++i) {
        double sum = walk_state_[i];
        for (std::size_t p = 0; p < processes_; ++p) sum += flicker_state_[static_cast<std::size_t>(i) * processes_ + p];
        out[i] = sum + params_.white[i] * white[i];
    }
    out[kImuChannels] = params_.white[kImuChannels] * white[kImuChannels];
}

void Imu::noise(std::uint64_t first, std::size_t count, double *out) {
    for (std::size_t k = 0; k < count; ++k) noise_at(first + k, out + k * (kImuChannels + 1));
}

void Imu::add_vibration(const ImuTruth &truth, double *y) {
    const double since_s = phase_started_ ? static_cast<double>(truth.t_ns - phase_t_ns_) * 1e-9 : 0.0;
    phase_started_ = true;
    phase_t_ns_ = truth.t_ns;
    const int rotors = truth.rotors < static_cast<int>(rotor_phase_.size()) ? truth.rotors
                                                                             : static_cast<int>(rotor_phase_.size());
    std::size_t at = 0;
    for (int r = 0; r < rotors; ++r) {
        const double speed = truth.rotor_speed_radps[r];
        double &theta = rotor_phase_[static_cast<std::size_t>(r)];
        theta += speed * since_s;
        theta -= 2.0 * det::kPi * std::floor(theta / (2.0 * det::kPi));
        const double ratio = speed / params_.reference_speed_radps;
        const double half_turn = 0.5 * speed * params_.step_s;
        for (std::size_t h = 0; h < params_.order.size(); ++h) {
            const double order = params_.order[h];
            const double size = ratio * ratio * sinc(order * half_turn);
            const double angle = order * (theta - half_turn);
            const double s = size * det::sin(angle), c = size * det::cos(angle);
            for (int i = 0; i < kImuChannels; ++i, ++at) {
                y[i] += params_.amplitude[h * kImuChannels + static_cast<std::size_t>(i)] *
                        (s * params_.phase_cos[at] + c * params_.phase_sin[at]);
            }
        }
    }
}

// Replaces w by the mean rate of the step if its first attitude is known.
void Imu::mean_rate(const ImuTruth &truth, double *w) {
    const double dt = params_.step_s;
    const auto step_ns = static_cast<std::int64_t>(std::floor(dt * 1e9 + 0.5));
    const bool known = q_known_ && truth.t_ns - q_t_ns_ == step_ns;
    const Quat before{q_before_[0], q_before_[1], q_before_[2], q_before_[3]};
    const double *q = truth.q_WB;
    for (int i = 0; i < 4; ++i) q_before_[i] = q[i];
    q_t_ns_ = truth.t_ns;
    q_known_ = true;
    // More than half a turn in a step cannot be told from less.
    if (!known || (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * (dt * dt) > kMostTurn * kMostTurn) return;
    Quat turn = conjugate(before) * Quat{q[0], q[1], q[2], q[3]};
    if (turn.w < 0.0) turn = {-turn.w, -turn.x, -turn.y, -turn.z};
    const double sine = std::sqrt((turn.x * turn.x + turn.y * turn.y) + turn.z * turn.z);
    const double per_sine = sine < 1e-8 ? 2.0 : 2.0 * det::atan2(sine, turn.w) / sine;
    const double *end = truth.w_WB_B, *al = truth.alpha_WB_B;
    const double scale = per_sine / dt, coning = dt * dt / 12.0;
    w[0] = scale * turn.x - coning * (end[1] * al[2] - end[2] * al[1]);
    w[1] = scale * turn.y - coning * (end[2] * al[0] - end[0] * al[2]);
    w[2] = scale * turn.z - coning * (end[0] * al[1] - end[1] * al[0]);
}

void Imu::sample(const ImuTruth &truth, std::uint64_t index, double *out) {
    const ImuErrorParams &p = params_;
    double y[kImuChannels];  // specific force, rate
    ideal_imu(truth.q_WB, truth.a_WB_W, truth.w_WB_B, truth.alpha_WB_B, p.step_s, p.gravity_mps2, y);
    mean_rate(truth, y + 3);
    const double *w = y + 3, *r = p.lever_arm_B_m, *al = truth.alpha_WB_B;
    const double wr[3] = {w[1] * r[2] - w[2] * r[1], w[2] * r[0] - w[0] * r[2], w[0] * r[1] - w[1] * r[0]};
    y[0] += al[1] * r[2] - al[2] * r[1] + (w[1] * wr[2] - w[2] * wr[1]);
    y[1] += al[2] * r[0] - al[0] * r[2] + (w[2] * wr[0] - w[0] * wr[2]);
    y[2] += al[0] * r[1] - al[1] * r[0] + (w[0] * wr[1] - w[1] * wr[0]);
    if (!rotor_phase_.empty()) add_vibration(truth, y);

    double error[kImuChannels + 1];
    noise_at(index, error);
    double temperature = p.temperature_end_degc;
    if (p.temperature_rise_degc != 0.0) {
        temperature -= p.temperature_rise_degc * det::exp(-(static_cast<double>(truth.t_ns) * 1e-9) / p.warm_up_time_s);
    }
    const double away = temperature - p.temperature_reference_degc;
    double mean[kImuChannels];
    if (readings_) {
        double bias[kImuChannels];
        for (int i = 0; i < kImuChannels; ++i) bias[i] = p.bias[i] + p.temperature_gain[i] * away;
        readings_->take(truth.rotor_speed_radps, truth.rotors, truth.t_ns, p.gravity_mps2, p.gain, bias, p.limit, p.word, y,
                        mean);
    }
    for (int i = 0; i < kImuChannels; ++i) {
        const double *m = p.gain[i / 3] + 3 * (i % 3), *v = y + 3 * (i / 3);
        double value;
        if (readings_) {
            value = mean[i] + error[i];
        } else {
            value = m[0] * v[0] + m[1] * v[1] + m[2] * v[2];
            value += p.bias[i] + p.temperature_gain[i] * away + error[i];
        }
        value = std::floor(value / p.lsb[i] + 0.5) * p.lsb[i];
        const double top = p.limit[i] - p.word[i];
        out[i] = value > top ? top : value < -p.limit[i] ? -p.limit[i] : value;
    }
    out[kImuChannels] = temperature + error[kImuChannels];
}

}  // namespace hil::sim
