// Elementary functions that give the same bits on every machine.
//
// <cmath> is not used: the C library picks a variant of sin, cos, exp, log, pow and atan2 by the features of the CPU
// (with or without fused multiply-add), and the variants differ in the last bit. One such bit in an attitude is a
// different digest thirty thousand steps later. The functions here use only + - * / sqrt and integer operations, which
// IEEE 754 defines exactly, and are compiled with -ffp-contract=off.
//
// Method and minimax coefficients: fdlibm 5.3 (Sun Microsystems, 1993), as published. The errors stated with each
// function, in units of the last place, were swept against high-precision references (tests/reference/).
//
// All functions: scalar in, scalar out, no state, no allocation. NaN in gives NaN out.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace hil::det {

inline constexpr double kPi = 3.14159265358979311600e+00;
inline constexpr double kHalfPi = 1.57079632679489655800e+00;

namespace detail {

// sin on [-pi/4, pi/4]; y is the tail of x (x + y is the argument).
inline double sin_kernel(double x, double y) {
    constexpr double S1 = -1.66666666666666324348e-01, S2 = 8.33333333332248946124e-03,
                     S3 = -1.98412698298579493134e-04, S4 = 2.75573137070700676789e-06,
                     S5 = -2.50507602534068634195e-08, S6 = 1.58969099521155010221e-10;
    const double z = x * x;
    const double v = z * x;
    const double r = S2 + z * (S3 + z * (S4 + z * (S5 + z * S6)));
    return x - ((z * (0.5 * y - v * r) - y) - v * S1);
}

// cos on [-pi/4, pi/4]; y is the tail of x.
inline double cos_kernel(double x, double y) {
    constexpr double C1 = 4.16666666666666019037e-02, C2 = -1.38888888888741095749e-03,
                     C3 = 2.48015872894767294178e-05, C4 = -2.75573143513906633035e-07,
                     C5 = 2.08757232129817482790e-09, C6 = -1.13596475577881948265e-11;
    const double z = x * x;
    const double r = z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * C6)))));
    const double hz = 0.5 * z;
    const double w = 1.0 - hz;
    return w + (((1.0 - w) - hz) + (z * r - x * y));
}

struct Reduced {
    double head, tail;
    int quadrant;
};

// x - n*pi/2 in two doubles, Cody-Waite with pi/2 in three parts of 33 bits.
// Products are exact up to n = 2^20. Beyond that fmod (itself exact) folds the argument by a rounded 2*pi first, with an
// absolute error of about |x| * 1e-16.
inline Reduced reduce_half_pi(double x) {
    constexpr double kInvHalfPi = 6.36619772367581382433e-01;
    constexpr double kP1 = 1.57079632673412561417e+00, kP1t = 6.07710050650619224932e-11;
    constexpr double kP2 = 6.07710050630396597660e-11, kP2t = 2.02226624879595063154e-21;
    constexpr double kP3 = 2.02226624871116645580e-21, kP3t = 8.47842766036889956997e-32;
    if (std::fabs(x) > 1.0e6) x = std::fmod(x, 2.0 * kPi);
    const double n = std::floor(x * kInvHalfPi + 0.5);
    double r = x - n * kP1;
    double w = n * kP1t;
    double head = r - w;
    // Near a multiple of pi/2 the leading bits cancel: subtract the next parts of pi/2.
    if (std::fabs(head) < 1.0e-5 * std::fabs(x) || std::fabs(head) < 1.0e-3) {
        double t = r;
        w = n * kP2;
        r = t - w;
        w = n * kP2t - ((t - r) - w);
        head = r - w;
        // Only if the second step cancelled too: otherwise this would drop that step's rounding error.
        if (std::fabs(head) < 0x1p-49 * std::fabs(x)) {
            t = r;
            w = n * kP3;
            r = t - w;
            w = n * kP3t - ((t - r) - w);
            head = r - w;
        }
    }
    return {head, (r - head) - w, static_cast<int>(static_cast<std::int64_t>(n) & 3)};
}

}  // namespace detail

// sin(x), x in rad. Error < 1 ulp for |x| <= 1e6.
inline double sin(double x) {
    if (!std::isfinite(x)) return std::numeric_limits<double>::quiet_NaN();
    if (std::fabs(x) <= 0.25 * kPi) return detail::sin_kernel(x, 0.0);
    const auto r = detail::reduce_half_pi(x);
    switch (r.quadrant) {
        case 0: return detail::sin_kernel(r.head, r.tail);
        case 1: return detail::cos_kernel(r.head, r.tail);
        case 2: return -detail::sin_kernel(r.head, r.tail);
        default: return -detail::cos_kernel(r.head, r.tail);
    }
}

// cos(x), x in rad. Error < 1 ulp for |x| <= 1e6.
inline double cos(double x) {
    if (!std::isfinite(x)) return std::numeric_limits<double>::quiet_NaN();
    if (std::fabs(x) <= 0.25 * kPi) return detail::cos_kernel(x, 0.0);
    const auto r = detail::reduce_half_pi(x);
    switch (r.quadrant) {
        case 0: return detail::cos_kernel(r.head, r.tail);
        case 1: return -detail::sin_kernel(r.head, r.tail);
        case 2: return -detail::cos_kernel(r.head, r.tail);
        default: return detail::sin_kernel(r.head, r.tail);
    }
}

// x * 2^k for results in the normal range, in two steps so that k = 1024 and k < -1022 are correct.
inline double scale_by_power_of_two(double x, int k) {
    while (k > 1023) {
        x *= 0x1p1023;
        k -= 1023;
    }
    while (k < -1022) {
        x *= 0x1p-1022;
        k += 1022;
    }
    return x * std::bit_cast<double>(static_cast<std::uint64_t>(k + 1023) << 52);
}

// e^x. Error < 1 ulp.
inline double exp(double x) {
    constexpr double kLn2Hi = 6.93147180369123816490e-01, kLn2Lo = 1.90821492927058770002e-10;
    constexpr double kInvLn2 = 1.44269504088896338700e+00;
    constexpr double P1 = 1.66666666666666019037e-01, P2 = -2.77777777770155933842e-03,
                     P3 = 6.61375632143793436117e-05, P4 = -1.65339022054652515390e-06,
                     P5 = 4.13813679705723846039e-08;
    if (std::isnan(x)) return x;
    if (x > 709.782712893383973096) return std::numeric_limits<double>::infinity();
    if (x < -745.13321910194110842) return 0.0;
    const double n = std::floor(x * kInvLn2 + 0.5);
    const double hi = x - n * kLn2Hi;
    const double lo = n * kLn2Lo;
    const double r = hi - lo;
    const double t = r * r;
    const double c = r - t * (P1 + t * (P2 + t * (P3 + t * (P4 + t * P5))));
    const double y = 1.0 - ((lo - (r * c) / (2.0 - c)) - hi);
    return scale_by_power_of_two(y, static_cast<int>(n));
}

// Natural logarithm. Error < 1 ulp. log(0) = -inf, log(x < 0) = NaN.
inline double log(double x) {
    constexpr double kLn2Hi = 6.93147180369123816490e-01, kLn2Lo = 1.90821492927058770002e-10;
    constexpr double L1 = 6.666666666666735130e-01, L2 = 3.999999999940941908e-01,
                     L3 = 2.857142874366239149e-01, L4 = 2.222219843214978396e-01,
                     L5 = 1.818357216161805012e-01, L6 = 1.531383769920937332e-01,
                     L7 = 1.479819860511658591e-01;
    if (std::isnan(x) || x == std::numeric_limits<double>::infinity()) return x;
    if (x == 0.0) return -std::numeric_limits<double>::infinity();
    if (x < 0.0) return std::numeric_limits<double>::quiet_NaN();
    int k = 0;
    if (x < 0x1p-1022) {
        x *= 0x1p54;
        k -= 54;
    }
    std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
    k += static_cast<int>(bits >> 52) - 1023;
    bits = (bits & 0x000fffffffffffffULL) | 0x3ff0000000000000ULL;
    double m = std::bit_cast<double>(bits);
    if (m > 1.41421356237309514547) {
        m *= 0.5;
        k += 1;
    }
    const double f = m - 1.0;
    const double dk = static_cast<double>(k);
    const double s = f / (2.0 + f);
    const double z = s * s;
    const double w = z * z;
    const double t1 = w * (L2 + w * (L4 + w * L6));
    const double t2 = z * (L1 + w * (L3 + w * (L5 + w * L7)));
    const double r = t2 + t1;
    const double hfsq = 0.5 * f * f;
    return dk * kLn2Hi - ((hfsq - (s * (hfsq + r) + dk * kLn2Lo)) - f);
}

// x^y for x > 0, as exp(y log x): relative error about (1 + |y log x|) * 2e-16, sufficient for the barometric formula
// (|y log x| < 2). x <= 0 gives NaN.
inline double pow(double x, double y) { return x > 0.0 ? exp(y * log(x)) : std::numeric_limits<double>::quiet_NaN(); }

// Arc tangent. Error < 1 ulp.
inline double atan(double x) {
    constexpr double kHi[4] = {4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01,
                               1.57079632679489655800e+00};
    constexpr double kLo[4] = {2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
                               6.12323399573676603587e-17};
    constexpr double A[11] = {3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
                              -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
                              6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
                              -3.65315727442169155270e-02, 1.62858201153657823623e-02};
    if (std::isnan(x)) return x;
    const bool negative = std::signbit(x);
    double a = std::fabs(x);
    if (a > 0x1p66) return negative ? -kHalfPi : kHalfPi;
    int id = -1;
    if (a >= 2.4375) {
        id = 3;
        a = -1.0 / a;
    } else if (a >= 1.1875) {
        id = 2;
        a = (a - 1.5) / (1.0 + 1.5 * a);
    } else if (a >= 0.6875) {
        id = 1;
        a = (a - 1.0) / (a + 1.0);
    } else if (a >= 0.4375) {
        id = 0;
        a = (2.0 * a - 1.0) / (2.0 + a);
    }
    const double z = a * a;
    const double w = z * z;
    const double s1 = z * (A[0] + w * (A[2] + w * (A[4] + w * (A[6] + w * (A[8] + w * A[10])))));
    const double s2 = w * (A[1] + w * (A[3] + w * (A[5] + w * (A[7] + w * A[9]))));
    const double r = id < 0 ? a - a * (s1 + s2) : kHi[id] - ((a * (s1 + s2) - kLo[id]) - a);
    return negative ? -r : r;
}

// Angle of (x, y) in (-pi, pi], rad. Error < 2 ulp.
inline double atan2(double y, double x) {
    if (std::isnan(x) || std::isnan(y)) return std::numeric_limits<double>::quiet_NaN();
    if (y == 0.0) return std::signbit(x) ? std::copysign(kPi, y) : y;
    if (x == 0.0) return std::copysign(kHalfPi, y);
    if (std::isinf(x) || std::isinf(y)) {
        if (std::isinf(x) && std::isinf(y)) return std::copysign(x > 0.0 ? 0.25 * kPi : 0.75 * kPi, y);
        if (std::isinf(y)) return std::copysign(kHalfPi, y);
        return x > 0.0 ? std::copysign(0.0, y) : std::copysign(kPi, y);
    }
    const double a = atan(std::fabs(y / x));
    constexpr double kPiLo = 1.2246467991473531772e-16;
    const double r = x > 0.0 ? a : kPi - (a - kPiLo);
    return std::copysign(r, y);
}

// Arc sine on [-1, 1], rad; NaN outside. Error < 3 ulp.
inline double asin(double x) { return atan2(x, std::sqrt((1.0 - x) * (1.0 + x))); }

}  // namespace hil::det
