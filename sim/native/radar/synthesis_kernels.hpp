// What is compiled once per instruction set: weighing echoes, the direct sum, and the stages of the non-uniform FFT.
#pragma once

#include "echo_model.hpp"
#include "../frame/isa.hpp"
#include "speed_nodes.hpp"
#include "spread_kernel.hpp"

namespace hil::sim::radar {

constexpr int kChannel = 2 * kGroup;  // doubles of a grid cell: real parts of the receivers, then imaginary ones
constexpr int kHalo = kMaxWidth;      // rows and columns beyond the grid, so that a kernel never wraps while spreading

struct Weighing {
    double sum_squares;      // of the weights
    double least_speed, greatest_speed;  // of the echoes that weigh anything; least > greatest where there are none
    bool legal;              // every figure finite and within the limits of echo_model.hpp
};

// Oversampled grid of one term after another: [term][row, chirps][column, samples][kChannel].
struct Grid {
    double *cells;
    std::uint8_t *touched;  // columns in which a kernel began
    int rows, columns;      // powers of two, without the halo
    long stride;            // doubles from one row to the next
    long plane;             // and from one term to the next
    long row(int r) const { return r * stride; }
};

// Energies of the sum within the frame and just beyond it, along the samples and along the chirps: where the echoes
// cancel within the frame but not beyond, what aliases into it is greater than what is in it.
struct Growth {
    double within[2], beyond[2];
};

struct Transform {
    const double *chirp_scale, *sample_scale;  // one over the kernel's transform, (chirps,) and (samples,)
    const double *chirp_twiddle, *sample_twiddle;  // cos, sin of 2 pi j / rows and / columns
    double *work;      // 2 * max(rows, columns) cells
    double *factor;    // 2 * samples rounded up to 8
    double *sum;       // [chirps][samples][kChannel], complex, added to
    // One over the kernel's transform at count/2 .. count/2 + outer - 1, and as far below.
    const double *chirp_outer_scale, *sample_outer_scale;
    int chirp_outer, sample_outer;
    Growth *growth;    // added to
};

struct SynthesisKernels {
    // weight_squared (count,) filled.
    Weighing (*weigh)(const EchoModel &, const EchoView &, double *weight_squared);
    // How many of x (0 and up) lie in (0, limit).
    std::size_t (*count_below)(const double *x, std::size_t count, double limit);
    // Adds the echoes named to sum [receivers of the group][chirps][samples rounded up to 8].
    void (*direct)(const EchoModel &, const EchoView &, const std::int32_t *index, std::size_t count,
                   int first_receiver, double *sum);
    // Adds the echoes named to the grid's planes: plane j gets term first_term + j of `nodes`.
    void (*spread)(const EchoModel &, const EchoView &, const std::int32_t *index, std::size_t count,
                   int first_receiver, const SpreadKernel &, const SpeedNodes &, int first_term, int terms,
                   const Grid &);
    // Transforms one plane (destroyed), applies the remainder at `speed`, adds to transform.sum.
    void (*transform)(const EchoModel &, const Grid &, int plane, int width, double speed, const Transform &);
};

const SynthesisKernels &synthesis_kernels(frame::Isa isa);

}  // namespace hil::sim::radar
