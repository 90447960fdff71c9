// Four doubles at once, for files that are compiled once per instruction set (frame/lanes.hpp says what binds them): one
// register of AVX, two of SSE2 or NEON. + - * / and sqrt round the same everywhere, so results have the same bits.
#pragma once

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#ifndef HIL_ISA
#error "HIL_ISA, the namespace of this instruction set, must be defined: CMakeLists.txt does so"
#endif

#define HIL_QUAD inline __attribute__((always_inline))
#define HIL_QUAD_PARTS _Pragma("GCC unroll 2") for (int k = 0; k < kQuadParts; ++k)

namespace hil::sim::HIL_ISA {

#if defined(__AVX__)
constexpr int kQuadBytes = 32;
#else
constexpr int kQuadBytes = 16;
#endif
constexpr int kQuadParts = 32 / kQuadBytes;

typedef double QuadRegister __attribute__((vector_size(kQuadBytes)));
typedef double QuadMemory __attribute__((vector_size(kQuadBytes), aligned(8), may_alias));

struct Quad {
    QuadRegister r[kQuadParts];
};

HIL_QUAD Quad splat(double x) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = x - QuadRegister{};
    return q;
}
HIL_QUAD Quad load(const double *from) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = *reinterpret_cast<const QuadMemory *>(from + k * (kQuadBytes / 8));
    return q;
}
HIL_QUAD void store(double *to, const Quad &q) {
    HIL_QUAD_PARTS *reinterpret_cast<QuadMemory *>(to + k * (kQuadBytes / 8)) = q.r[k];
}
HIL_QUAD Quad operator+(const Quad &a, const Quad &b) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = a.r[k] + b.r[k];
    return q;
}
HIL_QUAD Quad operator-(const Quad &a, const Quad &b) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = a.r[k] - b.r[k];
    return q;
}
HIL_QUAD Quad operator*(const Quad &a, const Quad &b) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = a.r[k] * b.r[k];
    return q;
}
HIL_QUAD Quad operator/(const Quad &a, const Quad &b) {
    Quad q;
    HIL_QUAD_PARTS q.r[k] = a.r[k] / b.r[k];
    return q;
}
HIL_QUAD Quad operator*(double x, const Quad &a) { return splat(x) * a; }
HIL_QUAD Quad sqrt(const Quad &a) {
    Quad q;
    HIL_QUAD_PARTS {
#if defined(__AVX__)
        q.r[k] = (QuadRegister)_mm256_sqrt_pd((__m256d)a.r[k]);
#elif defined(__SSE2__)
        q.r[k] = (QuadRegister)_mm_sqrt_pd((__m128d)a.r[k]);
#else
        for (int j = 0; j < kQuadBytes / 8; ++j) q.r[k][j] = __builtin_sqrt(a.r[k][j]);
#endif
    }
    return q;
}
// max(a, 0)
HIL_QUAD Quad positive(const Quad &a) {
    Quad q;
    HIL_QUAD_PARTS for (int j = 0; j < kQuadBytes / 8; ++j) q.r[k][j] = a.r[k][j] > 0.0 ? a.r[k][j] : 0.0;
    return q;
}
// True if a > b in any lane.
HIL_QUAD bool any_above(const Quad &a, const Quad &b) {
    bool any = false;
    HIL_QUAD_PARTS for (int j = 0; j < kQuadBytes / 8; ++j) any = any | (a.r[k][j] > b.r[k][j]);
    return any;
}

}  // namespace hil::sim::HIL_ISA
