// Cosine and sine of 2 pi x in lanes of doubles. For use in *.isa.cpp only.
#pragma once

#include "../frame/lane_memory.hpp"

namespace hil::sim::radar::HIL_ISA {

using namespace hil::sim::frame::HIL_ISA;

// Adding it rounds x to the nearest integer (|x| < 2^51): subtracting it again gives that integer, and the low bits of
// the sum are the integer in two's complement.
constexpr double kNearest = 6755399441055744.0;

HIL_INLINE D nearest(const D &x) { return (x + kNearest) - kNearest; }

// Error below 2e-16 + |x| 2^-53 * 2 pi for any |x| < 2^49: the reduction by quarter cycles is exact. Polynomials on
// [-pi/4, pi/4] with the coefficients of fdlibm 5.3, as in signals/native/detmath.hpp.
HIL_INLINE void turn(const D &x, D &cosine, D &sine) {
    const D shifted = x * 4.0 + kNearest;
    const L quarter = as<L>(shifted);
    const D angle = (x - (shifted - kNearest) * 0.25) * 6.28318530717958647693;
    const D z = angle * angle;
    D s = z * 1.58969099521155010221e-10 + (-2.50507602534068634195e-08);
    s = s * z + 2.75573137070700676789e-06;
    s = s * z + (-1.98412698298579493134e-04);
    s = s * z + 8.33333333332248946124e-03;
    s = s * z + (-1.66666666666666324348e-01);
    s = angle + (angle * z) * s;
    D c = z * (-1.13596475577881948265e-11) + 2.08757232129817482790e-09;
    c = c * z + (-2.75573143513906633035e-07);
    c = c * z + 2.48015872894767294178e-05;
    c = c * z + (-1.38888888888741095749e-03);
    c = c * z + 4.16666666666666019037e-02;
    c = (z * z) * c + (1.0 - z * 0.5);
    // Quarters 1 and 3 swap cosine and sine; 1 and 2 change the sign of the cosine, 2 and 3 that of the sine.
    const L odd = L(-(quarter & splat<L>(1)));
    const L sine_sign = shift_left(quarter & splat<L>(2), 62);
    const L cosine_sign = shift_left((quarter + splat<L>(1)) & splat<L>(2), 62);
    cosine = as<D>(as<L>(select(odd, s, c)) ^ cosine_sign);
    sine = as<D>(as<L>(select(odd, c, s)) ^ sine_sign);
}

}  // namespace hil::sim::radar::HIL_ISA
