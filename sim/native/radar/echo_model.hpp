// Phase of an echo over the samples of a frame, as a polynomial of the sample's indices.
//
// With tau = tau_0 + u t, tau_0 = 2 R / c, u = 2 v / c, a = 1 / f_s, and indices that count from the middle of the
// frame, mu = m - (M - 1) / 2 and nu = n - (N - 1) / 2 (t = mu T_c + a nu), the phase f_0 tau + S t_n tau - S tau^2 / 2
// in cycles is exactly
//
//     phi_0 + alpha mu + beta nu + kappa_1 mu nu + kappa_2 nu^2 + kappa_3 mu^2
//
//     f_mid   = f_0 + S (N - 1) / (2 f_s)            frequency in the middle of a chirp's samples
//     phi_0   = tau_0 (f_mid - S tau_0 / 2)
//     alpha   = T_c u (f_mid - S tau_0)              cycles per chirp
//     beta    = a (S tau_0 + u f_mid - S tau_0 u)    cycles per sample
//     kappa_1 = S a T_c u (1 - u)                    range migration
//     kappa_2 = S a^2 u (1 - u / 2)
//     kappa_3 = -S T_c^2 u^2 / 2
//
// The first three separate into chirps and samples; the others (the remainder) depend on the speed alone.
//
// Several transmitters: a channel is a pair of a transmitter at t_p and a receiver at r_k, whose phase is that of one
// receiver at t_p + r_k. In time division, transmitter p of P sends the chirps p, p + P, ...: its own M / P chirps repeat
// every P T_c, and mu counts those, with the offset delta_p = (p - (P - 1) / 2) / P of their middle from the frame's. So
// the equations above hold for each transmitter with T_c' = P T_c and mu = l - (M / P - 1) / 2 + delta_p, and the motion
// between the chirps of two transmitters is in alpha (delta_p - delta_q) and in the remainder.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "twofold.hpp"

namespace hil::sim::radar {

constexpr double kMaxRange = 1e5;      // m
constexpr double kMaxSpeed = 1e3;      // m/s, either way
constexpr double kMinAmplitude = 1e-100;  // weaker echoes are ignored: the square would underflow
constexpr double kMaxAmplitude = 1e100;
constexpr int kGroup = 4;  // receivers summed at once
constexpr int kMaxReceivers = 16;
constexpr int kMaxTransmitters = 12;
constexpr int kMaxGroups = kMaxTransmitters * kMaxReceivers / kGroup;

struct ChirpFigures {
    double center_frequency_hz, bandwidth_hz, sample_rate_hz, repetition_s;
    int samples, chirps;
};

struct ArrayFigures {
    std::vector<std::array<double, 3>> tx_positions_m, rx_positions_m;
    // 0: time division, one transmitter a chirp. Otherwise all transmit at once, transmitter p with the phase of
    // p m / doppler_bands cycles at chirp m (Doppler division).
    int doppler_bands;
    bool complex_samples;  // in-phase and quadrature parts; otherwise the in-phase part alone
};

struct EchoModel {
    int chirps, samples;               // chirps of one transmitter
    int transmitters, receivers;
    int groups_per_transmitter, groups;  // a group: up to kGroup receivers of one transmitter
    int in_group[kMaxGroups];          // receivers
    double group_offset[kMaxGroups];   // delta_p of the group's transmitter
    int middle_chirp, middle_sample;   // integer index at which the phase is counted from
    double chirp_offset, sample_offset;  // mu = m - middle_chirp + chirp_offset: a half for even counts, else 0
    Twofold<double> cycles_per_m;      // phi_0 = R (cycles_per_m + R cycles_per_m2)
    double cycles_per_m2;
    Twofold<double> chirp_per_mps;     // alpha = v (chirp_per_mps + R chirp_per_mps_m)
    double chirp_per_mps_m;
    Twofold<double> sample_per_m;      // beta = R sample_per_m + v (sample_per_mps + R sample_per_mps_m)
    double sample_per_mps, sample_per_mps_m;
    double delay_per_mps;              // u = v delay_per_mps
    double migration, curve, bend;     // kappa_1 = migration u (1 - u), kappa_2 = curve u (1 - u/2), kappa_3 = -bend u^2
    double beat_hz_per_m;
    double hp_cutoff_hz;               // 0: no high-pass
    double aaf_period_s;               // 1 / cut-off of the anti-alias filter; 0: none
    double receiver[kMaxGroups * kGroup][3];  // (t_p + r_k) / lambda, kGroup for each group
    double transmitter[kMaxGroups][3];        // t_p / lambda of each group
};

// Cut-offs of 0 switch a filter off.
EchoModel echo_model(const ChirpFigures &chirp, const ArrayFigures &array, double hp_cutoff_hz,
                     double aaf_cutoff_hz);

// `count` echoes; direction_R is [count][3]. An echo by a mirror can leave in another direction than it comes back from:
// out_direction_R, of the same shape, or null: the same. Its phase at t_p and r_k is that of t_p . d_out + r_k . d.
struct EchoView {
    std::size_t count;
    const double *range_m, *speed_mps, *direction_R, *amplitude;
    const double *out_direction_R = nullptr;
};

}  // namespace hil::sim::radar
