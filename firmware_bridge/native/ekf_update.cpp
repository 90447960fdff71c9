// Ekf: fusion of one scalar measurement into state, covariance and ring buffer, and look-up in the ring. See ekf.hpp.
#include <algorithm>
#include <cmath>

#include "ekf.hpp"

namespace hil::flight {
namespace {

double square(double x) { return x * x; }

}  // namespace

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

// Fuses one scalar. dx sums the corrections of the group, so the innovation is taken against the state that the rows
// before it have corrected. Returns false (nothing changed) if a variance would become negative.
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

}  // namespace hil::flight
