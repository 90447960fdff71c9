// Four or eight doubles at once, for files that are compiled once per instruction set (frame/lanes.hpp says what binds
// them): one register of AVX for four, two of SSE2 or NEON. Eight keep twice as many operations in flight. + - * / and
// sqrt round the same everywhere, so results have the same bits.
#pragma once

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#ifndef HIL_ISA
#error "HIL_ISA, the namespace of this instruction set, must be defined: CMakeLists.txt does so"
#endif

#define HIL_QUAD inline __attribute__((always_inline))
#define HIL_QUAD_PARTS _Pragma("GCC unroll 4") for (int k = 0; k < N; ++k)

namespace hil::sim::HIL_ISA {

#if defined(__AVX__)
constexpr int kQuadBytes = 32;
#else
constexpr int kQuadBytes = 16;
#endif
constexpr int kQuadParts = 32 / kQuadBytes;

typedef double QuadRegister __attribute__((vector_size(kQuadBytes)));
typedef double QuadMemory __attribute__((vector_size(kQuadBytes), aligned(8), may_alias));

// N registers.
template <int N>
struct Quads {
    QuadRegister r[N];
};

template <int N>
HIL_QUAD Quads<N> splat(double x) {
    Quads<N> q;
    HIL_QUAD_PARTS q.r[k] = x - QuadRegister{};
    return q;
}
template <int N>
HIL_QUAD Quads<N> load(const double *from) {
    Quads<N> q;
    HIL_QUAD_PARTS q.r[k] = *reinterpret_cast<const QuadMemory *>(from + k * (kQuadBytes / 8));
    return q;
}
template <int N>
HIL_QUAD void store(double *to, const Quads<N> &q) {
    HIL_QUAD_PARTS *reinterpret_cast<QuadMemory *>(to + k * (kQuadBytes / 8)) = q.r[k];
}
#define HIL_QUAD_BINARY(op)                                                    \
    template <int N>                                                           \
    HIL_QUAD Quads<N> operator op(const Quads<N> &a, const Quads<N> &b) {      \
        Quads<N> q;                                                            \
        HIL_QUAD_PARTS q.r[k] = a.r[k] op b.r[k];                              \
        return q;                                                              \
    }
HIL_QUAD_BINARY(+)
HIL_QUAD_BINARY(-)
HIL_QUAD_BINARY(*)
HIL_QUAD_BINARY(/)
#undef HIL_QUAD_BINARY
template <int N>
HIL_QUAD Quads<N> operator*(double x, const Quads<N> &a) { return splat<N>(x) * a; }
template <int N>
HIL_QUAD Quads<N> sqrt(const Quads<N> &a) {
    Quads<N> q;
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
template <int N>
HIL_QUAD Quads<N> positive(const Quads<N> &a) {
    Quads<N> q;
    HIL_QUAD_PARTS for (int j = 0; j < kQuadBytes / 8; ++j) q.r[k][j] = a.r[k][j] > 0.0 ? a.r[k][j] : 0.0;
    return q;
}
// True if a > b in any lane.
template <int N>
HIL_QUAD bool any_above(const Quads<N> &a, const Quads<N> &b) {
    bool any = false;
    HIL_QUAD_PARTS for (int j = 0; j < kQuadBytes / 8; ++j) any = any | (a.r[k][j] > b.r[k][j]);
    return any;
}

}  // namespace hil::sim::HIL_ISA
