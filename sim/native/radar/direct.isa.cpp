// Weights of echoes and the direct sum (synthesis_kernels.hpp).
#include "echo_lanes.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

double sum_of_lanes(const D &x) {
    alignas(64) double lane[D::kCount];
    store(lane, x);
    double sum = 0.0;
    for (int i = 0; i < D::kCount; ++i) sum = sum + lane[i];
    return sum;
}

D eight(const double *from, std::size_t count, double beyond) {
    alignas(64) double lane[D::kCount];
    for (std::size_t i = 0; i < D::kCount; ++i) lane[i] = i < count ? from[i] : beyond;
    return load<D>(lane);
}

}  // namespace

Weighing weigh(const EchoModel &model, const EchoView &echoes, double *weight_squared) {
    const D inf = splat<D>(LaneTraits<D>::kInf);
    D sum = splat<D>(0.0), least = inf, greatest = -inf;
    L wrong = splat<L>(0);
    for (std::size_t first = 0; first < echoes.count; first += D::kCount) {
        const std::size_t rest = echoes.count - first;
        const bool whole = rest >= D::kCount;
        const D r = whole ? load<D>(echoes.range_m + first) : eight(echoes.range_m + first, rest, 0.0);
        const D v = whole ? load<D>(echoes.speed_mps + first) : eight(echoes.speed_mps + first, rest, 0.0);
        const D a = whole ? load<D>(echoes.amplitude + first) : eight(echoes.amplitude + first, rest, 0.0);
        // False for NaN.
        const L fine = (r >= splat<D>(0.0)) & (r <= splat<D>(kMaxRange)) & (abs(v) <= splat<D>(kMaxSpeed)) &
                       (a >= splat<D>(0.0)) & (a <= splat<D>(kMaxAmplitude));
        wrong |= ~fine;
        for (std::size_t part = 0; part < 3; ++part) {
            const std::size_t at = part * D::kCount;
            const std::size_t numbers = 3 * rest;
            if (at >= numbers) break;
            const double *from = echoes.direction_R + 3 * first + at;
            const D d = numbers - at >= D::kCount ? load<D>(from) : eight(from, numbers - at, 0.0);
            wrong |= ~(abs(d) <= splat<D>(1.0 + 1e-6));
            if (echoes.out_direction_R == nullptr) continue;
            const double *out = echoes.out_direction_R + 3 * first + at;
            const D o = numbers - at >= D::kCount ? load<D>(out) : eight(out, numbers - at, 0.0);
            wrong |= ~(abs(o) <= splat<D>(1.0 + 1e-6));
        }
        D re, im;
        filtered(model, r * model.beat_hz_per_m, a, re, im);
        const D square = select(a >= splat<D>(kMinAmplitude), re * re + im * im, splat<D>(0.0));
        const L some = square > splat<D>(0.0);
        sum = sum + square;
        least = min(least, select(some, v, inf));
        greatest = max(greatest, select(some, v, -inf));
        if (whole) {
            store(weight_squared + first, square);
        } else {
            alignas(64) double lane[D::kCount];
            store(lane, square);
            for (std::size_t i = 0; i < rest; ++i) weight_squared[first + i] = lane[i];
        }
    }
    Weighing found{sum_of_lanes(sum), LaneTraits<D>::kInf, -LaneTraits<D>::kInf, !any(wrong)};
    alignas(64) double low[D::kCount], high[D::kCount];
    store(low, least);
    store(high, greatest);
    for (int i = 0; i < D::kCount; ++i) {
        found.least_speed = low[i] < found.least_speed ? low[i] : found.least_speed;
        found.greatest_speed = high[i] > found.greatest_speed ? high[i] : found.greatest_speed;
    }
    return found;
}

std::size_t count_below(const double *x, std::size_t count, double limit) {
    D found = splat<D>(0.0);
    const D one = splat<D>(1.0), none = splat<D>(0.0);
    for (std::size_t first = 0; first < count; first += D::kCount) {
        const D value = count - first >= D::kCount ? load<D>(x + first) : eight(x + first, count - first, limit);
        found = found + select((value < splat<D>(limit)) & (value > none), one, none);
    }
    return (std::size_t)sum_of_lanes(found);
}

namespace {

// Adds one block of echoes to every sample. Eight samples stay in registers during the loop over the echoes.
template <int kReceivers, bool kComplex>
void add_block(const EchoModel &model, const EchoBlock &block, int count, double offset, double *sum,
               double *quadrature) {
    const int wide = (model.samples + D::kCount - 1) / D::kCount * D::kCount;
    const double half = model.sample_offset;
    alignas(64) double at_middle[kBlock], per_sample[kBlock], per_sample2[kBlock], weight[kBlock][2 * kReceivers];
    for (int e = 0; e < count; ++e) {
        for (int k = 0; k < kReceivers; ++k) {
            weight[e][2 * k] = block.re[k][e];
            weight[e][2 * k + 1] = block.im[k][e];
        }
    }
    D lane_index;
    {
        alignas(64) double lane[D::kCount];
        for (int i = 0; i < D::kCount; ++i) lane[i] = i - model.middle_sample;
        lane_index = load<D>(lane);
    }
    for (int m = 0; m < model.chirps; ++m) {
        const double whole = m - model.middle_chirp, mu = whole + offset;
        for (int first = 0; first < count; first += D::kCount) {
            // At a given mu the phase is a quadratic function of the sample index.
            const Remainder g = remainder_at(model, load<D>(block.speed + first));
            const D mixed = g.mixed * mu;
            const D turns = load<D>(block.alpha + first) * whole;
            const D rest = mixed * half + g.sample * (half * half) + g.chirp * (mu * mu);
            const D both = (turns - nearest(turns)) + rest;
            store(at_middle + first, both - nearest(both));
            store(per_sample + first, load<D>(block.beta + first) + mixed + g.sample * (2.0 * half));
            store(per_sample2 + first, g.sample);
        }
        for (int n = 0; n < wide; n += D::kCount) {
            const D nu = lane_index + (double)n;
            D total[kReceivers], turned[kReceivers];
            for (int k = 0; k < kReceivers; ++k) total[k] = turned[k] = splat<D>(0.0);
            for (int e = 0; e < count; ++e) {
                const D phase = nu * (nu * per_sample2[e] + per_sample[e]) + at_middle[e];
                D c, s;
                turn(phase, c, s);
                for (int k = 0; k < kReceivers; ++k) {
                    total[k] = total[k] + (c * weight[e][2 * k] - s * weight[e][2 * k + 1]);
                    if constexpr (kComplex) turned[k] = turned[k] + (s * weight[e][2 * k] + c * weight[e][2 * k + 1]);
                }
            }
            for (int k = 0; k < kReceivers; ++k) {
                const long at = ((long)k * model.chirps + m) * wide + n;
                store(sum + at, load<D>(sum + at) + total[k]);
                if constexpr (kComplex) store(quadrature + at, load<D>(quadrature + at) + turned[k]);
            }
        }
    }
}

template <bool kComplex>
void add_group(const EchoModel &model, const EchoBlock &block, int count, int group, double *sum, double *quadrature) {
    const double offset = model.chirp_offset + model.group_offset[group];
    switch (model.in_group[group]) {
        case 1: add_block<1, kComplex>(model, block, count, offset, sum, quadrature); break;
        case 2: add_block<2, kComplex>(model, block, count, offset, sum, quadrature); break;
        case 3: add_block<3, kComplex>(model, block, count, offset, sum, quadrature); break;
        default: add_block<4, kComplex>(model, block, count, offset, sum, quadrature); break;
    }
}

}  // namespace

void direct(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count, int group,
            double *sum, double *quadrature) {
    EchoBlock block;
    for (std::size_t first = 0; first < count; first += kBlock) {
        const int now = count - first < kBlock ? (int)(count - first) : kBlock;
        fill_block(model, echoes, index + first, now, group, block);
        if (quadrature == nullptr) {
            add_group<false>(model, block, now, group, sum, nullptr);
        } else {
            add_group<true>(model, block, now, group, sum, quadrature);
        }
    }
}

}  // namespace hil::sim::radar::HIL_ISA
