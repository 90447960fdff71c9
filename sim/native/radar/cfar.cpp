#include "cfar.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

namespace hil::sim::radar {

Cfar::Cfar(int rows, int columns, const CfarSettings &settings, std::vector<bool> quiet)
    : rows_(rows), columns_(columns), settings_(settings), quiet_(std::move(quiet)) {
    const CfarSettings &s = settings_;
    if ((int)quiet_.size() != rows) throw std::invalid_argument("one flag a row of the map");
    if (s.guard_rows < 0 || s.guard_columns < 0 || s.train_rows < 0 || s.train_columns < 0 || s.quiet_columns < 0 ||
        s.receivers < 1 ||
        !(s.rank > 0.0 && s.rank < 1.0) || !(s.false_alarm > 0.0 && s.false_alarm < 1.0) || !(s.likeness >= 1.0)) {
        throw std::invalid_argument("CFAR settings out of range");
    }
    if (2 * (s.guard_rows + s.train_rows) + 1 > rows) {
        throw std::invalid_argument("guard and training cells reach round the whole map in Doppler");
    }
    const std::size_t cells = (std::size_t)rows * columns;
    count_.resize(cells);
    factor_.resize(cells);
    quantile_.assign(cells, 1.0);
    outer_.resize(cells);
    inner_.resize(cells);
    across_.resize(cells);
    const int widest = (2 * (s.guard_rows + s.train_rows) + 1) * (2 * (s.guard_columns + s.train_columns) + 1);
    sorted_.reserve(widest);
    std::map<int, std::pair<double, double>> known;
    for (int row = 0; row < rows; ++row) {
        for (int column = 0; column < columns; ++column) {
            int n = 0;
            train(row, column, [&](int, int) { ++n; });
            const std::size_t at = (std::size_t)row * columns + column;
            count_[at] = n;
            if (n == 0) continue;
            auto found = known.find(n);
            if (found == known.end()) {
                const double alike = n / s.likeness > 1.0 ? n / s.likeness : 1.0;
                const bool ordered = s.kind == CfarKind::kOrderStatistic;
                const double factor = ordered ? order_statistic_factor(alike, s.rank, s.receivers, s.false_alarm)
                                              : cell_averaging_factor(alike, s.receivers, s.false_alarm);
                const double quantile = ordered ? gamma_quantile(s.receivers, s.rank) : 1.0;
                // `factor` of the ordered kind is times the ordered value, noise() is that over the quantile.
                found = known.emplace(n, std::make_pair(factor * quantile, quantile)).first;
            }
            factor_[at] = found->second.first;
            quantile_[at] = found->second.second;
        }
    }
}

template <class Visit>
void Cfar::train(int row, int column, Visit visit) const {
    const CfarSettings &s = settings_;
    const int half_rows = s.guard_rows + s.train_rows, half_columns = s.guard_columns + s.train_columns;
    const int first = std::max(settings_.quiet_columns, column - half_columns);
    const int last = std::min(columns_ - 1, column + half_columns);
    for (int d = -half_rows; d <= half_rows; ++d) {
        const int r = (row + d + rows_) % rows_;
        if (quiet_[r]) continue;
        const bool guarded = d >= -s.guard_rows && d <= s.guard_rows;
        for (int c = first; c <= last; ++c) {
            if (!(guarded && c >= column - s.guard_columns && c <= column + s.guard_columns)) visit(r, c);
        }
    }
}

// out = sums of power over boxes about each cell; quiet rows count as nothing.
void Cfar::sum_boxes(int half_rows, int half_columns, std::vector<double> &out) {
    for (int row = 0; row < rows_; ++row) {
        double *across = across_.data() + (std::size_t)row * columns_;
        std::fill(across, across + columns_, 0.0);
        if (quiet_[row]) continue;
        const float *power = power_ + (std::size_t)row * columns_;
        for (int d = -half_columns; d <= half_columns; ++d) {
            const int first = std::max(0, settings_.quiet_columns - d), last = std::min(columns_, columns_ - d);
            for (int c = first; c < last; ++c) across[c] += power[c + d];
        }
    }
    for (int row = 0; row < rows_; ++row) {
        double *to = out.data() + (std::size_t)row * columns_;
        std::fill(to, to + columns_, 0.0);
        for (int d = -half_rows; d <= half_rows; ++d) {
            const double *across = across_.data() + (std::size_t)((row + d + rows_) % rows_) * columns_;
            for (int c = 0; c < columns_; ++c) to[c] += across[c];
        }
    }
}

void Cfar::look_at(const float *power) {
    power_ = power;
    if (settings_.kind != CfarKind::kCellAveraging) return;
    sum_boxes(settings_.guard_rows + settings_.train_rows, settings_.guard_columns + settings_.train_columns, outer_);
    sum_boxes(settings_.guard_rows, settings_.guard_columns, inner_);
}

double Cfar::noise(int row, int column) const {
    const std::size_t at = (std::size_t)row * columns_ + column;
    const int n = count_[at];
    if (n == 0) return std::numeric_limits<double>::quiet_NaN();
    if (settings_.kind == CfarKind::kCellAveraging) {
        // A difference of sums: below what doubles resolve of the greater it is nothing.
        const double rest = outer_[at] - inner_[at];
        return rest > 1e-13 * outer_[at] ? rest / n : 0.0;
    }
    sorted_.clear();
    train(row, column, [&](int r, int c) { sorted_.push_back(power_[(std::size_t)r * columns_ + c]); });
    const int k = std::min(n, std::max(1, (int)std::floor(settings_.rank * n + 0.5)));
    std::nth_element(sorted_.begin(), sorted_.begin() + (k - 1), sorted_.end());
    return sorted_[k - 1] / quantile_[at];
}

double Cfar::threshold(int row, int column) const { return factor_[(std::size_t)row * columns_ + column]; }

}  // namespace hil::sim::radar
