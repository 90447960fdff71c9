// SIMD lanes: 16 floats (F) or 8 doubles (D), 64 bytes either way, on the compilers' vector extensions.
//
// One source for every instruction set: 64 bytes are one AVX-512 register, two of AVX2, four of SSE2 or NEON. A pack of
// lanes is an array of registers, because compilers split wider vectors lane by lane. The operations are + - * / sqrt,
// comparisons and bit operations, which IEEE 754 rounds the same everywhere, and the build forbids fusing them: results
// have the same bits for every register width.
//
// Files named *.isa.cpp are compiled once per instruction set, each into the namespace HIL_ISA. They and this header
// may use only functions of the standard library that are always inlined: of others the linker would keep one copy
// for all sets, possibly one compiled for a newer CPU.
#pragma once

#include <cstdint>

#if defined(__AVX2__) || defined(__SSE2__)
#include <immintrin.h>
#endif

#ifndef HIL_ISA
#error "HIL_ISA, the namespace of this instruction set, must be defined: CMakeLists.txt does so"
#endif

#define HIL_INLINE inline __attribute__((always_inline))
#define HIL_NOINLINE __attribute__((noinline))
// Vector of elements of two vectors, given by their numbers; `Index` is the integer vector type that GCC needs.
#if defined(__clang__)
#define HIL_SHUFFLE(a, b, Index, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define HIL_SHUFFLE(a, b, Index, ...) __builtin_shuffle(a, b, (Index){__VA_ARGS__})
#endif
// A pack has at most four registers: loops over them are unrolled completely.
#define HIL_UNROLL _Pragma("GCC unroll 4")

namespace hil::sim::frame::HIL_ISA {

#if defined(__AVX512F__)
constexpr int kRegisterBytes = 64;
#elif defined(__AVX2__)
constexpr int kRegisterBytes = 32;
#else
constexpr int kRegisterBytes = 16;
#endif
constexpr int kParts = 64 / kRegisterBytes;

typedef float FloatRegister __attribute__((vector_size(kRegisterBytes)));
typedef double DoubleRegister __attribute__((vector_size(kRegisterBytes)));
typedef std::int32_t IntRegister __attribute__((vector_size(kRegisterBytes)));
typedef std::int64_t LongRegister __attribute__((vector_size(kRegisterBytes)));

template <class T>
struct RegisterOf;
template <>
struct RegisterOf<float> {
    using Type = FloatRegister;
    using Mask = std::int32_t;
};
template <>
struct RegisterOf<double> {
    using Type = DoubleRegister;
    using Mask = std::int64_t;
};
template <>
struct RegisterOf<std::int32_t> {
    using Type = IntRegister;
    using Mask = std::int32_t;
};
template <>
struct RegisterOf<std::int64_t> {
    using Type = LongRegister;
    using Mask = std::int64_t;
};

// 64 bytes of T. A mask is a pack of integers of the same width, all ones or all zero in each lane.
template <class T>
struct Pack {
    using Register = typename RegisterOf<T>::Type;
    using Mask = Pack<typename RegisterOf<T>::Mask>;
    static constexpr int kCount = 64 / (int)sizeof(T);
    Register r[kParts];
};

using F = Pack<float>;
using D = Pack<double>;
using I = Pack<std::int32_t>;
using L = Pack<std::int64_t>;
constexpr int kLanes = D::kCount;  // lanes in double

template <class V>
struct ScalarIn;
template <class T>
struct ScalarIn<Pack<T>> {
    using Type = T;
};
template <class V>
using ScalarOf = typename ScalarIn<V>::Type;
template <class V>
using MaskOf = typename V::Mask;

template <class V>
struct LaneTraits;
template <>
struct LaneTraits<F> {
    static constexpr float kTiny = 1e-20f;   // smaller direction components are replaced by this
    static constexpr float kTiny2 = 1e-30f;  // the same for squares
    static constexpr float kInf = __builtin_inff();
};
template <>
struct LaneTraits<D> {
    static constexpr double kTiny = 1e-100;
    static constexpr double kTiny2 = 1e-180;
    static constexpr double kInf = __builtin_inf();
};

template <class V>
HIL_INLINE V splat(ScalarOf<V> x) {
    V v;
    // x - 0 is x for every x and costs nothing; x + 0 changes -0, so the compiler could not remove it.
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = x - (typename V::Register){};
    return v;
}

#define HIL_LANES_BINARY(op)                                               \
    template <class T>                                                     \
    HIL_INLINE Pack<T> operator op(const Pack<T> &a, const Pack<T> &b) {   \
        Pack<T> v;                                                         \
        HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] op b.r[i];        \
        return v;                                                          \
    }                                                                      \
    template <class T>                                                     \
    HIL_INLINE Pack<T> operator op(const Pack<T> &a, T b) {                \
        return a op splat<Pack<T>>(b);                                     \
    }                                                                      \
    template <class T>                                                     \
    HIL_INLINE Pack<T> operator op(T a, const Pack<T> &b) {                \
        return splat<Pack<T>>(a) op b;                                     \
    }
HIL_LANES_BINARY(+)
HIL_LANES_BINARY(-)
HIL_LANES_BINARY(*)
HIL_LANES_BINARY(/)
HIL_LANES_BINARY(&)
HIL_LANES_BINARY(|)
HIL_LANES_BINARY(^)
#undef HIL_LANES_BINARY

#define HIL_LANES_COMPARE(op)                                                          \
    template <class T>                                                                 \
    HIL_INLINE typename Pack<T>::Mask operator op(const Pack<T> &a, const Pack<T> &b) { \
        typename Pack<T>::Mask v;                                                      \
        HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] op b.r[i];                    \
        return v;                                                                      \
    }
HIL_LANES_COMPARE(<)
HIL_LANES_COMPARE(<=)
HIL_LANES_COMPARE(>)
HIL_LANES_COMPARE(>=)
HIL_LANES_COMPARE(==)
HIL_LANES_COMPARE(!=)
#undef HIL_LANES_COMPARE

template <class T>
HIL_INLINE Pack<T> operator-(const Pack<T> &a) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = -a.r[i];
    return v;
}
template <class T>
HIL_INLINE Pack<T> operator~(const Pack<T> &a) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = ~a.r[i];
    return v;
}
template <class T>
HIL_INLINE Pack<T> &operator&=(Pack<T> &a, const Pack<T> &b) {
    a = a & b;
    return a;
}
template <class T>
HIL_INLINE Pack<T> &operator|=(Pack<T> &a, const Pack<T> &b) {
    a = a | b;
    return a;
}

// In each lane: a if m is all ones, b if m is zero.
template <class T>
HIL_INLINE Pack<T> select(const typename Pack<T>::Mask &m, const Pack<T> &a, const Pack<T> &b) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
        v.r[i] = m.r[i] ? a.r[i] : b.r[i];
#elif defined(__AVX2__)
        v.r[i] = (typename Pack<T>::Register)_mm256_blendv_ps((__m256)b.r[i], (__m256)a.r[i], (__m256)m.r[i]);
#else  // SSE2 has no comparison of 64-bit integers
        using Bits = typename Pack<T>::Mask::Register;
        v.r[i] = (typename Pack<T>::Register)((m.r[i] & (Bits)a.r[i]) | (~m.r[i] & (Bits)b.r[i]));
#endif
    }
    return v;
}

// If either operand is NaN, the result is the second one, as on x86.
template <class T>
HIL_INLINE Pack<T> min(const Pack<T> &a, const Pack<T> &b) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] < b.r[i] ? a.r[i] : b.r[i];
    return v;
}
template <class T>
HIL_INLINE Pack<T> max(const Pack<T> &a, const Pack<T> &b) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] > b.r[i] ? a.r[i] : b.r[i];
    return v;
}

// The same bits read as another type.
template <class To, class From>
HIL_INLINE To as(const From &a) {
    To v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = (typename To::Register)a.r[i];
    return v;
}

HIL_INLINE F abs(const F &a) { return as<F>(as<I>(a) & (std::int32_t)0x7fffffff); }
HIL_INLINE D abs(const D &a) { return as<D>(as<L>(a) & (std::int64_t)0x7fffffffffffffffLL); }

// a with the sign of s.
HIL_INLINE F copysign(const F &a, const F &s) {
    return as<F>((as<I>(a) & (std::int32_t)0x7fffffff) | (as<I>(s) & (std::int32_t)0x80000000));
}
HIL_INLINE D copysign(const D &a, const D &s) {
    return as<D>((as<L>(a) & (std::int64_t)0x7fffffffffffffffLL) |
                 (as<L>(s) & (std::int64_t)0x8000000000000000ULL));
}

// Rounds towards zero; the result is undefined for values outside the range of int32.
HIL_INLINE I truncate(const F &a) {
    I v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = __builtin_convertvector(a.r[i], IntRegister);
    return v;
}
HIL_INLINE F to_float(const I &a) {
    F v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = __builtin_convertvector(a.r[i], FloatRegister);
    return v;
}
// For values in the range of int32.
HIL_INLINE F floor(const F &a) {
#if defined(__AVX512F__)
    F v;
    v.r[0] = (FloatRegister)_mm512_roundscale_ps((__m512)a.r[0], _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
    return v;
#else
    const F t = to_float(truncate(a));
    F one;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) one.r[i] = (FloatRegister){} + 1.0f;
    const I above = t > a;
    F v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = t.r[i] - (FloatRegister)(above.r[i] & (IntRegister)one.r[i]);
    return v;
#endif
}
template <class T>
HIL_INLINE Pack<T> shift_right(const Pack<T> &a, int n) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] >> n;
    return v;
}
HIL_INLINE I shift_right(const I &a, const I &n) {
    I v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] >> n.r[i];
    return v;
}
HIL_INLINE I shift_left(const I &a, const I &n) {
    I v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] << n.r[i];
    return v;
}
template <class T>
HIL_INLINE Pack<T> shift_left(const Pack<T> &a, int n) {
    Pack<T> v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) v.r[i] = a.r[i] << n;
    return v;
}

HIL_INLINE F sqrt(const F &a) {
    F v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
        v.r[i] = (FloatRegister)_mm512_sqrt_ps((__m512)a.r[i]);
#elif defined(__AVX2__)
        v.r[i] = (FloatRegister)_mm256_sqrt_ps((__m256)a.r[i]);
#elif defined(__SSE2__)
        v.r[i] = (FloatRegister)_mm_sqrt_ps((__m128)a.r[i]);
#else
        for (int k = 0; k < kRegisterBytes / 4; ++k) v.r[i][k] = __builtin_sqrtf(a.r[i][k]);
#endif
    }
    return v;
}
HIL_INLINE D sqrt(const D &a) {
    D v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
        v.r[i] = (DoubleRegister)_mm512_sqrt_pd((__m512d)a.r[i]);
#elif defined(__AVX2__)
        v.r[i] = (DoubleRegister)_mm256_sqrt_pd((__m256d)a.r[i]);
#elif defined(__SSE2__)
        v.r[i] = (DoubleRegister)_mm_sqrt_pd((__m128d)a.r[i]);
#else
        for (int k = 0; k < kRegisterBytes / 8; ++k) v.r[i][k] = __builtin_sqrt(a.r[i][k]);
#endif
    }
    return v;
}

// Bit mask of the lanes, lane 0 in the lowest bit.
HIL_INLINE unsigned bits(const I &m) {
    unsigned found = 0;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
        const __mmask16 mask = _mm512_cmplt_epi32_mask((__m512i)m.r[i], _mm512_setzero_si512());
        // Not a conversion: GCC 12 can spill the mask as two bytes and read it back as four (tests/fuzz_frame).
        __asm__("kmovw %1, %0" : "=r"(found) : "k"(mask));
#elif defined(__AVX2__)
        found |= (unsigned)_mm256_movemask_ps((__m256)m.r[i]) << (8 * i);
#elif defined(__SSE2__)
        found |= (unsigned)_mm_movemask_ps((__m128)m.r[i]) << (4 * i);
#else
        for (int k = 0; k < 4; ++k) found |= (m.r[i][k] < 0 ? 1u : 0u) << (4 * i + k);
#endif
    }
    return found;
}
HIL_INLINE unsigned bits(const L &m) {
    unsigned found = 0;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
        const __mmask8 mask = _mm512_cmplt_epi64_mask((__m512i)m.r[i], _mm512_setzero_si512());
        __asm__("kmovb %1, %0" : "=r"(found) : "k"(mask));
#elif defined(__AVX2__)
        found |= (unsigned)_mm256_movemask_pd((__m256d)m.r[i]) << (4 * i);
#elif defined(__SSE2__)
        found |= (unsigned)_mm_movemask_pd((__m128d)m.r[i]) << (2 * i);
#else
        for (int k = 0; k < 2; ++k) found |= (m.r[i][k] < 0 ? 1u : 0u) << (2 * i + k);
#endif
    }
    return found;
}
template <class M>
HIL_INLINE bool any(const M &m) {
    return bits(m) != 0;
}

// Greatest lane; undefined if a lane is NaN.
HIL_INLINE float greatest(const F &a) {
#if defined(__AVX512F__)
    return _mm512_reduce_max_ps((__m512)a.r[0]);
#else
    FloatRegister m = a.r[0];
    for (int i = 1; i < kParts; ++i) m = m > a.r[i] ? m : a.r[i];
    float found = m[0];
    for (int k = 1; k < kRegisterBytes / 4; ++k) found = found > m[k] ? found : m[k];
    return found;
#endif
}

template <class V>
struct Vec {
    V x, y, z;
};
template <class V>
HIL_INLINE V dot(const Vec<V> &a, const Vec<V> &b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

}  // namespace hil::sim::frame::HIL_ISA
