// Choice of the echoes that share a grid: the span of speeds is cut into panels. Each is summed with as few nodes as its
// span needs (speed_nodes.hpp), or echo by echo if that is cheaper.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "echo_model.hpp"
#include "speed_nodes.hpp"

namespace hil::sim::radar {

constexpr int kSpeedBins = 128;

// Change of the remainder's phase with the speed, over the samples of a frame.
class RemainderSpread {
public:
    explicit RemainderSpread(const EchoModel &model);
    // Root mean square error over the samples at the worst speed, for `nodes` nodes over 2 * half_span m/s.
    double error(int nodes, double half_span) const;
    // Greatest half span with that error.
    double half_span(int nodes, double error) const;

private:
    double slope_[kMaxNodes + 1];  // error = (half_span * slope)^nodes
};

// Costs in any common unit of time.
struct SummingCost {
    double direct_echo;  // one echo, directly
    double echo;         // one echo onto one grid, without its terms
    double echo_plane;   // additional cost for each plane
    double plane;        // transform of a plane
    int plane_terms;     // terms per plane; a panel of one term uses one plane
    double gridded(double echoes, int nodes) const;  // echoes of one panel
};

struct SpeedHistogram {
    double least, per_bin;  // m/s
    std::size_t count[kSpeedBins];
    double low[kSpeedBins], high[kSpeedBins];  // speeds met in the bin
};

struct SpeedPanel {
    int first_bin, last_bin;  // inclusive
    std::size_t count;
    double least, greatest;   // m/s
    int nodes;                // 0: directly
};

// Histogram of speeds in [least, greatest]; `bin` [count] receives the bin of each echo.
SpeedHistogram speed_histogram(const double *speed_mps, const std::int32_t *index, std::size_t count, double least,
                               double greatest, std::uint8_t *bin);

struct PanelPlan {
    double cost;
    int count;
    SpeedPanel panel[kSpeedBins];
};

// Finds the cheapest cut at the borders of bins with an error of at most `error` in each panel.
void plan_panels(const SpeedHistogram &histogram, const RemainderSpread &spread, double error, const SummingCost &cost,
                 PanelPlan &plan);

}  // namespace hil::sim::radar
