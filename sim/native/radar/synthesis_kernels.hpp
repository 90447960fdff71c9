// Kernels compiled once per instruction set: weights of echoes, direct sum, and stages of the non-uniform FFT.
#pragma once

#include "echo_model.hpp"
#include "../frame/isa.hpp"
#include "speed_nodes.hpp"
#include "spread_kernel.hpp"

namespace hil::sim::radar {

// Cells of a grid are 64 bytes: real parts of the receivers, then imaginary ones. One term in double, or two in single
// precision, which costs as much: real parts of the first term, of the second, imaginary ones of the first, the second.
constexpr int kChannel = 2 * kGroup;
template <class Real>
constexpr int kTerms = 8 / static_cast<int>(sizeof(Real));  // of a cell
template <class Real>
constexpr int kCell = kChannel * kTerms<Real>;
constexpr int kHalo = kMaxWidth;      // rows and columns beyond the grid, so that a kernel never wraps while spreading
// Single precision: greatest number of echoes with kernels that begin in one cell, before the cells under them are
// emptied into doubles. For n equal numbers all roundings can have the same sign, n 2^-25 of the sum together. Up to
// width^2 kernels cover a cell; their roundings differ.
constexpr int kMostAdditions = 255;

struct Weighing {
    double sum_squares;      // of the weights
    double least_speed, greatest_speed;  // of echoes with a weight above 0; least > greatest without any
    bool legal;              // every value is finite and within the limits of echo_model.hpp
};

// Oversampled grids of several terms: [plane][row, chirps][column, samples][kCell].
template <class Real>
struct Grid {
    Real *cells;
    std::uint8_t *rows_used, *columns_used;  // rows and columns under a kernel, with the halo; all others are zero
    int rows, columns;      // powers of two, without the halo
    long stride;            // Reals from one row to the next
    long plane;             // Reals from one plane to the next
    // Single precision only: sums of emptied cells, laid out as `cells`; the rows that hold any; and the number of
    // kernels that have begun in each cell since.
    double *emptied = nullptr;
    std::uint8_t *emptied_rows = nullptr;  // [rows + kHalo]
    std::uint8_t *additions = nullptr;     // [rows][columns]
    double scale = 1.0;     // of the weights, a power of two: they must not leave the range of a float
    long row(int r) const { return r * stride; }
};

// Energies of the sum within the frame and just beyond it, along samples and chirps. If echoes cancel within the frame
// but not beyond it, the aliases may exceed the sum itself.
struct Growth {
    double within[2], beyond[2];
};

template <class Real>
struct Transform {
    double offset;     // delta_p of the group's transmitter
    const double *chirp_scale, *sample_scale;  // one over the kernel's transform, (chirps,) and (samples,)
    const Real *chirp_twiddle, *sample_twiddle;  // cos, sin of 2 pi j / rows and / columns
    Real *work;        // 2 * max(rows, columns) cells
    Real *by_chirp;    // chirps * (columns + 1) cells
    Real *factor;      // for each term of a cell 2 * samples rounded up to 8
    double *sum;       // [chirps][samples][kChannel], complex, added to
    // One over the kernel's transform at count/2 .. count/2 + outer - 1, and as far below.
    const double *chirp_outer_scale, *sample_outer_scale;
    int chirp_outer, sample_outer;
    Growth *growth;    // added to
};

// Stages of the sum on a grid. `speed`: speed of each of the plane's terms.
template <class Real>
struct GridKernels {
    // Adds the echoes of `index` to the grid's planes. The terms from first_term on go to the planes in turn.
    void (*spread)(const EchoModel &, const EchoView &, const std::int32_t *index, std::size_t count,
                   int group, const SpreadKernel &, const SpeedNodes &, int first_term, int planes,
                   const Grid<Real> &);
    // Transforms one plane (its halo is folded in), applies the remainder of each term, adds to transform.sum.
    void (*transform)(const EchoModel &, const Grid<Real> &, int plane, int width, const double *speed,
                      const Transform<Real> &);
};

struct SynthesisKernels {
    // Fills weight_squared [count].
    Weighing (*weigh)(const EchoModel &, const EchoView &, double *weight_squared);
    // Number of values of x, all >= 0, in (0, limit).
    std::size_t (*count_below)(const double *x, std::size_t count, double limit);
    // Adds the echoes of `index` to sum [receivers of the group][chirps][samples rounded up to 8], the real part; the
    // imaginary part to `quadrature`, if that is not null.
    void (*direct)(const EchoModel &, const EchoView &, const std::int32_t *index, std::size_t count, int group,
                   double *sum, double *quadrature);
    GridKernels<double> one_term;
    GridKernels<float> two_terms;
};

const SynthesisKernels &synthesis_kernels(frame::Isa isa);

}  // namespace hil::sim::radar
