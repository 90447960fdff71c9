#include "sweep_rays.hpp"

#include <algorithm>
#include <cmath>

#include "detmath.hpp"

namespace hil::sim {
namespace {

// Each ray has a pose of its own, and each pose is a chain of products that wait for one another: rays are taken
// `kSide` at a time, so that the chains of several run side by side. The same products and sums in the same order.
constexpr std::size_t kSide = 8;
using Side = double[kSide];

// (-1)^k / (2k)! and (-1)^k / (2k + 1)!, highest power first: up to |x| = 1 the first term left out is 1 / 20!.
constexpr double kCos[10] = {-1.0 / 6402373705728000.0, 1.0 / 20922789888000.0, -1.0 / 87178291200.0,
                             1.0 / 479001600.0,         -1.0 / 3628800.0,       1.0 / 40320.0,
                             -1.0 / 720.0,              1.0 / 24.0,             -1.0 / 2.0,
                             1.0};
constexpr double kSinc[10] = {-1.0 / 121645100408832000.0, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0,
                              1.0 / 6227020800.0,          -1.0 / 39916800.0,       1.0 / 362880.0,
                              -1.0 / 5040.0,               1.0 / 120.0,             -1.0 / 6.0,
                              1.0};

// cos x and sin x / x of x^2: series up to |x| = 1, the functions beyond.
void cos_and_sinc(const Side &x2, Side &cosine, Side &sinc) {
    for (std::size_t j = 0; j < kSide; ++j) cosine[j] = kCos[0], sinc[j] = kSinc[0];
    for (int k = 1; k < 10; ++k) {
        for (std::size_t j = 0; j < kSide; ++j) {
            cosine[j] = cosine[j] * x2[j] + kCos[k];
            sinc[j] = sinc[j] * x2[j] + kSinc[k];
        }
    }
    for (std::size_t j = 0; j < kSide; ++j) {
        if (x2[j] > 1.0) {
            const double x = std::sqrt(x2[j]);
            cosine[j] = det::cos(x);
            sinc[j] = det::sin(x) / x;
        }
    }
}

struct Poses {
    Side p[3], R[9];
};

void poses_at(const SweepMotion &m, const Side &s, Poses &out) {
    Side f[3], x2, cosine, sinc;
    for (int i = 0; i < 3; ++i) {
        const double p = m.p[i], c1 = m.c1[i], c2 = m.c2[i], c3 = m.c3[i];
        const double f1 = m.f1[i], f2 = m.f2[i], f3 = m.f3[i];
        for (std::size_t j = 0; j < kSide; ++j) {
            out.p[i][j] = p + s[j] * (c1 + s[j] * (c2 + s[j] * c3));
            f[i][j] = s[j] * (f1 + s[j] * (f2 + s[j] * f3));
        }
    }
    for (std::size_t j = 0; j < kSide; ++j) {
        x2[j] = 0.25 * (f[0][j] * f[0][j] + f[1][j] * f[1][j] + f[2][j] * f[2][j]);
    }
    cos_and_sinc(x2, cosine, sinc);
    const double q0 = m.q_WB[0], q1 = m.q_WB[1], q2 = m.q_WB[2], q3 = m.q_WB[3];
    for (std::size_t j = 0; j < kSide; ++j) {
        const double c = cosine[j], k = sinc[j];
        const double x = 0.5 * k * f[0][j], y = 0.5 * k * f[1][j], z = 0.5 * k * f[2][j];
        const double a = q0 * c - q1 * x - q2 * y - q3 * z, b = q0 * x + q1 * c + q2 * z - q3 * y;
        const double d = q0 * y - q1 * z + q2 * c + q3 * x, e = q0 * z + q1 * y - q2 * x + q3 * c;
        out.R[0][j] = 1.0 - 2.0 * (d * d + e * e), out.R[1][j] = 2.0 * (b * d - a * e);
        out.R[2][j] = 2.0 * (b * e + a * d), out.R[3][j] = 2.0 * (b * d + a * e);
        out.R[4][j] = 1.0 - 2.0 * (b * b + e * e), out.R[5][j] = 2.0 * (d * e - a * b);
        out.R[6][j] = 2.0 * (b * e - a * d), out.R[7][j] = 2.0 * (d * e + a * b);
        out.R[8][j] = 1.0 - 2.0 * (b * b + d * d);
    }
}

}  // namespace

void sweep_rays(const SweepMotion &motion, const std::int32_t *time_offset_ns, const double *origin_B,
                const double *direction_B, double *origin_W, double *direction_W, std::size_t count) {
    Poses pose{};
    for (std::size_t first = 0; first < count; first += kSide) {
        const std::size_t n = std::min(kSide, count - first);
        Side s;
        for (std::size_t j = 0; j < kSide; ++j) s[j] = 1e-9 * time_offset_ns[first + std::min(j, n - 1)];
        poses_at(motion, s, pose);
        for (std::size_t j = 0; j < n; ++j) {
            const std::size_t i = 3 * (first + j);
            const double *o = origin_B + i, *d = direction_B + i;
            for (std::size_t r = 0; r < 3; ++r) {
                const double Rx = pose.R[3 * r][j], Ry = pose.R[3 * r + 1][j], Rz = pose.R[3 * r + 2][j];
                origin_W[i + r] = pose.p[r][j] + (Rx * o[0] + Ry * o[1] + Rz * o[2]);
                direction_W[i + r] = Rx * d[0] + Ry * d[1] + Rz * d[2];
            }
        }
    }
}

}  // namespace hil::sim
