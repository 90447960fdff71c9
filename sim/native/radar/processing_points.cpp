#include "processing_points.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

constexpr double kDecibelsPerNeper = 4.34294481903251827651;  // 10 / ln 10
// counts^2. Rounding to counts alone leaves 1e-4 in a map of 64 x 64; less is what doubles leave of nothing.
constexpr float kLeastPower = 1e-12f;
constexpr double kLobeMargin = 4.0;  // a peak between cells loses up to 3 dB and its lobes do not; lobes of two may add
constexpr double kMostDecibels = 200.0;                       // of a peak in a map without noise

double ratio_of(double before, double here, double after) {
    const double b = std::sqrt(before), h = std::sqrt(here), a = std::sqrt(after);
    return (a - b) / (b + h + a);
}

}  // namespace

double bins_off(const std::vector<double> &table, double ratio) {
    const double size = std::fabs(ratio);
    const auto above = std::upper_bound(table.begin(), table.end(), size);
    const int last = (int)table.size() - 1;
    double found = 0.5;
    if (above != table.end()) {
        const int i = std::max(1, (int)(above - table.begin()));
        found = 0.5 * ((i - 1) + (size - table[i - 1]) / (table[i] - table[i - 1])) / last;
    }
    return ratio < 0.0 ? -found : found;
}

PeakFinder::PeakFinder(PeakSettings settings, Cfar cfar, Direction direction)
    : settings_(std::move(settings)), cfar_(std::move(cfar)), direction_(std::move(direction)) {
    if (settings_.range_ratio.size() < 2 || settings_.speed_ratio.size() < 2) {
        throw std::invalid_argument("tables between bins need two values or more");
    }
    peaks_.reserve((std::size_t)cfar_.rows() * cfar_.columns() / 2);
    if ((int)settings_.range_lobes.size() <= cfar_.columns() || (int)settings_.speed_lobes.size() <= cfar_.rows() / 2) {
        throw std::invalid_argument("tables of side lobes must reach through the map");
    }
    re_.resize(direction_.receivers());
    im_.resize(direction_.receivers());
}

bool PeakFinder::is_peak(const float *power, int row, int column) const {
    const int rows = cfar_.rows(), columns = cfar_.columns();
    const float here = power[(std::size_t)row * columns + column];
    for (int d = -1; d <= 1; ++d) {
        const float *beside = power + (std::size_t)((row + d + rows) % rows) * columns + column;
        // Of equal cells the first is the peak.
        for (int e = -1; e <= 1; ++e) {
            if (d < 0 || (d == 0 && e < 0)) {
                if (!(here > beside[e])) return false;
            } else if (!(here >= beside[e])) {
                return false;
            }
        }
    }
    return true;
}

bool PeakFinder::is_lobe(const Peak &peak, const Peak &stronger) const {
    const auto below = [&](int rows, int columns) {
        rows = std::abs(rows) % cfar_.rows();
        rows = std::min(rows, cfar_.rows() - rows);
        columns = std::abs(columns);
        columns = std::min(columns, 2 * cfar_.columns() - columns);
        if (rows <= settings_.speed_null && columns <= settings_.range_null) return false;
        return peak.power < kLobeMargin * stronger.power * settings_.speed_lobes[rows] * settings_.range_lobes[columns];
    };
    // Samples are real: each echo has a mirror image at minus its range and minus its speed.
    return below(peak.row - stronger.row, peak.column - stronger.column) ||
           below(peak.row + stronger.row - cfar_.rows(), peak.column + stronger.column);
}

int PeakFinder::find(const ProcessingMap &map, const float *power, RadarPoint *out, int room) {
    const MapShape &shape = map.shape();
    const int rows = shape.rows, columns = shape.columns;
    if (rows != cfar_.rows() || columns != cfar_.columns() || shape.receivers != direction_.receivers()) {
        throw std::invalid_argument("the map has another shape than the detector");
    }
    cfar_.look_at(power);
    peaks_.clear();
    for (int row = 0; row < rows; ++row) {
        for (int column = std::max(1, settings_.first_column); column < columns - 1; ++column) {
            const float here = power[(std::size_t)row * columns + column];
            if (!(here > kLeastPower) || !is_peak(power, row, column)) continue;
            const double noise = cfar_.noise(row, column);
            if (here > cfar_.threshold(row, column) * noise) peaks_.push_back({here, row, column, noise});
        }
    }
    std::stable_sort(peaks_.begin(), peaks_.end(), [](const Peak &a, const Peak &b) { return a.power > b.power; });
    std::size_t kept = 0;
    for (const Peak &peak : peaks_) {
        bool lobe = false;
        for (std::size_t i = 0; i < kept && !lobe; ++i) lobe = is_lobe(peak, peaks_[i]);
        if (!lobe) peaks_[kept++] = peak;
        if ((int)kept == room) break;
    }
    const int count = (int)kept;
    const double whole_speed = settings_.speed_step_mps * rows;
    for (int i = 0; i < count; ++i) {
        const Peak &peak = peaks_[i];
        const float *row = power + (std::size_t)peak.row * columns + peak.column;
        const float before = power[(std::size_t)((peak.row + rows - 1) % rows) * columns + peak.column];
        const float after = power[(std::size_t)((peak.row + 1) % rows) * columns + peak.column];
        const double off_row = bins_off(settings_.speed_ratio, ratio_of(before, row[0], after));
        const double off_column = bins_off(settings_.range_ratio, ratio_of(row[-1], row[0], row[1]));
        double speed = settings_.speed_step_mps * (peak.row - rows / 2 + off_row);
        if (speed < -0.5 * whole_speed) speed += whole_speed;
        const double range =
            settings_.range_step_m * (peak.column + off_column) - settings_.coupling_s * speed;
        for (int k = 0; k < shape.receivers; ++k) map.cell(k, peak.row, peak.column, &re_[k], &im_[k]);
        const auto d = direction_.find(re_.data(), im_.data());
        const double most = 1e20;
        const double snr = peak.noise * most > peak.power ? peak.power / peak.noise : most;
        const double snr_db = std::min(kMostDecibels, kDecibelsPerNeper * det::log(snr));
        out[i] = {(float)(range * d[0]), (float)(range * d[1]), (float)(range * d[2]),
                  (float)range, (float)speed,
                  (float)det::atan2(d[1], d[0]), (float)det::asin(d[2]), (float)snr_db};
    }
    return count;
}

}  // namespace hil::sim::radar
