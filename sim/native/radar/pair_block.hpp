// A block of echoes prepared for grids of two terms in single precision. For use in *.isa.cpp only.
//
// Phases are computed and reduced to [-1/2, 1/2] in double: at 1e5 m they are 4e7 cycles, which double resolves to 1e-8.
// The rest is in single precision, 2e-7 of an echo; kSingleRounding of synthesis_plan.cpp allows fifty times that.
#pragma once

#include "echo_lanes.hpp"
#include "spread_kernel.hpp"
#include "speed_nodes.hpp"

namespace hil::sim::radar::HIL_ISA {

struct alignas(64) PairBlock {
    float phase[kGroup][kBlock];           // of each receiver, cycles
    float gain_re[kBlock], gain_im[kBlock];  // A H, times the grid's scale
    float speed[kBlock];                   // [-1, 1] over the panel
    float offset[2][kBlock];               // across chirps, across samples: [-1, 1] between two points of the grid
    float tap[2][kMaxSingleWidth][kBlock];
    float term[kMaxNodes + 1][kBlock];     // L_k of each echo's speed; the last one is zero and pads a cell
    float weight[kBlock][2 * kGroup];      // real parts of the receivers, imaginary ones
    std::int32_t start[2][kBlock];         // first row, first column
};

// First grid point under the kernel, and the frequency's offset between two points.
HIL_INLINE void place(const D &frequency, int width, int size, std::int32_t *start, float *offset) {
    const D left = frequency * (double)size - 0.5 * width;
    const D shifted = left + 0.5 + kNearest;  // rounded up to a grid point; exactly on one, either neighbour is correct
    store_single(offset, ((shifted - kNearest) - left) * 2.0 - 1.0);
    alignas(64) std::int64_t whole[L::kCount];
    store(whole, as<L>(shifted) & splat<L>((std::int64_t)size - 1));
    for (int i = 0; i < L::kCount; ++i) start[i] = (std::int32_t)whole[i];
}

// Fills all values of echoes index[0 .. count) that are computed in double. Rows from count on, up to a whole pack,
// repeat the last echo.
HIL_INLINE void fill_phases(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, int count,
                            int group, const SpeedNodes &nodes, double scale, int width, int rows, int columns,
                            PairBlock &block) {
    const int receivers = model.in_group[group];
    const double chirp_offset = model.chirp_offset + model.group_offset[group];
    const double shrink = nodes.half_span > 0.0 ? 1.0 / nodes.half_span : 0.0;
    for (int first = 0; first < count; first += D::kCount) {
        alignas(64) std::int32_t some[D::kCount];
        const std::int32_t *echo = index + first;
        if (first + D::kCount > count) {
            for (int lane = 0; lane < D::kCount; ++lane) some[lane] = index[first + lane < count ? first + lane : count - 1];
            echo = some;
        }
        const D r = picked<1>(echoes.range_m, echo), v = picked<1>(echoes.speed_mps, echo);
        const D alpha = v * (r * model.chirp_per_mps_m + model.chirp_per_mps.hi);
        const D beta = r * model.sample_per_m.hi + v * (r * model.sample_per_mps_m + model.sample_per_mps);
        D phase = r * (r * model.cycles_per_m2 + model.cycles_per_m.hi) + alpha * chirp_offset +
                  beta * model.sample_offset;
        place(alpha - nearest(alpha), width, rows, block.start[0] + first, block.offset[0] + first);
        place(beta - nearest(beta), width, columns, block.start[1] + first, block.offset[1] + first);
        store_single(block.speed + first, (v - nodes.middle) * shrink);
        D re, im;
        filtered(model, r * model.beat_hz_per_m, picked<1>(echoes.amplitude, echo) * scale, re, im);
        store_single(block.gain_re + first, re);
        store_single(block.gain_im + first, im);
        const D way[3] = {picked<3>(echoes.direction_R, echo), picked<3>(echoes.direction_R + 1, echo),
                          picked<3>(echoes.direction_R + 2, echo)};
        if (echoes.out_direction_R != nullptr) phase = phase - turned_out(model, echoes, echo, group, way);
        for (int k = 0; k < receivers; ++k) {
            const double *p = model.receiver[group * kGroup + k];
            const D turns = phase - (way[0] * p[0] + way[1] * p[1] + way[2] * p[2]);
            store_single(block.phase[k] + first, turns - nearest(turns));
        }
    }
}

// Cosine and sine of 2 pi x for |x| <= 1: error below 1.5e-7. Minimax polynomials of x on [-1/8, 1/8].
HIL_INLINE void turn(const F &x, F &cosine, F &sine) {
    constexpr float kNearestSingle = 12582912.0f;  // as kNearest
    const F shifted = x * 4.0f + kNearestSingle;
    const I quarter = as<I>(shifted);
    const F t = x - (shifted - kNearestSingle) * 0.25f;
    const F z = t * t;
    const F s = t * (((z * -75.3893585f + 81.5922699f) * z + -41.3416595f) * z + 6.28318548f);
    const F c = ((z * -83.6602325f + 64.9231262f) * z + -19.7391663f) * z + 1.0f;
    const I one = splat<I>(1), two = splat<I>(2);
    const I odd = (quarter & one) == one;
    const I sine_sign = shift_left(quarter & two, 30);
    const I cosine_sign = shift_left((quarter + one) & two, 30);
    cosine = as<F>(as<I>(select(odd, s, c)) ^ cosine_sign);
    sine = as<F>(as<I>(select(odd, c, s)) ^ sine_sign);
}

HIL_INLINE void transpose(Four &a, Four &b, Four &c, Four &d) {
    typedef std::int32_t Order __attribute__((vector_size(16)));
    const Four ab = HIL_SHUFFLE(a, b, Order, 0, 4, 1, 5), ab_high = HIL_SHUFFLE(a, b, Order, 2, 6, 3, 7);
    const Four cd = HIL_SHUFFLE(c, d, Order, 0, 4, 1, 5), cd_high = HIL_SHUFFLE(c, d, Order, 2, 6, 3, 7);
    a = HIL_SHUFFLE(ab, cd, Order, 0, 1, 4, 5);
    b = HIL_SHUFFLE(ab, cd, Order, 2, 3, 6, 7);
    c = HIL_SHUFFLE(ab_high, cd_high, Order, 0, 1, 4, 5);
    d = HIL_SHUFFLE(ab_high, cd_high, Order, 2, 3, 6, 7);
}

static_assert(kGroup == 4);
// Writes each echo's complex weight at each receiver.
HIL_INLINE void fill_weights(int count, int receivers, PairBlock &block) {
    alignas(64) float part[2 * kGroup][kBlock];
    for (int first = 0; first < count; first += F::kCount) {
        const F re = load<F>(block.gain_re + first), im = load<F>(block.gain_im + first);
        for (int k = 0; k < receivers; ++k) {
            F c, s;
            turn(load<F>(block.phase[k] + first), c, s);
            store(part[k] + first, re * c - im * s);
            store(part[kGroup + k] + first, re * s + im * c);
        }
        for (int k = receivers; k < kGroup; ++k) {
            store(part[k] + first, splat<F>(0.0f));
            store(part[kGroup + k] + first, splat<F>(0.0f));
        }
    }
    for (int first = 0; first < count; first += 4) {
#pragma GCC unroll 2
        for (int half = 0; half < 2 * kGroup; half += kGroup) {
            Four a, b, c, d;
            __builtin_memcpy(&a, part[half] + first, sizeof a);
            __builtin_memcpy(&b, part[half + 1] + first, sizeof b);
            __builtin_memcpy(&c, part[half + 2] + first, sizeof c);
            __builtin_memcpy(&d, part[half + 3] + first, sizeof d);
            transpose(a, b, c, d);
            __builtin_memcpy(block.weight[first] + half, &a, sizeof a);
            __builtin_memcpy(block.weight[first + 1] + half, &b, sizeof b);
            __builtin_memcpy(block.weight[first + 2] + half, &c, sizeof c);
            __builtin_memcpy(block.weight[first + 3] + half, &d, sizeof d);
        }
    }
}

template <int kWidth>
HIL_INLINE void fill_taps(const SpreadKernel &kernel, const float *offset, int count, float (*tap)[kBlock]) {
    for (int first = 0; first < count; first += F::kCount) {
        const F t = load<F>(offset + first), t2 = t * t;
#pragma GCC unroll 8
        for (int i = 0; i < (kWidth + 1) / 2; ++i) {
            const double *c = kernel.coefficient[i];
            constexpr int kEven = kWidth / 2 * 2, kOdd = (kWidth - 1) / 2 * 2 + 1;
            F even = splat<F>((float)c[kEven]), odd = splat<F>((float)c[kOdd]);
#pragma GCC unroll 8
            for (int d = kEven - 2; d >= 0; d -= 2) even = even * t2 + (float)c[d];
#pragma GCC unroll 8
            for (int d = kOdd - 2; d >= 1; d -= 2) odd = odd * t2 + (float)c[d];
            odd = odd * t;
            store(tap[i] + first, even + odd);
            if (i != kWidth - 1 - i) store(tap[kWidth - 1 - i] + first, even - odd);
        }
    }
}

HIL_INLINE void fill_terms(const SpeedNodes &nodes, int count, PairBlock &block) {
    for (int first = 0; first < count; first += F::kCount) {
        const F s = load<F>(block.speed + first);
        F before = splat<F>(1.0f);
        for (int k = 0; k < nodes.count; ++k) {
            store(block.term[k] + first, before * (float)nodes.scale[k]);
            before = before * (s - (float)nodes.node[k]);
        }
        F after = splat<F>(1.0f);
        for (int k = nodes.count - 1; k >= 0; --k) {
            store(block.term[k] + first, load<F>(block.term[k] + first) * after);
            after = after * (s - (float)nodes.node[k]);
        }
        store(block.term[nodes.count] + first, splat<F>(0.0f));
    }
}

}  // namespace hil::sim::radar::HIL_ISA
