#include "mixer.hpp"

#include <algorithm>
#include <cmath>

namespace hil::flight {
namespace {

// Inverse of a symmetric positive definite 4x4, Gauss-Jordan with row pivoting. False if a pivot is negligible.
bool invert4(const double (&a)[4][4], double (&inverse)[4][4]) {
    double m[4][8];
    double largest = 0.0;
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) {
            m[i][j] = a[i][j];
            m[i][4 + j] = i == j ? 1.0 : 0.0;
            largest = std::max(largest, std::fabs(a[i][j]));
        }
    }
    for (int col = 0; col < 4; ++col) {
        int pivot = col;
        for (int row = col + 1; row < 4; ++row) {
            if (std::fabs(m[row][col]) > std::fabs(m[pivot][col])) pivot = row;
        }
        // Yaw moments are the smallest scale: (0.016 m)^2 * 4 = 1e-3; a pivot below 1e-9 of the largest is singular.
        if (!(std::fabs(m[pivot][col]) > 1.0e-9 * largest)) return false;
        for (int j = 0; j < 8; ++j) std::swap(m[col][j], m[pivot][j]);
        const double scale = m[col][col];
        for (int j = 0; j < 8; ++j) m[col][j] /= scale;
        for (int row = 0; row < 4; ++row) {
            if (row == col) continue;
            const double factor = m[row][col];
            for (int j = 0; j < 8; ++j) m[row][j] -= factor * m[col][j];
        }
    }
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) inverse[i][j] = m[i][4 + j];
    }
    return true;
}

}  // namespace

bool Mixer::configure(const Params &params) {
    const int count = static_cast<int>(params[CA_ROTOR_COUNT]);
    if (count < 3 || count > static_cast<int>(kMaxRotors)) return false;
    double b[4][kMaxRotors] = {};
    bool lifts[kMaxRotors] = {};
    int lifting = 0;
    double strongest = 0.0;
    for (int i = 0; i < count; ++i) {
        const double *rotor = &params[CA_ROTOR0_PX + kRotorParams * static_cast<std::size_t>(i)];
        lifts[i] = !(rotor[kRotorAX] > -rotor[kRotorAZ]);
        if (!lifts[i]) continue;
        ++lifting;
        strongest = std::max(strongest, rotor[kRotorCT]);
    }
    if (lifting < 3) return false;
    for (int i = 0; i < count; ++i) {
        const double *rotor = &params[CA_ROTOR0_PX + kRotorParams * static_cast<std::size_t>(i)];
        const double *p = rotor + kRotorPX;
        const double length = std::sqrt((rotor[kRotorAX] * rotor[kRotorAX] + rotor[kRotorAY] * rotor[kRotorAY]) +
                                        rotor[kRotorAZ] * rotor[kRotorAZ]);
        const double share = rotor[kRotorCT] / strongest, km = rotor[kRotorKM];
        const double a[3] = {rotor[kRotorAX] / length, rotor[kRotorAY] / length, rotor[kRotorAZ] / length};
        if (!(strongest > 0.0) || !(length > 0.0)) return false;
        if (!lifts[i]) continue;
        b[0][i] = share * ((p[1] * a[2] - p[2] * a[1]) - km * a[0]);
        b[1][i] = share * ((p[2] * a[0] - p[0] * a[2]) - km * a[1]);
        b[2][i] = share * ((p[0] * a[1] - p[1] * a[0]) - km * a[2]);
        b[3][i] = -share * a[2];
    }
    double gram[4][4] = {}, inverse[4][4];
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
            for (int i = 0; i < count; ++i) gram[r][c] += b[r][i] * b[c][i];
        }
    }
    if (!invert4(gram, inverse)) return false;
    double mix[kMaxRotors][4] = {};
    for (int i = 0; i < count; ++i) {
        for (int c = 0; c < 4; ++c) {
            for (int r = 0; r < 4; ++r) mix[i][c] += b[r][i] * inverse[r][c];
        }
    }
    double square_roll = 0.0, square_pitch = 0.0, largest_yaw = 0.0, sum_thrust = 0.0;
    for (int i = 0; i < count; ++i) {
        square_roll += mix[i][0] * mix[i][0];
        square_pitch += mix[i][1] * mix[i][1];
        largest_yaw = std::max(largest_yaw, std::fabs(mix[i][2]));
        sum_thrust += mix[i][3];
    }
    const double scale[4] = {std::sqrt(std::max(square_roll, square_pitch) / (0.5 * lifting)),
                             std::sqrt(std::max(square_roll, square_pitch) / (0.5 * lifting)), largest_yaw,
                             sum_thrust / lifting};
    for (const double s : scale) {
        if (!(s > 0.0)) return false;
    }
    for (int i = 0; i < static_cast<int>(kMaxRotors); ++i) {
        for (int c = 0; c < 4; ++c) mix_[i][c] = i < count ? mix[i][c] / scale[c] : 0.0;
        lifts_[i] = lifts[i];
    }
    count_ = count;
    curve_ = params[THR_MDL_FAC];
    idle_command_ = params[MOT_SPIN_IDLE];
    idle_thrust_ = (curve_ * idle_command_ + (1.0 - curve_)) * idle_command_;
    return true;
}

double Mixer::motor_command(double thrust_fraction) const {
    const double t = std::max(0.0, thrust_fraction);
    if (curve_ < 1.0e-6) return t;
    const double linear = 1.0 - curve_;
    return (std::sqrt(linear * linear + 4.0 * curve_ * t) - linear) / (2.0 * curve_);
}

Saturation Mixer::allocate(double roll, double pitch, double yaw, double thrust, double *u_out) const {
    Saturation s;
    const double lo = idle_thrust_, hi = 1.0;
    double tilt[kMaxRotors], largest = 0.0, smallest = 0.0;
    for (int i = 0; i < count_; ++i) {
        tilt[i] = mix_[i][0] * roll + mix_[i][1] * pitch;
        largest = i == 0 ? tilt[i] : std::max(largest, tilt[i]);
        smallest = i == 0 ? tilt[i] : std::min(smallest, tilt[i]);
    }
    if (largest - smallest > hi - lo) s.roll_pitch = (hi - lo) / (largest - smallest);
    // The collective's share differs between rotors of an asymmetric frame, so the bounds are taken rotor by rotor.
    double t = thrust;
    for (int i = 0; i < count_; ++i) {
        const double share = mix_[i][3];
        if (share > 0.0) t = std::min(t, (hi - s.roll_pitch * tilt[i]) / share);
    }
    t = std::max(t, 0.0);
    for (int i = 0; i < count_; ++i) {
        const double room = std::max(0.0, mix_[i][3] * t - lo);
        if (tilt[i] < 0.0 && -s.roll_pitch * tilt[i] > room) s.roll_pitch = room / -tilt[i];
    }
    s.thrust_excess = thrust - t;
    double base[kMaxRotors];
    for (int i = 0; i < count_; ++i) {
        base[i] = mix_[i][3] * t + s.roll_pitch * tilt[i];
        const double wish = mix_[i][2] * yaw;
        const double room = std::max(0.0, wish > 0.0 ? hi - base[i] : base[i] - lo);
        if (std::fabs(wish) * s.yaw > room) s.yaw = room / std::fabs(wish);
    }
    for (int i = 0; i < static_cast<int>(kMaxRotors); ++i) {
        if (i >= count_ || !lifts_[i]) {
            u_out[i] = 0.0;
            continue;
        }
        const double force = base[i] + s.yaw * mix_[i][2] * yaw;
        u_out[i] = motor_command(std::min(hi, std::max(lo, force)));
    }
    return s;
}

}  // namespace hil::flight
