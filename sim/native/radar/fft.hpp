// Fourier transforms down the columns of a matrix: X[k] = sum over n of x[n] exp(-j 2 pi n k / rows), each column
// alone.
//
// Radix 2, decimation in time. The inner loop runs along a row, over columns that have nothing to do with one another,
// so every instruction set makes the same operations in the same order on each: equal bits.
#pragma once

#include <vector>

#include "../frame/isa.hpp"

namespace hil::sim::radar {

// Factors and order of a transform over `rows`, a power of two.
struct FftTable {
    explicit FftTable(int rows);
    int rows;
    std::vector<double> cosine, sine;  // of 2 pi j / rows, j < rows / 2
    std::vector<int> place;            // place[n]: the row in which sample n has to be before the transform
};

int power_of_two_from(int n);  // the smallest that is not below n

struct FftKernels {
    // In place, `columns` of a row-major matrix `stride` wide; rows in the order of `place` before, natural after.
    void (*columns)(double *re, double *im, int rows, int columns, int stride, const double *cosine,
                    const double *sine);
};
const FftKernels &fft_kernels(frame::Isa isa);

}  // namespace hil::sim::radar
