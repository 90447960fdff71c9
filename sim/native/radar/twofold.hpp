// Sums and products in twice the digits of a double: hi + lo, lo the rounding error of hi (Dekker 1971; Knuth, TAOCP 2).
//
// Needed because the phase of an echo at 200 m is about 1e5 cycles, and one rounding of it in double is 1e-11 cycles.
// For T = double and SIMD lanes of doubles. Exact only without fused or reassociated arithmetic, as the build ensures.
#pragma once

namespace hil::sim::radar {

#define HIL_TWOFOLD inline __attribute__((always_inline))

template <class T>
struct Twofold {
    T hi, lo;
};

template <class T>
HIL_TWOFOLD Twofold<T> quick_sum(const T &a, const T &b) {  // |a| >= |b|
    const T s = a + b;
    return {s, b - (s - a)};
}

template <class T>
HIL_TWOFOLD Twofold<T> exact_sum(const T &a, const T &b) {
    const T s = a + b;
    const T bb = s - a;
    return {s, (a - (s - bb)) + (b - bb)};
}

// Upper 26 bits of a, so that products of halves are exact. For |a| < 2^996.
template <class T>
HIL_TWOFOLD T upper_half(const T &a) {
    const T c = a * 134217729.0;
    return c - (c - a);
}

template <class T>
HIL_TWOFOLD Twofold<T> exact_product(const T &a, const T &b) {
    const T p = a * b;
    const T ah = upper_half(a), bh = upper_half(b);
    const T al = a - ah, bl = b - bh;
    return {p, ((ah * bh - p) + ah * bl + al * bh) + al * bl};
}

template <class T>
HIL_TWOFOLD Twofold<T> times(const Twofold<T> &a, const T &b) {
    const Twofold<T> p = exact_product(a.hi, b);
    return quick_sum(p.hi, p.lo + a.lo * b);
}

template <class T>
HIL_TWOFOLD Twofold<T> plus(const Twofold<T> &a, const T &b) {
    const Twofold<T> s = exact_sum(a.hi, b);
    return quick_sum(s.hi, s.lo + a.lo);
}

template <class T>
HIL_TWOFOLD Twofold<T> plus(const Twofold<T> &a, const Twofold<T> &b) {
    const Twofold<T> s = exact_sum(a.hi, b.hi);
    return quick_sum(s.hi, s.lo + (a.lo + b.lo));
}

template <class T>
HIL_TWOFOLD Twofold<T> over(const Twofold<T> &a, const T &b) {
    const T q = a.hi / b;
    const Twofold<T> p = exact_product(q, b);
    return quick_sum(q, (((a.hi - p.hi) - p.lo) + a.lo) / b);
}

}  // namespace hil::sim::radar
