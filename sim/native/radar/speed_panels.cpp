#include "speed_panels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "detmath.hpp"

namespace hil::sim::radar {
namespace {

constexpr double kMargin = 1.2;  // the bound neglects that the phase's remainder (echo_model.hpp) is not linear in the speed
constexpr int kPoints = 33;

}  // namespace

RemainderSpread::RemainderSpread(const EchoModel &model) {
    // Greatest derivative of kappa_1 mu nu + kappa_2 nu^2 + kappa_3 mu^2 by the speed v, in cycles per m/s (symbols:
    // echo_model.hpp, where the code's migration, curve and bend are explained).
    const double rate = model.delay_per_mps * (1.0 + 4.0 * kMaxSpeed * model.delay_per_mps);
    const double bend_rate = 2.0 * model.bend * model.delay_per_mps * model.delay_per_mps * kMaxSpeed;
    double moment[kMaxNodes + 1] = {};
    double offset = 0.0;
    for (int g = 0; g < model.groups; ++g) offset = std::max(offset, std::fabs(model.group_offset[g]));
    const double half_m = 0.5 * (model.chirps - 1) + offset, half_n = 0.5 * (model.samples - 1);
    const double worst = 2.0 * det::kPi *
                         (model.migration * rate * half_m * half_n + model.curve * rate * half_n * half_n + bend_rate * half_m * half_m);
    for (int i = 0; i < kPoints; ++i) {
        for (int j = 0; j < kPoints; ++j) {
            const double mu = half_m * (i + 0.5) / kPoints, nu = half_n * (j + 0.5) / kPoints;
            const double phase = 2.0 * det::kPi *
                                 (model.migration * rate * mu * nu + model.curve * rate * nu * nu + bend_rate * mu * mu);
            const double square = (phase / worst) * (phase / worst);
            double power = 1.0;
            for (int k = 1; k <= kMaxNodes; ++k) {
                power *= square;
                moment[k] += power / (kPoints * kPoints);
            }
        }
    }
    // Chebyshev nodes: the polynomial of the nodes is at most 2^(1 - k) on [-1, 1], so the error of exp(i theta s) is at
    // most theta^k 2^(1 - k) / k! (Davis, Interpolation and Approximation, 3.3). theta is the change of phase over half
    // a span and s the position in it.
    double factorial = 1.0, chebyshev = 2.0;
    slope_[0] = 0.0;
    for (int k = 1; k <= kMaxNodes; ++k) {
        factorial *= k;
        chebyshev *= 0.5;  // 2^(1 - k)
        const double error_at_1_mps = kMargin * std::sqrt(moment[k]) * chebyshev / factorial;
        slope_[k] = worst * det::exp(det::log(error_at_1_mps) / k);
    }
}

double RemainderSpread::error(int nodes, double half_span) const {
    double product = 1.0;
    for (int k = 0; k < nodes; ++k) product *= half_span * slope_[nodes];
    return product;
}

double RemainderSpread::half_span(int nodes, double error) const {
    return error > 0.0 ? det::exp(det::log(error) / nodes) / slope_[nodes] : 0.0;
}

double SummingCost::gridded(double echoes, int nodes) const {
    const int planes = (nodes + plane_terms - 1) / plane_terms;
    return echoes * (echo + planes * echo_plane) + planes * plane;
}

SpeedHistogram speed_histogram(const double *speed_mps, const std::int32_t *index, std::size_t count, double least,
                               double greatest, std::uint8_t *bin) {
    SpeedHistogram histogram{};
    histogram.least = least;
    histogram.per_bin = (greatest - least) / kSpeedBins;
    const double per_mps = histogram.per_bin > 0.0 ? 1.0 / histogram.per_bin : 0.0;
    // Neighbouring echoes mostly fall into the same bin, whose updates would be serial: alternate between histograms.
    constexpr std::size_t kTurns = 4;
    struct Bin {
        double low = std::numeric_limits<double>::infinity(), high = -low;
        std::size_t count = 0;
    };
    Bin bins[kTurns][kSpeedBins];
    for (std::size_t i = 0; i < count; ++i) {
        const double v = speed_mps[index[i]];
        const int b = std::min(static_cast<int>((v - least) * per_mps), kSpeedBins - 1);
        bin[i] = static_cast<std::uint8_t>(b);
        Bin &into = bins[i % kTurns][b];
        into.low = std::min(into.low, v);
        into.high = std::max(into.high, v);
        ++into.count;
    }
    for (int b = 0; b < kSpeedBins; ++b) {
        Bin all;
        for (std::size_t turn = 0; turn < kTurns; ++turn) {
            all.low = std::min(all.low, bins[turn][b].low);
            all.high = std::max(all.high, bins[turn][b].high);
            all.count += bins[turn][b].count;
        }
        histogram.low[b] = all.low;
        histogram.high[b] = all.high;
        histogram.count[b] = all.count;
    }
    return histogram;
}

void plan_panels(const SpeedHistogram &histogram, const RemainderSpread &spread, double error, const SummingCost &cost,
                 PanelPlan &plan) {
    double reach[kMaxNodes + 1] = {};
    for (int k = 1; k <= kMaxNodes; ++k) reach[k] = spread.half_span(k, error);
    // best[j]: cost of the cheapest cut of the bins before j; from[j]: first bin of its last panel; with[j]: nodes of that
    // panel, 0 if it is summed directly, -1 if bin j - 1 is empty.
    double best[kSpeedBins + 1];
    int from[kSpeedBins + 1], with[kSpeedBins + 1];
    best[0] = 0.0;
    for (int j = 1; j <= kSpeedBins; ++j) {
        best[j] = std::numeric_limits<double>::infinity();
        if (histogram.count[j - 1] == 0) {
            best[j] = best[j - 1];
            from[j] = j - 1;
            with[j] = -1;
            continue;
        }
        double low = std::numeric_limits<double>::infinity(), high = -low;
        double echoes = 0.0;
        int nodes = 1;
        for (int i = j - 1; i >= 0; --i) {
            if (histogram.count[i] == 0) continue;
            low = std::min(low, histogram.low[i]);
            high = std::max(high, histogram.high[i]);
            echoes += static_cast<double>(histogram.count[i]);
            while (nodes <= kMaxNodes && 0.5 * (high - low) > reach[nodes]) ++nodes;
            const double gridded = nodes <= kMaxNodes ? cost.gridded(echoes, nodes) : std::numeric_limits<double>::infinity();
            const double directly = echoes * cost.direct_echo;
            const double total = best[i] + std::min(gridded, directly);
            if (total < best[j]) {
                best[j] = total;
                from[j] = i;
                with[j] = gridded < directly ? nodes : 0;
            }
        }
    }
    plan.cost = best[kSpeedBins];
    plan.count = 0;
    for (int j = kSpeedBins; j > 0; j = from[j]) {
        if (with[j] < 0) continue;
        SpeedPanel panel{from[j], j - 1, 0, std::numeric_limits<double>::infinity(),
                         -std::numeric_limits<double>::infinity(), with[j]};
        for (int b = panel.first_bin; b <= panel.last_bin; ++b) {
            panel.count += histogram.count[b];
            panel.least = std::min(panel.least, histogram.low[b]);
            panel.greatest = std::max(panel.greatest, histogram.high[b]);
        }
        plan.panel[plan.count++] = panel;
    }
    std::reverse(plan.panel, plan.panel + plan.count);
}

}  // namespace hil::sim::radar
