#include "rotor_vibration.hpp"

#include <cmath>
#include <utility>

#include "detmath.hpp"
#include "noise_stream.hpp"

namespace hil::sim {

namespace {

constexpr double kFullTurn_rad = 2.0 * det::kPi;
constexpr std::int64_t kBlock_ns = 100'000'000;

struct Phasor {
    double re, im;
};

Phasor operator*(Phasor a, Phasor b) { return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
Phasor operator/(Phasor a, Phasor b) {
    const double size2 = b.re * b.re + b.im * b.im;
    return {(a.re * b.re + a.im * b.im) / size2, (a.im * b.re - a.re * b.im) / size2};
}
Phasor turned(double angle) { return {det::cos(angle), det::sin(angle)}; }

Phasor through(double radps, double mount_radps, double mount_damping, double low_pass_radps) {
    Phasor gain{1.0, 0.0};
    if (mount_radps > 0.0) {
        const double u = radps / mount_radps, damped = 2.0 * mount_damping * u;
        gain = Phasor{1.0, damped} / Phasor{1.0 - u * u, damped};
    }
    if (low_pass_radps > 0.0) {
        const double u = radps / low_pass_radps;
        gain = gain / Phasor{1.0 - u * u, std::sqrt(2.0) * u};
    }
    return gain;
}

double within_a_turn(double angle) { return angle - kFullTurn_rad * std::floor(angle / kFullTurn_rad); }

// Adds c cos + s sin of a phasor that turns by `turn` from one reading to the next.
void add_tone(Phasor at, Phasor turn, const double c[3], const double s[3], int readings, double *out) {
    for (int j = 0; j < readings; ++j, out += 3) {
        for (int i = 0; i < 3; ++i) out[i] += c[i] * at.re + s[i] * at.im;
        at = at * turn;
    }
}

// c and s of three channels, with the share of the force that the sensor takes for them.
void sensed(const double *cosine, const double *sine, int first, double own_scale, double force_scale,
            const double *force_gain, double c[3], double s[3]) {
    for (int i = 0; i < 3; ++i) {
        c[i] = own_scale * cosine[first + i];
        s[i] = own_scale * sine[first + i];
        if (!force_gain) continue;
        for (int j = 0; j < 3; ++j) {
            c[i] += force_gain[3 * i + j] * (force_scale * cosine[j]);
            s[i] += force_gain[3 * i + j] * (force_scale * sine[j]);
        }
    }
}

}  // namespace

RotorVibration::RotorVibration(RotorVibrationParams params)
    : p_(std::move(params)),
      theta_(static_cast<std::size_t>(p_.rotors)),
      speed_(static_cast<std::size_t>(p_.rotors)),
      mean_(static_cast<std::size_t>(p_.rotors)) {}

void RotorVibration::advance(const double *speed_radps, int rotors, std::int64_t t_ns) {
    const std::int64_t since_ns = started_ ? t_ns - t_ns_ : 0;
    const double since_s = static_cast<double>(since_ns) * 1e-9;
    const bool one_step = std::fabs(since_s - p_.step_s) < 0.5e-9;
    double squares = 0.0;
    for (int r = 0; r < p_.rotors; ++r) {
        const auto at = static_cast<std::size_t>(r);
        const double now = r < rotors ? speed_radps[r] : 0.0;
        const double mean = started_ ? 0.5 * (speed_[at] + now) : now;
        theta_[at] = within_a_turn(theta_[at] + mean * since_s);
        mean_[at] = one_step ? mean : now;
        speed_[at] = now;
        squares += mean_[at] * mean_[at];
    }
    load_ = p_.rotors == 0 ? 0.0 : squares / p_.rotors / (p_.reference_radps * p_.reference_radps);
    t_ns_ = t_ns;
    started_ = true;
}

const RotorVibration::Block &RotorVibration::block(std::int64_t index) {
    Block &out = blocks_[index % 2];
    if (out.index == index) return out;
    out.index = index;
    double uniform[4];
    std::uint64_t drawn = 0;
    const auto next = [&] {
        if (drawn % 4 == 0) {
            const std::uint64_t counter[4] = {drawn / 4, 0, static_cast<std::uint64_t>(index), 0};
            std::uint64_t bits[4];
            philox(counter, p_.key, bits);
            for (int k = 0; k < 4; ++k) uniform[k] = (static_cast<double>(bits[k] >> 12) + 0.5) * 0x1p-52;
        }
        return uniform[drawn++ % 4];
    };
    const double band = (p_.broadband_radps[1] - p_.broadband_radps[0]) / kTones;
    const double size = std::sqrt(2.0 / kTones);
    for (int m = 0; m < kTones; ++m) {
        out.radps[m] = p_.broadband_radps[0] + band * (m + next());
        for (int i = 0; i < 6; ++i) {
            const double psi = kFullTurn_rad * next();  // cos(x + psi) = cos psi cos x - sin psi sin x
            out.cosine[m][i] = p_.broadband[i] * size * det::cos(psi);
            out.sine[m][i] = -p_.broadband[i] * size * det::sin(psi);
        }
    }
    return out;
}

void RotorVibration::add(int first, int readings, double low_pass_radps, const double *force_gain, double *out) {
    const double apart_s = p_.step_s / readings, before_s = (readings - 1) * apart_s;
    const std::size_t lines = p_.order.size();
    double c[3], s[3];
    for (int r = 0; r < p_.rotors; ++r) {
        const double speed = mean_[static_cast<std::size_t>(r)];
        if (!(speed > 0.0)) continue;
        const double theta = theta_[static_cast<std::size_t>(r)] - speed * before_s;
        for (std::size_t l = 0; l < lines; ++l) {
            const double radps = p_.order[l] * speed;
            const std::size_t at = 6 * (lines * static_cast<std::size_t>(r) + l);
            const Phasor gain = through(radps, p_.mount_radps, p_.mount_damping, low_pass_radps);
            sensed(p_.cosine.data() + at, p_.sine.data() + at, first, first == 0 ? speed * speed : speed, speed * speed,
                   force_gain, c, s);
            add_tone(turned(p_.order[l] * theta) * gain, turned(radps * apart_s), c, s, readings, out);
        }
    }
    if (!(load_ > 0.0 && p_.broadband_radps[1] > 0.0)) return;
    const std::int64_t index = t_ns_ / kBlock_ns, into_ns = t_ns_ - index * kBlock_ns;
    const double share = 0.5 * det::kPi * (static_cast<double>(into_ns) / static_cast<double>(kBlock_ns));
    for (int k = 0; k < 2; ++k) {
        const Block &tones = block(index + k);
        const double weight = load_ * (k == 0 ? det::cos(share) : det::sin(share));
        const double t_s = static_cast<double>(t_ns_) * 1e-9 - before_s;
        for (int m = 0; m < kTones; ++m) {
            const Phasor gain = through(tones.radps[m], p_.mount_radps, p_.mount_damping, low_pass_radps);
            sensed(tones.cosine[m], tones.sine[m], first, weight, weight, force_gain, c, s);
            add_tone(turned(within_a_turn(tones.radps[m] * t_s)) * gain, turned(tones.radps[m] * apart_s), c, s, readings,
                     out);
        }
    }
}

}  // namespace hil::sim
