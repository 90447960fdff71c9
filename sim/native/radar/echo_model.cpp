#include "echo_model.hpp"

#include <algorithm>

namespace hil::sim::radar {
namespace {

constexpr double kLight = 299792458.0;

Twofold<double> exactly(double x) { return {x, 0.0}; }

}  // namespace

EchoModel echo_model(const ChirpFigures &chirp, const ArrayFigures &array, double hp_cutoff_hz,
                     double aaf_cutoff_hz) {
    EchoModel model{};
    model.transmitters = static_cast<int>(array.tx_positions_m.size());
    model.receivers = static_cast<int>(array.rx_positions_m.size());
    const int turns = array.doppler_bands == 0 ? model.transmitters : 1;  // chirps from one of a transmitter to its next
    const double n = chirp.samples, rate = chirp.sample_rate_hz, repetition = chirp.repetition_s * turns;
    const double bandwidth = chirp.bandwidth_hz;
    model.chirps = chirp.chirps / turns;
    model.samples = chirp.samples;
    model.middle_chirp = model.chirps / 2;
    model.middle_sample = chirp.samples / 2;
    model.chirp_offset = model.chirps % 2 == 0 ? 0.5 : 0.0;
    model.sample_offset = chirp.samples % 2 == 0 ? 0.5 : 0.0;

    // f_mid = f_c - B / 2 + B (N - 1) / (2 N)
    const Twofold<double> below = over(exactly(bandwidth), 2.0 * n);
    const Twofold<double> f_mid = plus(exactly(chirp.center_frequency_hz), Twofold<double>{-below.hi, -below.lo});
    model.cycles_per_m = over(times(f_mid, 2.0), kLight);
    model.chirp_per_mps = times(model.cycles_per_m, repetition);
    model.sample_per_m = over(over(exactly(2.0 * bandwidth), n), kLight);
    model.sample_per_mps = model.cycles_per_m.hi / rate;

    const double slope = bandwidth * rate / n;
    model.cycles_per_m2 = -2.0 * slope / kLight / kLight;
    model.chirp_per_mps_m = -4.0 * slope * repetition / kLight / kLight;
    model.sample_per_mps_m = -4.0 * bandwidth / n / kLight / kLight;
    model.delay_per_mps = 2.0 / kLight;
    model.migration = bandwidth / n * repetition;
    model.curve = bandwidth / n / rate;
    model.bend = 0.5 * slope * repetition * repetition;
    model.beat_hz_per_m = slope * 2.0 / kLight;
    model.hp_cutoff_hz = hp_cutoff_hz;
    model.aaf_period_s = aaf_cutoff_hz > 0.0 ? 1.0 / aaf_cutoff_hz : 0.0;
    model.groups_per_transmitter = (model.receivers + kGroup - 1) / kGroup;
    model.groups = model.transmitters * model.groups_per_transmitter;
    for (int g = 0; g < model.groups; ++g) {
        const int p = g / model.groups_per_transmitter, first = g % model.groups_per_transmitter * kGroup;
        model.in_group[g] = std::min(model.receivers - first, kGroup);
        model.group_offset[g] = turns == 1 ? 0.0 : (p - 0.5 * (turns - 1)) / turns;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            model.transmitter[g][axis] =
                array.tx_positions_m[static_cast<std::size_t>(p)][axis] * chirp.center_frequency_hz / kLight;
        }
        for (int k = 0; k < model.in_group[g]; ++k) {
            const auto &tx = array.tx_positions_m[static_cast<std::size_t>(p)];
            const auto &rx = array.rx_positions_m[static_cast<std::size_t>(first + k)];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                model.receiver[g * kGroup + k][axis] = (tx[axis] + rx[axis]) * chirp.center_frequency_hz / kLight;
            }
        }
    }
    return model;
}

}  // namespace hil::sim::radar
