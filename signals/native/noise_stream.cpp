#include "noise_stream.hpp"

#include "normal_centre.hpp"

namespace hil {
namespace {

// Product of 64 x 64 bits in 128: one instruction if the compiler has the type, else by 32-bit halves. Same bits.
inline std::uint64_t multiply(std::uint64_t a, std::uint64_t b, std::uint64_t &high) {
#ifdef __SIZEOF_INT128__
    __extension__ using Wide = unsigned __int128;
    const Wide product = static_cast<Wide>(a) * b;
    high = static_cast<std::uint64_t>(product >> 64);
    return static_cast<std::uint64_t>(product);
#else
    const std::uint64_t a0 = a & 0xffffffffULL, a1 = a >> 32, b0 = b & 0xffffffffULL, b1 = b >> 32;
    const std::uint64_t p00 = a0 * b0, p01 = a0 * b1, p10 = a1 * b0, p11 = a1 * b1;
    const std::uint64_t middle = (p00 >> 32) + (p01 & 0xffffffffULL) + (p10 & 0xffffffffULL);
    high = p11 + (p01 >> 32) + (p10 >> 32) + (middle >> 32);
    return a * b;
#endif
}

template <int N>
inline double polynomial(const double (&coefficients)[N], double x) {
    double result = coefficients[0];
    for (int i = 1; i < N; ++i) result = result * x + coefficients[i];
    return result;
}

// x = m 2^k with m in [sqrt(1/2), sqrt(2)); log m = 2 atanh(s), s = (m-1)/(m+1), by its series in s^2; < 2 ulp. Every
// recorded run depends on these bits, which differ from those of det::log.
double log_by_series(double x) {
    static constexpr double kSeries[11] = {1.0 / 23, 1.0 / 21, 1.0 / 19, 1.0 / 17, 1.0 / 15, 1.0 / 13,
                                           1.0 / 11, 1.0 / 9,  1.0 / 7,  1.0 / 5,  1.0 / 3};
    int exponent;
    double m = std::frexp(x, &exponent);
    if (m < 0.70710678118654752440) {
        m *= 2.0;
        exponent -= 1;
    }
    const double f = m - 1.0;
    const double s = f / (2.0 + f);
    const double z = s * s;
    const double series = polynomial(kSeries, z) * z;
    const double k = exponent;
    return k * 6.93147180369123816490e-01 + (2.0 * s * (1.0 + series) + k * 1.90821492927058770002e-10);
}

}  // namespace

// Philox4x64 with ten rounds; constants of the paper.
void philox(const std::uint64_t counter[4], const std::uint64_t key[2], std::uint64_t out[4]) {
    std::uint64_t c0 = counter[0], c1 = counter[1], c2 = counter[2], c3 = counter[3], k0 = key[0], k1 = key[1];
    for (int round = 0; round < 10; ++round) {
        std::uint64_t high0, high1;
        const std::uint64_t low0 = multiply(0xD2E7470EE14C6C93ULL, c0, high0);
        const std::uint64_t low1 = multiply(0xCA5A826395121157ULL, c2, high1);
        c0 = high1 ^ c1 ^ k0;
        c1 = low1;
        c2 = high0 ^ c3 ^ k1;
        c3 = low0;
        k0 += 0x9E3779B97F4A7C15ULL;
        k1 += 0xBB67AE8584CAA73BULL;
    }
    out[0] = c0, out[1] = c1, out[2] = c2, out[3] = c3;
}

double normal_from_uniform(double p) {
    static constexpr double C[8] = {7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177,
                                    1.27045825245236838258,   3.64784832476320460504,   5.7694972214606914055,
                                    4.6303378461565452959,    1.42343711074968357734};
    static constexpr double D[8] = {1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966,
                                    0.14810397642748007459,    0.68976733498510000455,  1.6763848301838038494,
                                    2.05319162663775882187,    1.0};
    static constexpr double E[8] = {2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386,
                                    0.026532189526576123093,   0.29656057182850489123,    1.7848265399172913358,
                                    5.4637849111641143699,     6.6579046435011037772};
    static constexpr double F[8] = {2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5,
                                    7.868691311456132591e-4,    0.0148753612908506148525, 0.13692988092273580531,
                                    0.59983220655588793769,     1.0};
    const double q = p - 0.5;
    if (std::fabs(q) <= normal_centre::kCentre) {
        const double r = 0.180625 - q * q;
        return q * (polynomial(normal_centre::kA, r) / polynomial(normal_centre::kB, r));
    }
    const double r = std::sqrt(-log_by_series(q < 0.0 ? p : 1.0 - p));
    const double value = r <= 5.0 ? polynomial(C, r - 1.6) / polynomial(D, r - 1.6)
                                  : polynomial(E, r - 5.0) / polynomial(F, r - 5.0);
    return q < 0.0 ? -value : value;
}

void NoiseStream::fill(std::uint64_t piece) {
    constexpr std::uint64_t kPieces = kBlock / kPiece;
    std::uint64_t counter[4] = {piece % kPieces * lanes_, 0, piece / kPieces, 0}, bits[4];
    for (std::size_t i = 0; i < values_.size(); i += 4) {
        counter[0] += 1;  // as in numpy, whose generator increments its counter before it draws
        philox(counter, key_, bits);
        for (int lane = 0; lane < 4; ++lane) {
            // 52 bits plus half a step: p is never 0 or 1, and 1 - p is exact.
            values_[i + static_cast<std::size_t>(lane)] =
                normal_from_uniform((static_cast<double>(bits[lane] >> 12) + 0.5) * 0x1p-52);
        }
    }
    piece_ = piece;
    filled_ = true;
}

}  // namespace hil
