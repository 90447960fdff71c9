// Range-Doppler map of a frame of raw samples.
//
//   x[n, m]  raw less each chirp's mean (optional) and less the static clutter
//   X[l, k] = sum over m, n of w_slow[m] w_fast[n] x[n, m] exp(-j 2 pi (k n / N' + l m / M'))
//   P[row, k] = mean over receivers of (2 / (sum w_fast sum w_slow))^2 |X|^2,   row = (l + M' / 2) mod M'
//
// so an echo of amplitude A counts, well within the map, gives A^2 at its peak. M' and N' are powers of two; k < N'/2.
// Static clutter: none; the mean over the frame's chirps; differences of two or three successive chirps (scaled so that
// white noise keeps its power, which shortens w_slow); or a background learned over frames, b += g (mean over chirps -
// b).
//
// Means are weighed by the window of their dimension: a plain mean holds what the side lobes of a rectangle catch of a
// moving target, and would put it at zero speed when it is taken away.
//
// Sums go in a fixed order. No allocation after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "fft.hpp"

namespace hil::sim::radar {

enum class Clutter { kNone, kMean, kTwoPulse, kThreePulse, kBackground };

struct MapShape {
    int receivers, chirps, samples;
    int rows, columns;  // M' and N' / 2
};

class ProcessingMap {
   public:
    // Window lengths: samples, and chirps less 1 or 2 for differences. std::invalid_argument for others.
    ProcessingMap(int receivers, int chirps, int samples, int pad_chirps, int pad_samples, Clutter clutter,
                  bool remove_chirp_mean, std::vector<double> fast_window, std::vector<double> slow_window,
                  frame::Isa isa);

    // raw: (receivers, chirps, samples); power: (rows, columns). `background_gain` in [0, 1] is of use to kBackground;
    // the first frame after construction or reset is the background as it is.
    void compute(const std::uint16_t *raw, double background_gain, float *power);
    void reset() { learned_ = false; }

    const MapShape &shape() const { return shape_; }
    // X of one receiver in a cell of the map, of the last frame.
    void cell(int receiver, int row, int column, double *re, double *im) const;

   private:
    void load(int receiver, const std::uint16_t *raw, double background_gain);
    void difference();
    void transform(int receiver);

    MapShape shape_;
    Clutter clutter_;
    bool remove_chirp_mean_;
    bool learned_ = false;
    int pulses_;  // chirps after differences
    std::vector<double> fast_window_, slow_window_;
    double fast_sum_, slow_sum_, scale_;
    FftTable fast_, slow_;
    const FftKernels *fft_;
    std::vector<double> samples_;  // (samples, chirps)
    std::vector<double> background_;  // (receivers, samples)
    std::vector<double> fast_re_, fast_im_;  // (N', half the chirps): two chirps in one complex column
    std::vector<double> spectrum_;           // (receivers, 2, M', N' / 2)
    std::vector<double> total_;
};

}  // namespace hil::sim::radar
