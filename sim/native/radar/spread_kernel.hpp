// Kernel that spreads a frequency over the points of an oversampled grid: w taps, each a polynomial of the offset.
//
// Kaiser-Bessel, I_0(b sqrt(1 - (2 z / w)^2)), b = 0.98 pi w (1 - 1 / (2 sigma)) (0.96 for w < 5) with sigma the
// oversampling (Beatty et al., IEEE TMI 24, 2005; b is slightly below theirs, where the mean error over the outputs is
// least).
#pragma once

#include <vector>

namespace hil::sim::radar {

constexpr int kMinWidth = 2, kMaxWidth = 16;
// Widths for which the grids are compiled. A grid in single precision is for errors of 4e-5 and more: width 6 suffices
// at the least oversampling, and one wider is tried. A grid in double is for smaller errors, which need at least 5.
constexpr int kMaxSingleWidth = 7, kMinDoubleWidth = 5;

// Tap i at offset x in [0, 1] is the kernel at z = i + x - w/2. With t = 2 x - 1 it is even_i(t^2) + t odd_i(t^2); tap
// w - 1 - i has the same polynomials and - t. Degree w.
struct SpreadKernel {
    int width;
    double coefficient[(kMaxWidth + 1) / 2][kMaxWidth + 1];  // of t^0, t^1, ...
};

// `oversampling`: grid points / outputs, at least 2.
SpreadKernel spread_kernel(int width, double oversampling);

// Reciprocals of the kernel's transform at `count` output indices from `first` on.
std::vector<double> spread_scale(const SpreadKernel &kernel, int first, int count, int size);

// Root mean square error of a unit exponential at its worst frequency, over outputs -count/2 .. count - 1 - count/2 of a
// grid of `size` points.
double spread_error(const SpreadKernel &kernel, int count, int size);

}  // namespace hil::sim::radar
