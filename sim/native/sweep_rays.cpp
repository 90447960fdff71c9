#include "sweep_rays.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim {
namespace {

struct Pose {
    double p[3], R[9];
};

// cos x and sin x / x of x^2: series up to |x| = 1 (the first term left out is 1 / 20!), the functions beyond.
void cos_and_sinc(double x2, double &cosine, double &sinc) {
    if (x2 > 1.0) {
        const double x = std::sqrt(x2);
        cosine = det::cos(x);
        sinc = det::sin(x) / x;
        return;
    }
    // (-1)^k / (2k)! and (-1)^k / (2k + 1)!, highest power first.
    static constexpr double C[10] = {-1.0 / 6402373705728000.0, 1.0 / 20922789888000.0, -1.0 / 87178291200.0,
                                     1.0 / 479001600.0,         -1.0 / 3628800.0,       1.0 / 40320.0,
                                     -1.0 / 720.0,              1.0 / 24.0,             -1.0 / 2.0,
                                     1.0};
    static constexpr double S[10] = {-1.0 / 121645100408832000.0, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0,
                                     1.0 / 6227020800.0,          -1.0 / 39916800.0,       1.0 / 362880.0,
                                     -1.0 / 5040.0,               1.0 / 120.0,             -1.0 / 6.0,
                                     1.0};
    cosine = C[0], sinc = S[0];
    for (int k = 1; k < 10; ++k) {
        cosine = cosine * x2 + C[k];
        sinc = sinc * x2 + S[k];
    }
}

void pose_at(const SweepMotion &m, double s, Pose &out) {
    double f[3];
    for (int i = 0; i < 3; ++i) {
        out.p[i] = m.p[i] + s * (m.c1[i] + s * (m.c2[i] + s * m.c3[i]));
        f[i] = s * (m.f1[i] + s * (m.f2[i] + s * m.f3[i]));
    }
    double c, k;
    cos_and_sinc(0.25 * (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]), c, k);
    const double x = 0.5 * k * f[0], y = 0.5 * k * f[1], z = 0.5 * k * f[2];
    const double *q = m.q_WB;
    const double a = q[0] * c - q[1] * x - q[2] * y - q[3] * z, b = q[0] * x + q[1] * c + q[2] * z - q[3] * y;
    const double d = q[0] * y - q[1] * z + q[2] * c + q[3] * x, e = q[0] * z + q[1] * y - q[2] * x + q[3] * c;
    double *R = out.R;
    R[0] = 1.0 - 2.0 * (d * d + e * e), R[1] = 2.0 * (b * d - a * e), R[2] = 2.0 * (b * e + a * d);
    R[3] = 2.0 * (b * d + a * e), R[4] = 1.0 - 2.0 * (b * b + e * e), R[5] = 2.0 * (d * e - a * b);
    R[6] = 2.0 * (b * e - a * d), R[7] = 2.0 * (d * e + a * b), R[8] = 1.0 - 2.0 * (b * b + d * d);
}

}  // namespace

void sweep_rays(const SweepMotion &motion, const std::int32_t *time_offset_ns, const double *origin_B,
                const double *direction_B, double *origin_W, double *direction_W, std::size_t count) {
    Pose pose{};
    for (std::size_t i = 0; i < count; ++i) {
        // Channels that fire together share a pose.
        if (i == 0 || time_offset_ns[i] != time_offset_ns[i - 1]) pose_at(motion, 1e-9 * time_offset_ns[i], pose);
        const double *o = origin_B + 3 * i, *d = direction_B + 3 * i;
        for (std::size_t r = 0; r < 3; ++r) {
            const double *R = pose.R + 3 * r;
            origin_W[3 * i + r] = pose.p[r] + (R[0] * o[0] + R[1] * o[1] + R[2] * o[2]);
            direction_W[3 * i + r] = R[0] * d[0] + R[1] * d[1] + R[2] * d[2];
        }
    }
}

}  // namespace hil::sim
