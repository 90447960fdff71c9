// A block of echoes prepared for summing. For use in *.isa.cpp only.
#pragma once

#include "echo_model.hpp"
#include "turn.hpp"

namespace hil::sim::radar::HIL_ISA {

constexpr int kBlock = 64;

// Frequencies in cycles per chirp and per sample, reduced to [-1/2, 1/2]. The weight of receiver k is its amplitude and
// phase at the frame's middle indices: A H exp(2 pi i (phi_0 + alpha (chirp_offset + delta_p) + beta sample_offset - (t_p + r_k) d / lambda)).
struct alignas(64) EchoBlock {
    double alpha[kBlock], beta[kBlock], speed[kBlock];
    double re[kGroup][kBlock], im[kGroup][kBlock];
};

// x reduced to [-1/2, 1/2] by whole cycles.
HIL_INLINE D fraction(const Twofold<D> &x) { return (x.hi - nearest(x.hi)) + x.lo; }

HIL_INLINE Twofold<D> lanes_of(const Twofold<double> &x) { return {splat<D>(x.hi), splat<D>(x.lo)}; }

// Response of the receiver's filters at the beat frequency f, times the amplitude.
HIL_INLINE void filtered(const EchoModel &model, const D &f, const D &amplitude, D &re, D &im) {
    re = amplitude;
    im = splat<D>(0.0);
    if (model.hp_cutoff_hz > 0.0) {  // j f / (f_hp + j f) = f (f + j f_hp) / (f^2 + f_hp^2)
        const D scale = f / (f * f + model.hp_cutoff_hz * model.hp_cutoff_hz) * amplitude;
        re = scale * f;
        im = scale * model.hp_cutoff_hz;
    }
    if (model.aaf_period_s > 0.0) {  // 1 / (1 + j f / f_aaf)
        const D q = f * model.aaf_period_s;
        const D scale = 1.0 / (q * q + 1.0);
        const D was = re;
        re = (was + im * q) * scale;
        im = (im - was * q) * scale;
    }
}

// from[kStep * at[lane]], assembled in registers: eight stores and one load would wait for store forwarding, and eight
// assignments of single lanes would be serial.
template <int kStep>
HIL_INLINE D picked(const double *from, const std::int32_t *at) {
    constexpr int kLanes = kRegisterBytes / 8;
    const auto lane = [from, at](int k) __attribute__((always_inline)) { return from[kStep * (long)at[k]]; };
    D v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        const int k = i * kLanes;
        if constexpr (kLanes == 8) {
            v.r[i] = DoubleRegister{lane(k),     lane(k + 1), lane(k + 2), lane(k + 3),
                                    lane(k + 4), lane(k + 5), lane(k + 6), lane(k + 7)};
        } else if constexpr (kLanes == 4) {
            v.r[i] = DoubleRegister{lane(k), lane(k + 1), lane(k + 2), lane(k + 3)};
        } else {
            v.r[i] = DoubleRegister{lane(k), lane(k + 1)};
        }
    }
    return v;
}

typedef float Four __attribute__((vector_size(16)));

HIL_INLINE void store_single(float *to, const D &x) {
    typedef float Half __attribute__((vector_size(kRegisterBytes / 2)));
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        const Half h = __builtin_convertvector(x.r[i], Half);
        __builtin_memcpy(to + i * (kRegisterBytes / 8), &h, sizeof h);
    }
}

// t_p . (d_out - d) in cycles, which the receivers' sums t_p + r_k leave out. `way`: d.
HIL_INLINE D turned_out(const EchoModel &model, const EchoView &echoes, const std::int32_t *echo, int group,
                        const D *way) {
    const double *t = model.transmitter[group];
    D sum = splat<D>(0.0);
    for (int axis = 0; axis < 3; ++axis) {
        sum = sum + (picked<3>(echoes.out_direction_R + axis, echo) - way[axis]) * t[axis];
    }
    return sum;
}

// Fills the block with echoes index[0 .. count), count >= 1; rows from count on, up to a whole pack, have weight 0.
HIL_INLINE void fill_block(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, int count,
                           int group, EchoBlock &block) {
    const int receivers = model.in_group[group];
    const double chirp_offset = model.chirp_offset + model.group_offset[group];
    for (int first = 0; first < count; first += D::kCount) {
        alignas(64) std::int32_t echo[D::kCount];
        for (int lane = 0; lane < D::kCount; ++lane) echo[lane] = index[first + lane < count ? first + lane : count - 1];
        const D r = picked<1>(echoes.range_m, echo), v = picked<1>(echoes.speed_mps, echo);
        D amplitude = picked<1>(echoes.amplitude, echo);
        if (first + D::kCount > count) {
            alignas(64) double some[D::kCount];
            store(some, amplitude);
            for (int lane = count - first; lane < D::kCount; ++lane) some[lane] = 0.0;
            amplitude = load<D>(some);
        }
        const D way[3] = {picked<3>(echoes.direction_R, echo), picked<3>(echoes.direction_R + 1, echo),
                          picked<3>(echoes.direction_R + 2, echo)};
        const Twofold<D> constant = plus(times(lanes_of(model.cycles_per_m), r), (r * r) * model.cycles_per_m2);
        const Twofold<D> alpha = plus(times(lanes_of(model.chirp_per_mps), v), (r * v) * model.chirp_per_mps_m);
        const Twofold<D> beta = plus(times(lanes_of(model.sample_per_m), r),
                                     v * (r * model.sample_per_mps_m + model.sample_per_mps));
        // Products with 0, 1/2 and quarters are exact, so they need no reduction before. With other offsets delta_p the
        // greatest alpha, 1e3 cycles, is rounded to 1e-13.
        const Twofold<D> half_alpha = {alpha.hi * chirp_offset, alpha.lo * chirp_offset};
        const Twofold<D> half_beta = {beta.hi * model.sample_offset, beta.lo * model.sample_offset};
        D phase = fraction(constant) + (fraction(half_alpha) + fraction(half_beta));
        if (echoes.out_direction_R != nullptr) phase = phase - turned_out(model, echoes, echo, group, way);
        store(block.alpha + first, fraction(alpha));
        store(block.beta + first, fraction(beta));
        store(block.speed + first, v);
        D re, im;
        filtered(model, r * model.beat_hz_per_m, amplitude, re, im);
        for (int k = 0; k < receivers; ++k) {
            const double *p = model.receiver[group * kGroup + k];
            const D path = way[0] * p[0] + way[1] * p[1] + way[2] * p[2];
            D c, s;
            turn(phase - path, c, s);
            store(block.re[k] + first, re * c - im * s);
            store(block.im[k] + first, re * s + im * c);
        }
        for (int k = receivers; k < kGroup; ++k) {
            store(block.re[k] + first, splat<D>(0.0));
            store(block.im[k] + first, splat<D>(0.0));
        }
    }
}

// The remainder's coefficients at speed v: kappa_1 mu nu + kappa_2 nu^2 + kappa_3 mu^2 cycles.
struct Remainder {
    D mixed, sample, chirp;
};
HIL_INLINE Remainder remainder_at(const EchoModel &model, const D &v) {
    const D u = v * model.delay_per_mps;
    return {u * (1.0 - u) * model.migration, u * (1.0 - u * 0.5) * model.curve, u * u * (-model.bend)};
}

}  // namespace hil::sim::radar::HIL_ISA
