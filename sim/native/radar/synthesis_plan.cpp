// Choice of the grids and the kernel width for a frame's echoes (synthesis.hpp).
#include <algorithm>
#include <limits>

#include "detmath.hpp"
#include "synthesis.hpp"

namespace hil::sim::radar {
namespace {

constexpr double kSingleRounding = 1e-5;  // relative error of grids in single precision, with margin
constexpr double kSingleFrom = 5e-5;      // least planned error for single precision
constexpr double kAgain = 0.125;  // factor on the interpolation's share of the error from the second round on

}  // namespace

// Approximate times in ns on one core of a server of 2023. Only their ratios matter: they choose between equally
// accurate sums. They are constants, because the choice must not depend on the machine.
SummingCost Synthesis::cost(int width, bool single) const {
    const double rows = rows_, columns = columns_, samples = static_cast<double>(model_.chirps) * wide_;
    const auto steps = [](double n) { return det::log(n) / det::log(2.0); };
    return {2.4 * samples, 40.0 + 4.0 * width, 0.85 * width * width + 3.0,
            0.7 * columns * rows * steps(rows) + 0.7 * model_.chirps * columns * steps(columns) + 3.0 * samples +
                0.5 * rows * columns,
            single ? kTerms<float> : kTerms<double>};
}

void Synthesis::plan(const EchoView &echoes, std::size_t count, const Weighing &weighing, double error, bool again,
                     Plan &plan) {
    plan.panels.cost = std::numeric_limits<double>::infinity();
    plan.single = error >= kSingleFrom;
    const double rounding = plan.single ? kSingleRounding : kRounding;
    error -= rounding;
    const int widest = plan.single ? kMaxSingleWidth : kMaxWidth;
    int width = plan.single ? kMinWidth : kMinDoubleWidth;
    while (width < widest && kernel_error_[width] > 0.9 * error) ++width;
    const double half_span = 0.5 * (weighing.greatest_speed - weighing.least_speed);
    // A wider kernel leaves more of the error to the interpolation, which may then need fewer terms.
    for (int w = width; w <= std::min(width + 1, widest); ++w) {
        // The interpolation's error depends on the speeds and need not cancel where the echoes do.
        const double rest = std::max(error - kernel_error_[w], 0.0) * (again ? kAgain : 1.0);
        PanelPlan &tried = other_plan_.panels;
        const SummingCost price = cost(w, plan.single);
        if (half_span <= remainder_.half_span(1, rest)) {
            const double gridded = price.gridded(static_cast<double>(count), 1);
            const double directly = static_cast<double>(count) * price.direct_echo;
            tried.cost = std::min(gridded, directly);
            tried.count = 1;
            tried.panel[0] = {0, kSpeedBins - 1, count, weighing.least_speed, weighing.greatest_speed, gridded < directly};
        } else {
            if (!histogram_made_) {
                histogram_ = speed_histogram(echoes.speed_mps, index_.data(), count, weighing.least_speed,
                                             weighing.greatest_speed, bin_.data());
                histogram_made_ = true;
            }
            plan_panels(histogram_, remainder_, rest, price, tried);
        }
        if (tried.cost >= plan.panels.cost) continue;
        plan.width = w;
        plan.panels = tried;
        plan.error = kernel_error_[w] + rounding;
        double interpolation = 0.0;
        for (int p = 0; p < tried.count; ++p) {
            const SpeedPanel &panel = tried.panel[p];
            if (panel.nodes == 0) continue;
            interpolation = std::max(interpolation, remainder_.error(panel.nodes, 0.5 * (panel.greatest - panel.least)));
        }
        plan.error += interpolation;
    }
    bool gridded = false;
    for (int p = 0; p < plan.panels.count; ++p) gridded |= plan.panels.panel[p].nodes > 0;
    if (!gridded) {
        plan.width = 0;
        plan.error = 0.0;
    }
}

}  // namespace hil::sim::radar
