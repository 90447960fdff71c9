// Raw samples of a frame from its echoes: x[k, m, n] = sum over echoes of A |H| cos(2 pi phase + arg H), noise-free; with
// complex samples also the sum of A |H| sin(...). With several transmitters, each chirp has the echoes of those that
// transmit in it (echo_model.hpp).
//
// Methods: the direct sum (the reference), and a type-1 non-uniform FFT in two dimensions (Dutt and Rokhlin, SIAM J. Sci.
// Comput. 14, 1993): echoes are spread over an oversampled grid of frequencies, the grid is transformed, and the result
// is divided by the kernel's transform. The phase that does not separate into chirps and samples depends on the speed
// only. It is interpolated between a few speeds, one term each (speed_nodes.hpp, speed_panels.hpp). Terms are
// transformed one by one, or two in one grid of single precision if the tolerance allows it (synthesis_kernels.hpp,
// pair_block.hpp).
//
// Error of the FFT method, ||x - x_direct|| / ||x_direct|| over the frame: at most the tolerance. The norm of the sum is
// known only afterwards. If echoes cancel so far that the bound does not hold, the frame is repeated with a smaller
// planned error, at last directly. The test uses energies within and beyond the frame, so the bound is measured (for
// random, clustered, equal and antiphase echoes), not proven for every set of echoes. Single-threaded. Allocates only
// for more echoes or a wider span of speeds than before. Same bits for every instruction set.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "echo_model.hpp"
#include "../frame/isa.hpp"
#include "speed_panels.hpp"
#include "spread_kernel.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar {

constexpr double kRounding = 1.5e-13;   // relative error of grids in double, with margin

struct SynthesisReport {
    std::size_t echoes = 0;    // with a weight above 0
    std::size_t dropped = 0;   // number of those that were left out
    double dropped_bound = 0.0;  // greatest share of ||x|| that the dropped ones can have
    double error_bound = 0.0;    // of everything, the dropped included; 0 for a direct sum
    int terms = 0;             // of the interpolation, summed over the panels
    int panels = 0;            // of speeds
    int width = 0;             // of the kernel; 0: no grid was used
    std::size_t direct = 0;    // echoes summed one by one
    int rounds = 0;            // 1 unless the echoes cancel
};

struct FreeAligned {
    std::size_t alignment = 64;
    void operator()(void *p) const;
};

class Synthesis {
public:
    // drop_share: share of the tolerance that may be used for leaving out the weakest echoes; 0: none is left out.
    Synthesis(const ChirpFigures &chirp, const ArrayFigures &array, double hp_cutoff_hz, double aaf_cutoff_hz,
              bool direct, double tolerance, double drop_share, frame::Isa isa);

    const EchoModel &model() const { return model_; }

    // Overwrites out [channels][chirps of the frame][samples]. A channel is a receiver; with complex samples there are two
    // for each receiver, the in-phase part before the quadrature part. Throws std::invalid_argument that names the first echo that is not
    // finite or exceeds the limits of echo_model.hpp.
    SynthesisReport synthesize(const EchoView &echoes, double *out);

private:
    template <class T>
    using Aligned = std::unique_ptr<T[], FreeAligned>;
    template <class T>
    static Aligned<T> aligned(std::size_t count);

    // Cells for the terms of one panel at a time; Real as in synthesis_kernels.hpp.
    template <class Real>
    struct Cells {
        Grid<Real> grid{};
        Aligned<Real> cells, work, by_chirp, factor;
        Aligned<double> emptied;
        std::vector<std::uint8_t> rows_used, columns_used, emptied_rows, additions;
        std::vector<Real> chirp_twiddle, sample_twiddle;
        int planes = 0, most_planes = 0;
        int planes_used = 0;  // number of planes that may not be zero
        void prepare(int rows, int columns, const EchoModel &model);
        void clear(int planes, double scale);
    };

    struct Plan {
        bool single;   // grids in single precision
        int width;
        double error;  // of the sum of squares of the weights
        PanelPlan panels;
    };

    void prepare_grid();
    SummingCost cost(int width, bool single) const;
    void plan(const EchoView &echoes, std::size_t count, const Weighing &weighing, double error, bool again, Plan &plan);
    void add(const EchoView &echoes, std::size_t count, const Weighing &weighing, double error, SynthesisReport &report);
    template <class Real>
    void add_panel(const EchoView &echoes, const SpeedPanel &panel, const std::int32_t *index, int width, double scale,
                   Cells<Real> &cells, const GridKernels<Real> &kernels);
    void add_direct(const EchoView &echoes, const std::int32_t *index, std::size_t count, SynthesisReport &report);
    // Moves the weakest echoes behind the others in index_. Returns their number; `sum` receives the sum of weights.
    std::size_t drop(std::size_t count, const Weighing &weighing, double &sum);
    void clear();
    struct Norms {
        double real, complex;  // of the frame; of its grids before their real part was taken
        double growth;         // of the errors, where the echoes cancel within the frame but not beyond it
    };
    struct Energies {
        double real[8] = {}, complex[8] = {};  // of every eighth sample
    };
    // Sums of the grid and of the direct method, as the chirps of the frame: one transmitter in each, or all.
    template <bool kComplex>
    void gather_turns(double *out, Energies &energies) const;
    template <bool kComplex>
    void gather_bands(double *out, Energies &energies) const;
    Norms gather(double *out) const;
    [[noreturn]] void refuse(const EchoView &echoes) const;

    EchoModel model_;
    const SynthesisKernels &kernels_;
    bool direct_;
    double tolerance_, drop_share_;
    bool complex_;
    double first_error_;
    int bands_;             // Doppler division; 0: time division
    double coherent_;       // greatest sum of the transmitters' errors in a sample, in root mean squares of one
    std::vector<double> band_phase_;  // cos, sin of j / bands_ cycles
    int groups_, wide_;
    RemainderSpread remainder_;

    std::vector<double> weight_squared_;
    std::vector<std::int32_t> index_, order_;
    std::vector<std::uint8_t> bin_;
    SpeedHistogram histogram_;
    bool histogram_made_ = false;
    Plan plan_, other_plan_;

    SpreadKernel kernel_[kMaxWidth + 1];
    double kernel_error_[kMaxWidth + 1];
    std::vector<double> chirp_scale_[kMaxWidth + 1], sample_scale_[kMaxWidth + 1];
    std::vector<double> chirp_outer_[kMaxWidth + 1], sample_outer_[kMaxWidth + 1];
    Growth growth_{};
    int rows_ = 0, columns_ = 0;  // of the grids
    Cells<double> one_term_;
    Cells<float> two_terms_;
    Aligned<double> grid_sum_, direct_sum_, quadrature_sum_;  // the last one with complex samples or bands
    bool grid_used_ = false, direct_used_ = false;
};

}  // namespace hil::sim::radar
