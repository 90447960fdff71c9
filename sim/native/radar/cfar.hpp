// Constant false-alarm rate: which cells of a map stand out of the noise round them.
//
// Noise alone. A cell is the mean of K receivers' powers: Gamma with shape K and mean s. The noise about a cell under
// test is estimated from its training cells, those within guard + train of it in rows and in columns but not within
// guard in both. Rows wrap round (Doppler is periodic), columns end (range is not): there are fewer at the edges.
//
//   CA  mean of n cells: Gamma with shape a = K n. A cell exceeds alpha times that with probability (G_K, G_a gammas)
//         P(G_K > t G_a) = sum over j < K of C(a + j - 1, j) t^j (1 + t)^-(a + j),   t = alpha K / a
//       which for K = 1 is (1 + alpha / n)^-n, so alpha = n (P^(-1/n) - 1).
//   OS  the k-th smallest of n: its distribution is Beta(k, n - k + 1) of the gamma's distribution function, and
//         P = integral of p(y) Q_K(alpha K y) dy,     for K = 1:  P = product over i < k of (n - i) / (n - i + alpha)
//       The estimate is divided by the quantile k / n of the unit gamma, so that it too means the mean power.
//
// A window and zero-padding make neighbouring cells alike: n is divided by `likeness`, the mean number of cells that a
// cell counts for (the sum of the squared correlations), and k keeps its share of n.
#pragma once

#include <vector>

namespace hil::sim::radar {

enum class CfarKind { kCellAveraging, kOrderStatistic };

struct CfarSettings {
    CfarKind kind = CfarKind::kCellAveraging;
    int guard_rows = 0, guard_columns = 0, train_rows = 0, train_columns = 0;
    double rank = 0.75;            // k / n
    double false_alarm = 1e-5;     // wanted probability, each cell
    int receivers = 1;             // K
    int quiet_columns = 0;         // the first columns, where mean removal took the noise as well: they train nothing
    double likeness = 1.0;
};

double cell_averaging_factor(double cells, int receivers, double false_alarm);
double order_statistic_factor(double cells, double rank, int receivers, double false_alarm);
double gamma_quantile(int shape, double probability);  // of Gamma(shape) / shape, mean 1

class Cfar {
   public:
    // `quiet` rows hold less noise than the others (what clutter removal took): they train nothing.
    Cfar(int rows, int columns, const CfarSettings &settings, std::vector<bool> quiet);

    // Before noise(), once a map; keeps the pointer.
    void look_at(const float *power);
    double noise(int row, int column) const;      // estimated mean power; NaN where nothing trains
    double threshold(int row, int column) const;  // times noise

    int rows() const { return rows_; }
    int columns() const { return columns_; }

   private:
    template <class Visit>
    void train(int row, int column, Visit visit) const;
    void sum_boxes(int half_rows, int half_columns, std::vector<double> &out);

    int rows_, columns_;
    CfarSettings settings_;
    std::vector<bool> quiet_;
    std::vector<int> count_;
    std::vector<double> factor_, quantile_;  // by cell: alpha, and what the estimate is divided by
    const float *power_ = nullptr;
    std::vector<double> outer_, inner_, across_;
    mutable std::vector<float> sorted_;
};

}  // namespace hil::sim::radar
