// Loads and stores of eight rows of three numbers, x y z x y z ... in memory.
#pragma once

#include "lane_memory.hpp"

namespace hil::sim::frame::HIL_ISA {

HIL_INLINE Vec<D> load_rows(const double *from) {
    Vec<D> v;
#if defined(__AVX512F__)
    const DoubleRegister a = (DoubleRegister)_mm512_loadu_pd(from), b = (DoubleRegister)_mm512_loadu_pd(from + 8),
                         c = (DoubleRegister)_mm512_loadu_pd(from + 16);
    const DoubleRegister x = HIL_SHUFFLE(a, b, LongRegister, 0, 3, 6, 9, 12, 15, 0, 0);
    const DoubleRegister y = HIL_SHUFFLE(a, b, LongRegister, 1, 4, 7, 10, 13, 0, 0, 0);
    const DoubleRegister z = HIL_SHUFFLE(a, b, LongRegister, 2, 5, 8, 11, 14, 0, 0, 0);
    v.x.r[0] = HIL_SHUFFLE(x, c, LongRegister, 0, 1, 2, 3, 4, 5, 10, 13);
    v.y.r[0] = HIL_SHUFFLE(y, c, LongRegister, 0, 1, 2, 3, 4, 8, 11, 14);
    v.z.r[0] = HIL_SHUFFLE(z, c, LongRegister, 0, 1, 2, 3, 4, 9, 12, 15);
#else
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        const double *r = from + 3 * i * (kRegisterBytes / 8);
#if defined(__AVX2__)
        v.x.r[i] = (DoubleRegister){r[0], r[3], r[6], r[9]};
        v.y.r[i] = (DoubleRegister){r[1], r[4], r[7], r[10]};
        v.z.r[i] = (DoubleRegister){r[2], r[5], r[8], r[11]};
#else
        v.x.r[i] = (DoubleRegister){r[0], r[3]};
        v.y.r[i] = (DoubleRegister){r[1], r[4]};
        v.z.r[i] = (DoubleRegister){r[2], r[5]};
#endif
    }
#endif
    return v;
}

HIL_INLINE void store_rows(double *to, const Vec<D> &v) {
#if defined(__AVX512F__)
    const DoubleRegister x = v.x.r[0], y = v.y.r[0], z = v.z.r[0];
    const DoubleRegister a = HIL_SHUFFLE(x, y, LongRegister, 0, 8, 0, 1, 9, 0, 2, 10);
    const DoubleRegister b = HIL_SHUFFLE(x, y, LongRegister, 0, 3, 11, 0, 4, 12, 0, 5);
    const DoubleRegister c = HIL_SHUFFLE(x, y, LongRegister, 13, 0, 6, 14, 0, 7, 15, 0);
    _mm512_storeu_pd(to, (__m512d)HIL_SHUFFLE(a, z, LongRegister, 0, 1, 8, 3, 4, 9, 6, 7));
    _mm512_storeu_pd(to + 8, (__m512d)HIL_SHUFFLE(b, z, LongRegister, 10, 1, 2, 11, 4, 5, 12, 7));
    _mm512_storeu_pd(to + 16, (__m512d)HIL_SHUFFLE(c, z, LongRegister, 0, 13, 2, 3, 14, 5, 6, 15));
#else
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        double *r = to + 3 * i * (kRegisterBytes / 8);
        for (int k = 0; k < kRegisterBytes / 8; ++k) {
            r[3 * k] = v.x.r[i][k], r[3 * k + 1] = v.y.r[i][k], r[3 * k + 2] = v.z.r[i][k];
        }
    }
#endif
}

// Up to eight rows; lanes beyond `count` repeat the last one and are not written.
HIL_INLINE Vec<D> load_rows(const double *from, int count) {
    if (count == D::kCount) return load_rows(from);
    double some[3 * D::kCount];
    for (int i = 0; i < D::kCount; ++i)
        for (int a = 0; a < 3; ++a) some[3 * i + a] = from[3 * (i < count ? i : count - 1) + a];
    return load_rows(some);
}
HIL_INLINE void store_rows(double *to, const Vec<D> &v, int count) {
    if (count == D::kCount) return store_rows(to, v);
    double some[3 * D::kCount];
    store_rows(some, v);
    for (int i = 0; i < 3 * count; ++i) to[i] = some[i];
}

}  // namespace hil::sim::frame::HIL_ISA
