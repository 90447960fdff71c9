#include "processing_map.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hil::sim::radar {

namespace {

int lost_to_differences(Clutter clutter) {
    return clutter == Clutter::kTwoPulse ? 1 : clutter == Clutter::kThreePulse ? 2 : 0;
}

double sum(const std::vector<double> &values) {
    double total = 0.0;
    for (const double value : values) total += value;
    return total;
}

}  // namespace

ProcessingMap::ProcessingMap(int receivers, int chirps, int samples, int pad_chirps, int pad_samples, Clutter clutter,
                             bool remove_chirp_mean, std::vector<double> fast_window, std::vector<double> slow_window,
                             frame::Isa isa)
    : shape_{receivers, chirps, samples, power_of_two_from(chirps) * pad_chirps,
             power_of_two_from(samples) * pad_samples / 2},
      clutter_(clutter),
      remove_chirp_mean_(remove_chirp_mean),
      pulses_(chirps - lost_to_differences(clutter)),
      fast_window_(std::move(fast_window)),
      slow_window_(std::move(slow_window)),
      fast_(2 * shape_.columns),
      slow_(shape_.rows),
      fft_(&fft_kernels(isa)) {
    if (receivers < 1 || samples < 2 || pulses_ < 2) {
        throw std::invalid_argument("a map needs a receiver, two samples and two chirps after clutter removal");
    }
    if ((int)fast_window_.size() != samples || (int)slow_window_.size() != pulses_) {
        throw std::invalid_argument("windows must be as long as what they weigh");
    }
    fast_sum_ = sum(fast_window_);
    slow_sum_ = sum(slow_window_);
    const double normal = 2.0 / (fast_sum_ * slow_sum_);
    scale_ = normal * normal / receivers;
    if (!std::isfinite(scale_)) throw std::invalid_argument("a window that sums to zero has no amplitude");
    const std::size_t pairs = (pulses_ + 1) / 2;
    samples_.resize((std::size_t)samples * chirps);
    background_.resize((std::size_t)receivers * samples);
    fast_re_.resize(fast_.rows * pairs);
    fast_im_.resize(fast_.rows * pairs);
    spectrum_.resize((std::size_t)receivers * 2 * shape_.rows * shape_.columns);
    total_.resize((std::size_t)shape_.rows * shape_.columns);
}

void ProcessingMap::load(int receiver, const std::uint16_t *raw, double background_gain) {
    const int chirps = shape_.chirps, samples = shape_.samples;
    for (int m = 0; m < chirps; ++m) {
        const std::uint16_t *chirp = raw + (std::size_t)m * samples;
        double mean = 0.0;
        if (remove_chirp_mean_) {
            for (int n = 0; n < samples; ++n) mean += fast_window_[n] * chirp[n];
            mean /= fast_sum_;
        }
        for (int n = 0; n < samples; ++n) samples_[(std::size_t)n * chirps + m] = (double)chirp[n] - mean;
    }
    if (clutter_ != Clutter::kMean && clutter_ != Clutter::kBackground) return;
    double *background = background_.data() + (std::size_t)receiver * samples;
    for (int n = 0; n < samples; ++n) {
        double *row = samples_.data() + (std::size_t)n * chirps;
        double mean = 0.0;
        for (int m = 0; m < chirps; ++m) mean += slow_window_[m] * row[m];
        mean /= slow_sum_;
        double still = mean;
        if (clutter_ == Clutter::kBackground) {
            if (!learned_) background[n] = mean;
            still = background[n];
            background[n] += background_gain * (mean - background[n]);
        }
        for (int m = 0; m < chirps; ++m) row[m] -= still;
    }
}

void ProcessingMap::difference() {
    const double two = std::sqrt(0.5), three = std::sqrt(1.0 / 6.0);
    for (int n = 0; n < shape_.samples; ++n) {
        double *row = samples_.data() + (std::size_t)n * shape_.chirps;
        for (int m = 0; m < pulses_; ++m) {
            row[m] = clutter_ == Clutter::kTwoPulse ? two * (row[m + 1] - row[m])
                                                    : three * (row[m + 2] - 2.0 * row[m + 1] + row[m]);
        }
    }
}

void ProcessingMap::transform(int receiver) {
    const int pairs = (pulses_ + 1) / 2, rows = shape_.rows, columns = shape_.columns;
    // Two real chirps are the parts of one complex column: a + j b has the spectrum A + j B, and A, B are Hermitian.
    std::fill(fast_re_.begin(), fast_re_.end(), 0.0);
    std::fill(fast_im_.begin(), fast_im_.end(), 0.0);
    for (int n = 0; n < shape_.samples; ++n) {
        const double *row = samples_.data() + (std::size_t)n * shape_.chirps;
        double *re = fast_re_.data() + (std::size_t)fast_.place[n] * pairs;
        double *im = fast_im_.data() + (std::size_t)fast_.place[n] * pairs;
        const double w = fast_window_[n];
        for (int m = 0; m < pairs; ++m) re[m] = w * row[m] * slow_window_[m];
        for (int m = pairs; m < pulses_; ++m) im[m - pairs] = w * row[m] * slow_window_[m];
    }
    fft_->columns(fast_re_.data(), fast_im_.data(), fast_.rows, pairs, pairs, fast_.cosine.data(), fast_.sine.data());

    double *re = spectrum_.data() + (std::size_t)receiver * 2 * rows * columns;
    double *im = re + (std::size_t)rows * columns;
    std::fill(re, im + (std::size_t)rows * columns, 0.0);
    for (int m = 0; m < pairs; ++m) {
        const std::size_t first = (std::size_t)slow_.place[m] * columns;
        const bool odd_one = m + pairs >= pulses_;
        const std::size_t second = odd_one ? 0 : (std::size_t)slow_.place[m + pairs] * columns;
        for (int k = 0; k < columns; ++k) {
            const std::size_t here = (std::size_t)k * pairs + m;
            const std::size_t there = (std::size_t)(k == 0 ? 0 : fast_.rows - k) * pairs + m;
            const double zr = fast_re_[here], zi = fast_im_[here], yr = fast_re_[there], yi = fast_im_[there];
            re[first + k] = 0.5 * (zr + yr);
            im[first + k] = 0.5 * (zi - yi);
            if (odd_one) continue;
            re[second + k] = 0.5 * (zi + yi);
            im[second + k] = 0.5 * (yr - zr);
        }
    }
    fft_->columns(re, im, rows, columns, columns, slow_.cosine.data(), slow_.sine.data());
}

void ProcessingMap::compute(const std::uint16_t *raw, double background_gain, float *power) {
    const std::size_t cells = total_.size();
    std::fill(total_.begin(), total_.end(), 0.0);
    for (int receiver = 0; receiver < shape_.receivers; ++receiver) {
        load(receiver, raw + (std::size_t)receiver * shape_.chirps * shape_.samples, background_gain);
        if (lost_to_differences(clutter_) > 0) difference();
        transform(receiver);
        const double *re = spectrum_.data() + (std::size_t)receiver * 2 * cells, *im = re + cells;
        for (std::size_t i = 0; i < cells; ++i) total_[i] += re[i] * re[i] + im[i] * im[i];
    }
    learned_ = true;
    // Zero speed moves from row 0 to the middle.
    const std::size_t half = cells / 2;
    for (std::size_t i = 0; i < half; ++i) {
        power[i + half] = (float)(scale_ * total_[i]);
        power[i] = (float)(scale_ * total_[i + half]);
    }
}

void ProcessingMap::cell(int receiver, int row, int column, double *re, double *im) const {
    const int l = (row + shape_.rows / 2) % shape_.rows;
    const std::size_t cells = total_.size();
    const std::size_t at = (std::size_t)receiver * 2 * cells + (std::size_t)l * shape_.columns + column;
    *re = spectrum_[at];
    *im = spectrum_[at + cells];
}

}  // namespace hil::sim::radar
