// How far above the noise a cell must be. Formulas: cfar.hpp.
#include <cmath>

#include "cfar.hpp"
#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

constexpr int kHalvings = 80;
constexpr double kMostFactor = 1e12;
constexpr int kPanels = 4000;
constexpr double kLogNearest = -25.0;

// P(Gamma(shape) > x).
double gamma_above(int shape, double x) {
    double term = det::exp(-x), total = 0.0;
    for (int j = 0; j < shape; ++j) {
        total += term;
        term *= x / (j + 1);
    }
    return total;
}

// P(Gamma(shape) < x), by its series where the complement would leave nothing of it.
double gamma_below(int shape, double x) {
    const double below = 1.0 - gamma_above(shape, x);
    if (below > 1e-6) return below;
    double term = det::exp(-x), total = 0.0;
    for (int j = 1; j <= shape; ++j) term *= x / j;
    for (int j = 1; j <= 12; ++j) {
        total += term;
        term *= x / (shape + j);
    }
    return total;
}

// The factor at which a falling probability is the wanted one.
template <class Probability>
double where_falls_to(double wanted, Probability probability) {
    double low = 0.0, high = 1.0;
    while (high < kMostFactor && probability(high) > wanted) high *= 2.0;
    for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (low + high);
        (probability(middle) > wanted ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

}  // namespace

double cell_averaging_factor(double cells, int receivers, double false_alarm) {
    const double a = receivers * cells;
    return where_falls_to(false_alarm, [&](double alpha) {
        const double t = alpha * receivers / a;
        double term = det::exp(-a * det::log(1.0 + t)), total = 0.0;
        for (int j = 0; j < receivers; ++j) {
            total += term;
            term *= (a + j) / (j + 1) * (t / (1.0 + t));
        }
        return total;
    });
}

double order_statistic_factor(double cells, double rank, int receivers, double false_alarm) {
    const double k = rank * cells, rest = cells - k;  // Beta(k, rest + 1)
    // Weights of the estimate's values x = K y, on steps of equal ratio: wanted probabilities that are small are made
    // by values far below the mean as much as by those about it.
    std::vector<double> x(kPanels), weight(kPanels);
    const double farthest = det::log(40.0 + 4.0 * receivers), span = farthest - kLogNearest;
    double greatest = -1e300;
    for (int i = 0; i < kPanels; ++i) {
        x[i] = det::exp(kLogNearest + span * (i + 0.5) / kPanels);
        const double above = gamma_above(receivers, x[i]), log_density = receivers * det::log(x[i]) - x[i];
        weight[i] = (k - 1.0) * det::log(gamma_below(receivers, x[i])) + rest * det::log(above) + log_density;
        greatest = weight[i] > greatest ? weight[i] : greatest;
    }
    double total = 0.0;
    for (double &w : weight) total += w = det::exp(w - greatest);
    return where_falls_to(false_alarm, [&](double alpha) {
        double probability = 0.0;
        for (int i = 0; i < kPanels; ++i) {
            if (weight[i] > 1e-18) probability += weight[i] * gamma_above(receivers, alpha * x[i]);
        }
        return probability / total;
    });
}

double gamma_quantile(int shape, double probability) {
    return where_falls_to(1.0 - probability, [&](double x) { return gamma_above(shape, x * shape); });
}

}  // namespace hil::sim::radar
