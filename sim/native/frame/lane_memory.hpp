// Loads, stores, gathers, table look-ups and rows of pixels for packs of lanes. For use in *.isa.cpp only.
#pragma once

#include "lanes.hpp"

namespace hil::sim::frame::HIL_ISA {

template <class V>
HIL_INLINE V load(const ScalarOf<V> *p) {
    // Register by register: GCC 12 may copy a whole pack through memory.
    V v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) __builtin_memcpy(&v.r[i], p + i * (V::kCount / kParts), sizeof v.r[i]);
    return v;
}
template <class T>
HIL_INLINE void store(T *p, const Pack<T> &a) {
    HIL_UNROLL for (int i = 0; i < kParts; ++i) __builtin_memcpy(p + i * (a.kCount / kParts), &a.r[i], sizeof a.r[i]);
}

// from[index], lane by lane; every index must be in range.
HIL_INLINE I gather(const std::int32_t *from, const I &index) {
    I v;
#if defined(__AVX512F__)
    v.r[0] = (IntRegister)_mm512_i32gather_epi32((__m512i)index.r[0], from, 4);
#else
    std::int32_t at[16], found[16];
    store(at, index);
    for (int i = 0; i < 16; ++i) found[i] = from[at[i]];
    v = load<I>(found);
#endif
    return v;
}

// The same for a table of 16.
HIL_INLINE I look_up(const std::int32_t *table, const I &index) {
#if defined(__AVX512F__)
    I v;
    v.r[0] = (IntRegister)_mm512_permutexvar_epi32((__m512i)index.r[0], _mm512_loadu_si512(table));
    return v;
#else
    return gather(table, index);
#endif
}

HIL_INLINE F gather(const float *from, const I &index) {
    F v;
#if defined(__AVX512F__)
    v.r[0] = (FloatRegister)_mm512_i32gather_ps((__m512i)index.r[0], from, 4);
#else
    std::int32_t at[16];
    float found[16];
    store(at, index);
    for (int i = 0; i < 16; ++i) found[i] = from[at[i]];
    v = load<F>(found);
#endif
    return v;
}

constexpr std::int32_t kLaneBit[16] = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};

// Mask of the lanes whose bit is set: the inverse of `bits`.
HIL_INLINE I lanes_of(unsigned set) { return (splat<I>((std::int32_t)set) & load<I>(kLaneBit)) != splat<I>(0); }

// Stores four rows of four pixels, rows `stride` elements apart.
template <class T>
HIL_INLINE void store_rows(T *to, long stride, const Pack<T> &a) {
    HIL_UNROLL for (int r = 0; r < 4; ++r) __builtin_memcpy(to + r * stride, (const T *)&a + 4 * r, 16);
}

// Stores the lowest three bytes of each lane: four rows of four pixels, 12 bytes a row, rows `stride` bytes apart.
HIL_INLINE void store_triples(std::uint8_t *to, long stride, const I &a) {
#if defined(__AVX512F__)
    const __m512i order = _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1));
    const __m512i packed = _mm512_shuffle_epi8((__m512i)a.r[0], order);
    const __m128i rows[4] = {_mm512_extracti32x4_epi32(packed, 0), _mm512_extracti32x4_epi32(packed, 1),
                             _mm512_extracti32x4_epi32(packed, 2), _mm512_extracti32x4_epi32(packed, 3)};
    for (int r = 0; r < 4; ++r) {
        const std::int32_t last = _mm_extract_epi32(rows[r], 2);
        _mm_storel_epi64((__m128i *)(to + r * stride), rows[r]);
        __builtin_memcpy(to + r * stride + 8, &last, 4);
    }
#else
    std::uint32_t lanes[16];
    __builtin_memcpy(lanes, &a, 64);
    for (int r = 0; r < 4; ++r) {
        const std::uint32_t *p = lanes + 4 * r;
        std::uint8_t *row = to + r * stride;
        for (int c = 0; c < 4; ++c) {
            row[3 * c] = (std::uint8_t)p[c];
            row[3 * c + 1] = (std::uint8_t)(p[c] >> 8);
            row[3 * c + 2] = (std::uint8_t)(p[c] >> 16);
        }
    }
#endif
}

// Stores four rows of four pixels as x y z x y z ..., rows `stride` floats apart.
HIL_INLINE void store_triples(float *to, long stride, const Vec<F> &v) {
    typedef float Quad __attribute__((vector_size(16)));
    typedef std::int32_t Order __attribute__((vector_size(16)));
    HIL_UNROLL for (int r = 0; r < 4; ++r) {
        Quad x, y, z;
        __builtin_memcpy(&x, (const float *)&v.x + 4 * r, 16);
        __builtin_memcpy(&y, (const float *)&v.y + 4 * r, 16);
        __builtin_memcpy(&z, (const float *)&v.z + 4 * r, 16);
        const Quad low = HIL_SHUFFLE(x, y, Order, 0, 4, 1, 5), high = HIL_SHUFFLE(x, y, Order, 2, 6, 3, 7);
        const Quad middle = HIL_SHUFFLE(low, high, Order, 3, 3, 4, 5);
        // Three separate stores: assembled in memory first, a row would wait for store forwarding.
        const Quad a = HIL_SHUFFLE(low, z, Order, 0, 1, 4, 2), b = HIL_SHUFFLE(middle, z, Order, 0, 5, 2, 3),
                   c = HIL_SHUFFLE(high, z, Order, 6, 2, 3, 7);
        __builtin_memcpy(to + r * stride, &a, 16);
        __builtin_memcpy(to + r * stride + 4, &b, 16);
        __builtin_memcpy(to + r * stride + 8, &c, 16);
    }
}

}  // namespace hil::sim::frame::HIL_ISA
