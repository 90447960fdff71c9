#include "synthesis.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

#ifdef __linux__
#include <sys/mman.h>
#endif

#include "detmath.hpp"

namespace hil::sim::radar {

using frame::Isa;
HIL_BY_ISA(SynthesisKernels, kernels_by_isa, synthesis_kernels_of_isa)
const SynthesisKernels &synthesis_kernels(Isa isa) { return kernels_by_isa(isa); }

namespace {

// Planned error / tolerance, so that most frames pass in the first round. Complex samples do not lose half of the power.
constexpr double kFirstError = 0.62, kFirstComplexError = 0.88;
constexpr double kLeastError = 2.0 * kRounding;  // smaller errors need the direct sum
constexpr int kMostRounds = 5;
constexpr double kGrown = 1.3;  // growth beyond / within the frame that counts
constexpr std::size_t kGridBytes = std::size_t{256} << 20;  // limit for all planes; with more, terms are computed in several passes
constexpr std::size_t kPage = std::size_t{2} << 20;
constexpr double kWorthDropping = 0.1;  // least share of the echoes that is worth dropping

int grid_size(int n) {
    int p = 32;  // wider than any kernel
    while (p < n) p *= 2;
    return p;
}

template <class Real>
std::vector<Real> twiddles(int size) {
    std::vector<Real> table;
    for (int j = 0; j < size; ++j) {
        const double angle = 2.0 * det::kPi * j / size;
        table.push_back(static_cast<Real>(det::cos(angle)));
        table.push_back(static_cast<Real>(det::sin(angle)));
    }
    return table;
}

}  // namespace

void FreeAligned::operator()(void *p) const { ::operator delete[](p, std::align_val_t{alignment}); }

// Large arrays are allocated in large pages if the system provides them: the cache set of each line of a grid is then
// the same in every process. With small pages it depends on which were free (up to twice the time).
template <class T>
Synthesis::Aligned<T> Synthesis::aligned(std::size_t count) {
    std::size_t bytes = count * sizeof(T), alignment = 64;
    if (bytes > kPage / 2) {
        alignment = kPage;
        bytes = (bytes + kPage - 1) / kPage * kPage;
    }
    void *p = ::operator new[](bytes, std::align_val_t{alignment});
#ifdef __linux__
    if (alignment == kPage) ::madvise(p, bytes, MADV_HUGEPAGE);  // if refused, small pages are used
#endif
    return Aligned<T>(static_cast<T *>(p), FreeAligned{alignment});
}

template <class Real>
void Synthesis::Cells<Real>::prepare(int rows, int columns, const EchoModel &model) {
    grid.rows = rows;
    grid.columns = columns;
    grid.stride = static_cast<long>(columns + kHalo) * kCell<Real>;
    // Five extra lines, so that the same cell of two planes is in different cache sets.
    grid.plane = grid.stride * (rows + kHalo) + 5 * kCell<Real>;
    const std::size_t each = sizeof(Real) + (kTerms<Real> > 1 ? sizeof(double) : 0);
    most_planes = std::clamp(static_cast<int>(kGridBytes / (static_cast<std::size_t>(grid.plane) * each)), 1, kMaxNodes);
    rows_used.resize(static_cast<std::size_t>(rows + kHalo));
    columns_used.resize(static_cast<std::size_t>(columns + kHalo));
    grid.rows_used = rows_used.data();
    grid.columns_used = columns_used.data();
    if constexpr (kTerms<Real> > 1) {
        emptied_rows.resize(static_cast<std::size_t>(rows + kHalo));
        grid.emptied_rows = emptied_rows.data();
        additions.resize(static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns));
        grid.additions = additions.data();
    }
    chirp_twiddle = twiddles<Real>(rows);
    sample_twiddle = twiddles<Real>(columns);
    work = aligned<Real>(2 * static_cast<std::size_t>(std::max(rows, columns)) * kCell<Real>);
    by_chirp = aligned<Real>(static_cast<std::size_t>(model.chirps) * static_cast<std::size_t>(columns + 1) * kCell<Real>);
    factor = aligned<Real>(2 * kTerms<Real> * static_cast<std::size_t>((model.samples + 7) / 8 * 8));
}

template <class Real>
void Synthesis::Cells<Real>::clear(int wanted, double scale) {
    if (wanted > planes) {
        planes = planes_used = 0;  // in case the allocation throws
        const auto count = static_cast<std::size_t>(wanted) * static_cast<std::size_t>(grid.plane);
        cells = aligned<Real>(count);
        grid.cells = cells.get();
        if constexpr (kTerms<Real> > 1) {
            emptied = aligned<double>(count);
            grid.emptied = emptied.get();
        }
        std::memset(cells.get(), 0, count * sizeof(Real));
        planes = wanted;
    }
    grid.scale = scale;
    for (int r = 0; r < grid.rows + kHalo; ++r) {
        if (!rows_used[static_cast<std::size_t>(r)]) continue;
        for (int c = 0; c < grid.columns + kHalo; ++c) {
            if (!columns_used[static_cast<std::size_t>(c)]) continue;
            for (int j = 0; j < planes_used; ++j) {
                std::memset(cells.get() + j * grid.plane + grid.row(r) + static_cast<long>(c) * kCell<Real>, 0,
                            kCell<Real> * sizeof(Real));
            }
        }
    }
    planes_used = wanted;
    std::fill(rows_used.begin(), rows_used.end(), std::uint8_t{0});
    std::fill(columns_used.begin(), columns_used.end(), std::uint8_t{0});
    std::fill(emptied_rows.begin(), emptied_rows.end(), std::uint8_t{0});
    std::fill(additions.begin(), additions.end(), std::uint8_t{0});
}

Synthesis::Synthesis(const ChirpFigures &chirp, const ArrayFigures &array, double hp_cutoff_hz, double aaf_cutoff_hz,
                     bool direct, double tolerance, double drop_share, Isa isa)
    : model_(echo_model(chirp, array, hp_cutoff_hz, aaf_cutoff_hz)),
      kernels_(synthesis_kernels(isa)),
      direct_(direct),
      tolerance_(tolerance),
      drop_share_(drop_share),
      complex_(array.complex_samples),
      first_error_(complex_ ? kFirstComplexError : kFirstError),
      bands_(array.doppler_bands),
      coherent_(bands_ > 0 ? std::sqrt(static_cast<double>(model_.transmitters)) : 1.0),
      band_phase_(bands_ > 0 ? twiddles<double>(bands_) : std::vector<double>()),
      groups_(model_.groups),
      wide_((model_.samples + 7) / 8 * 8),
      remainder_(model_) {
    const auto frame = static_cast<std::size_t>(groups_) * kGroup * static_cast<std::size_t>(model_.chirps);
    direct_sum_ = aligned<double>(frame * static_cast<std::size_t>(wide_));
    if (complex_ || bands_ > 0) quadrature_sum_ = aligned<double>(frame * static_cast<std::size_t>(wide_));
    if (!direct_) {
        grid_sum_ = aligned<double>(2 * frame * static_cast<std::size_t>(model_.samples));
        prepare_grid();
    }
}

void Synthesis::prepare_grid() {
    rows_ = grid_size(2 * model_.chirps);
    columns_ = grid_size(2 * model_.samples);
    one_term_.prepare(rows_, columns_, model_);
    two_terms_.prepare(rows_, columns_, model_);
    const double oversampling = std::min(static_cast<double>(rows_) / model_.chirps,
                                         static_cast<double>(columns_) / model_.samples);
    for (int w = kMinWidth; w <= kMaxWidth; ++w) {
        kernel_[w] = spread_kernel(w, oversampling);
        const double chirps = spread_error(kernel_[w], model_.chirps, rows_);
        const double samples = spread_error(kernel_[w], model_.samples, columns_);
        kernel_error_[w] = std::sqrt(chirps * chirps + samples * samples);
        const auto scales = [this, w](int count, int size, std::vector<double> &within, std::vector<double> &beyond) {
            within = spread_scale(kernel_[w], -(count / 2), count, size);
            const int edge = static_cast<int>(std::min(0.45 * size, 0.9 * count));
            beyond = spread_scale(kernel_[w], count / 2, edge - count / 2, size);
        };
        scales(model_.chirps, rows_, chirp_scale_[w], chirp_outer_[w]);
        scales(model_.samples, columns_, sample_scale_[w], sample_outer_[w]);
    }
}

void Synthesis::add_direct(const EchoView &echoes, const std::int32_t *index, std::size_t count, SynthesisReport &report) {
    if (!direct_used_) {
        const auto size = static_cast<std::size_t>(groups_ * kGroup * model_.chirps) * static_cast<std::size_t>(wide_);
        std::fill_n(direct_sum_.get(), size, 0.0);
        if (quadrature_sum_) std::fill_n(quadrature_sum_.get(), size, 0.0);
        direct_used_ = true;
    }
    const std::ptrdiff_t group = static_cast<std::ptrdiff_t>(kGroup) * model_.chirps * wide_;
    for (int g = 0; g < groups_; ++g) {
        kernels_.direct(model_, echoes, index, count, g, direct_sum_.get() + g * group,
                        quadrature_sum_ ? quadrature_sum_.get() + g * group : nullptr);
    }
    report.direct += count;
}

template <class Real>
void Synthesis::add_panel(const EchoView &echoes, const SpeedPanel &panel, const std::int32_t *index, int width,
                          double scale, Cells<Real> &cells, const GridKernels<Real> &kernels) {
    if (!grid_used_) {
        const auto size = static_cast<std::size_t>(groups_ * kChannel * model_.chirps) * static_cast<std::size_t>(model_.samples);
        std::fill_n(grid_sum_.get(), size, 0.0);
        grid_used_ = true;
    }
    const SpeedNodes nodes = speed_nodes(panel.nodes, panel.least, panel.greatest);
    const int needed = (panel.nodes + kTerms<Real> - 1) / kTerms<Real>, at_once = std::min(needed, cells.most_planes);
    const auto w = static_cast<std::size_t>(width);
    for (int g = 0; g < groups_; ++g) {
        const Transform<Real> transform{
            model_.group_offset[g],
            chirp_scale_[w].data(), sample_scale_[w].data(), cells.chirp_twiddle.data(), cells.sample_twiddle.data(),
            cells.work.get(), cells.by_chirp.get(), cells.factor.get(),
            grid_sum_.get() + static_cast<std::ptrdiff_t>(g) * kChannel * model_.chirps * model_.samples,
            chirp_outer_[w].data(), sample_outer_[w].data(), static_cast<int>(chirp_outer_[w].size()),
            static_cast<int>(sample_outer_[w].size()), &growth_};
        for (int first = 0; first < needed; first += at_once) {
            const int planes = std::min(at_once, needed - first);
            cells.clear(planes, scale);
            kernels.spread(model_, echoes, index, panel.count, g, kernel_[w], nodes, first * kTerms<Real>, planes,
                           cells.grid);
            for (int j = 0; j < planes; ++j) {
                double speed[kTerms<Real>];
                for (int k = 0; k < kTerms<Real>; ++k) {
                    const int term = (first + j) * kTerms<Real> + k;
                    speed[k] = term < panel.nodes ? nodes.speed(term) : 0.0;  // cells beyond the last term are zero
                }
                kernels.transform(model_, cells.grid, j, width, speed, transform);
            }
        }
    }
}

void Synthesis::add(const EchoView &echoes, std::size_t count, const Weighing &weighing, double error,
                    SynthesisReport &report) {
    plan(echoes, count, weighing, error, report.rounds > 1, plan_);
    report.width = plan_.width;
    const PanelPlan &panels = plan_.panels;
    const double scale = std::ldexp(1.0, -std::ilogb(std::sqrt(weighing.sum_squares)));
    const std::int32_t *index = index_.data();
    if (panels.count > 1) {  // sort the echoes by panel, keeping their order
        std::size_t next[kSpeedBins], first = 0;
        int panel_of_bin[kSpeedBins] = {};
        for (int p = 0; p < panels.count; ++p) {
            next[p] = first;
            first += panels.panel[p].count;
            for (int b = panels.panel[p].first_bin; b <= panels.panel[p].last_bin; ++b) panel_of_bin[b] = p;
        }
        for (std::size_t i = 0; i < count; ++i) order_[next[panel_of_bin[bin_[i]]]++] = index_[i];
        index = order_.data();
    }
    for (int p = 0; p < panels.count; index += panels.panel[p].count, ++p) {
        const SpeedPanel &panel = panels.panel[p];
        if (panel.nodes == 0) {
            add_direct(echoes, index, panel.count, report);
        } else {
            if (plan_.single) {
                add_panel(echoes, panel, index, plan_.width, scale, two_terms_, kernels_.two_terms);
            } else {
                add_panel(echoes, panel, index, plan_.width, 1.0, one_term_, kernels_.one_term);
            }
            report.terms += panel.nodes;
            report.panels += 1;
        }
    }
}

std::size_t Synthesis::drop(std::size_t count, const Weighing &weighing, double &sum) {
    sum = 0.0;
    // ||x|| is about sqrt(S M N K / 2), S the sum of squared weights, and the dropped ones are at most sum |w| sqrt(M N K).
    // With bands, the transmitters' shares of a sample may be in phase.
    const double allowed = first_error_ * drop_share_ * tolerance_ / coherent_ * std::sqrt(0.5 * weighing.sum_squares);
    const double limit = allowed * allowed;  // stronger echoes are never dropped
    const std::size_t candidates = kernels_.count_below(weight_squared_.data(), weight_squared_.size(), limit);
    if (static_cast<double>(candidates) < kWorthDropping * static_cast<double>(count)) return 0;
    // Histogram of squared weights in half octaves below the limit, weakest first.
    constexpr int kBins = 256;
    double total[kBins] = {};
    std::size_t number[kBins] = {};
    const auto bin = [limit](double square) {
        const double least = limit * 0x1p-128;
        if (square <= least) return 0;
        int exponent = 0;
        const double mantissa = std::frexp(square / least, &exponent);
        return std::min(2 * (exponent - 1) + (mantissa >= 0.75 ? 1 : 0), kBins - 1);
    };
    for (std::size_t i = 0; i < count; ++i) {
        const double square = weight_squared_[static_cast<std::size_t>(index_[i])];
        if (square >= limit) continue;
        const int b = bin(square);
        total[b] += std::sqrt(square);
        ++number[b];
    }
    int cut = 0;
    std::size_t dropped = 0;
    for (; cut < kBins && sum + total[cut] <= allowed; ++cut) {
        sum += total[cut];
        dropped += number[cut];
    }
    if (static_cast<double>(dropped) < kWorthDropping * static_cast<double>(count)) {
        sum = 0.0;
        return 0;
    }
    std::size_t kept = 0, gone = count - dropped;
    for (std::size_t i = 0; i < count; ++i) {
        const double square = weight_squared_[static_cast<std::size_t>(index_[i])];
        order_[square < limit && bin(square) < cut ? gone++ : kept++] = index_[i];
    }
    std::swap(index_, order_);
    return dropped;
}

void Synthesis::clear() {
    grid_used_ = direct_used_ = histogram_made_ = false;
    growth_ = {};
}

template <bool kComplex>
void Synthesis::gather_turns(double *out, Energies &energies) const {
    const auto chirps = static_cast<std::size_t>(model_.chirps), samples = static_cast<std::size_t>(model_.samples);
    const auto wide = static_cast<std::size_t>(wide_), turns = static_cast<std::size_t>(model_.transmitters);
    const auto groups = static_cast<std::size_t>(model_.groups_per_transmitter);
    const std::size_t channel = turns * chirps * samples;
    for (std::size_t k = 0; k < static_cast<std::size_t>(model_.receivers); ++k) {
        for (std::size_t p = 0; p < turns; ++p) {
            const std::size_t group = p * groups + k / kGroup, slot = group * kGroup + k % kGroup;
            const double *grid = grid_sum_.get() + group * kChannel * chirps * samples + k % kGroup;
            for (std::size_t m = 0; m < chirps; ++m) {
                const double *direct = direct_sum_.get() + (slot * chirps + m) * wide;
                const double *quadrature = kComplex ? quadrature_sum_.get() + (slot * chirps + m) * wide : nullptr;
                double *to = out + (kComplex ? 2 * k : k) * channel + (m * turns + p) * samples;
                for (std::size_t n = 0; n < samples; ++n) {
                    double sum = direct_used_ ? direct[n] : 0.0, turned = 0.0;
                    if constexpr (kComplex) turned = direct_used_ ? quadrature[n] : 0.0;
                    if (grid_used_) {
                        const double re = grid[(m * samples + n) * kChannel];
                        const double im = grid[(m * samples + n) * kChannel + kGroup];
                        energies.complex[n % 8] += re * re + im * im;
                        sum = re + sum;
                        if constexpr (kComplex) turned = im + turned;
                    }
                    to[n] = sum;
                    energies.real[n % 8] += sum * sum;
                    if constexpr (kComplex) {
                        to[channel + n] = turned;
                        energies.real[n % 8] += turned * turned;
                    }
                }
            }
        }
    }
}

template <bool kComplex>
void Synthesis::gather_bands(double *out, Energies &energies) const {
    const auto chirps = static_cast<std::size_t>(model_.chirps), samples = static_cast<std::size_t>(model_.samples);
    const auto wide = static_cast<std::size_t>(wide_), bands = static_cast<std::size_t>(bands_);
    const auto groups = static_cast<std::size_t>(model_.groups_per_transmitter);
    for (std::size_t k = 0; k < static_cast<std::size_t>(model_.receivers); ++k) {
        for (std::size_t m = 0; m < chirps; ++m) {
            double *to = out + ((kComplex ? 2 * k : k) * chirps + m) * samples;
            for (std::size_t n = 0; n < samples; ++n) {
                double sum = 0.0, turned = 0.0;
                for (std::size_t p = 0; p < static_cast<std::size_t>(model_.transmitters); ++p) {
                    const std::size_t group = p * groups + k / kGroup, slot = group * kGroup + k % kGroup;
                    double re = 0.0, im = 0.0;
                    if (grid_used_) {
                        const std::size_t cell = (group * chirps + m) * samples + n;
                        const double *grid = grid_sum_.get() + cell * kChannel + k % kGroup;
                        re = grid[0];
                        im = grid[kGroup];
                        energies.complex[n % 8] += re * re + im * im;
                    }
                    if (direct_used_) {
                        re += direct_sum_[(slot * chirps + m) * wide + n];
                        im += quadrature_sum_[(slot * chirps + m) * wide + n];
                    }
                    const std::size_t at = p * m % bands;
                    const double c = band_phase_[2 * at], s = band_phase_[2 * at + 1];
                    sum += re * c - im * s;
                    turned += re * s + im * c;
                }
                to[n] = sum;
                energies.real[n % 8] += sum * sum;
                if constexpr (kComplex) {
                    to[chirps * samples + n] = turned;
                    energies.real[n % 8] += turned * turned;
                }
            }
        }
    }
}

Synthesis::Norms Synthesis::gather(double *out) const {
    Energies energies;
    if (bands_ > 0) {
        complex_ ? gather_bands<true>(out, energies) : gather_bands<false>(out, energies);
    } else {
        complex_ ? gather_turns<true>(out, energies) : gather_turns<false>(out, energies);
    }
    Norms norms{0.0, 0.0, 1.0};
    for (int i = 0; i < 8; ++i) {
        norms.real += energies.real[i];
        norms.complex += energies.complex[i];
    }
    norms.real = std::sqrt(norms.real);
    norms.complex = std::sqrt(norms.complex);
    // Energy summed over the grids, because panels may cancel each other; from every fourth sample of every fourth chirp.
    const double share = static_cast<double>((model_.chirps + 3) / 4) * ((model_.samples + 3) / 4);
    const double apart = std::sqrt(growth_.within[0] / share * model_.chirps * model_.samples);
    norms.complex = std::max(norms.complex, apart);
    for (int axis = 0; axis < 2; ++axis) {
        // Mean square per output. "Beyond" is 1/2 to 0.9 frame lengths from the middle; outputs that alias are two
        // lengths away. A growth with a power of the distance is there about the square of the growth measured here.
        const int count = axis == 0 ? model_.samples : model_.chirps;
        const int outer = static_cast<int>((axis == 0 ? sample_outer_ : chirp_outer_)[kMinWidth].size());
        const double within = growth_.within[axis] / ((count + 3) / 4), beyond = growth_.beyond[axis] / (2 * ((outer + 3) / 4));
        if (beyond > kGrown * kGrown * within && within > 0.0) norms.growth *= beyond / within;
    }
    return norms;
}

void Synthesis::refuse(const EchoView &echoes) const {
    const auto within = [](double x, double least, double greatest) { return x >= least && x <= greatest; };
    const auto wrong = [](std::size_t i, const char *what, double value, const char *needs) {
        throw std::invalid_argument("echo " + std::to_string(i) + ": " + what + " is " + std::to_string(value) + ", " + needs);
    };
    for (std::size_t i = 0; i < echoes.count; ++i) {
        if (!within(echoes.range_m[i], 0.0, kMaxRange)) wrong(i, "range_m", echoes.range_m[i], "not in [0, 1e5]");
        if (!within(echoes.speed_mps[i], -kMaxSpeed, kMaxSpeed)) wrong(i, "speed_mps", echoes.speed_mps[i], "not in [-1000, 1000]");
        if (!within(echoes.amplitude[i], 0.0, kMaxAmplitude)) wrong(i, "amplitude", echoes.amplitude[i], "not in [0, 1e100]");
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double d = echoes.direction_R[3 * i + axis];
            if (!within(d, -1.0 - 1e-6, 1.0 + 1e-6)) wrong(i, "a component of direction_R", d, "not in [-1, 1]");
            if (echoes.out_direction_R == nullptr) continue;
            const double o = echoes.out_direction_R[3 * i + axis];
            if (!within(o, -1.0 - 1e-6, 1.0 + 1e-6)) wrong(i, "a component of out_direction_R", o, "not in [-1, 1]");
        }
    }
    throw std::logic_error("no invalid echo was found among echoes that were reported as invalid");
}

SynthesisReport Synthesis::synthesize(const EchoView &echoes, double *out) {
    SynthesisReport report;
    weight_squared_.resize(echoes.count);
    index_.resize(echoes.count);
    order_.resize(echoes.count);
    bin_.resize(echoes.count);
    const Weighing weighing = kernels_.weigh(model_, echoes, weight_squared_.data());
    if (!weighing.legal) refuse(echoes);
    std::size_t count = 0;
    for (std::size_t i = 0; i < echoes.count; ++i) {
        index_[count] = static_cast<std::int32_t>(i);
        count += weight_squared_[i] > 0.0;
    }
    report.echoes = count;
    clear();
    if (count == 0) {
        gather(out);
        return report;
    }
    if (direct_) {
        add_direct(echoes, index_.data(), count, report);
        gather(out);
        report.rounds = 1;
        return report;
    }

    // Of all transmitters: with bands several of them share a sample of the frame, and their errors may be in phase.
    const double samples = coherent_ * std::sqrt(static_cast<double>(model_.transmitters) * model_.receivers *
                                                 model_.chirps * model_.samples);
    const double expected = std::sqrt(0.5 * weighing.sum_squares) * samples;
    double dropped_sum = 0.0;
    std::size_t dropped = drop_share_ > 0.0 ? drop(count, weighing, dropped_sum) : 0;
    double error = first_error_ * tolerance_ / coherent_ * (dropped > 0 ? 1.0 - drop_share_ : 1.0);
    for (report.rounds = 1;; ++report.rounds) {
        report.terms = report.panels = 0;
        report.direct = 0;
        clear();
        const bool certain = error < kLeastError || report.rounds > kMostRounds;
        if (certain) {
            dropped = 0;
            report.width = 0;
            add_direct(echoes, index_.data(), count, report);
            gather(out);
            report.error_bound = 0.0;
            return report;
        }
        add(echoes, count - dropped, weighing, error, report);
        const Norms norms = gather(out);
        const double norm = norms.real, planned = plan_.error;
        const double missing = dropped > 0 ? dropped_sum * samples : 0.0;
        // Errors add up as the echoes do: if echoes are in phase, both sums are greater than expected. Taking the real
        // part halves the power of the sum, but not always that of the errors.
        const double scale = std::max(expected, coherent_ * norms.complex) * norms.growth;
        const double missed = planned * scale + missing;
        if (missed <= tolerance_ * norm || (planned == 0.0 && dropped == 0)) {
            report.dropped = dropped;
            report.dropped_bound = dropped > 0 ? missing / norm : 0.0;
            report.error_bound = planned > 0.0 ? missed / norm : report.dropped_bound;
            return report;
        }
        // The echoes cancel more than expected: repeat without dropping, with a smaller planned error.
        dropped = 0;
        error = std::min(error, 0.9 * tolerance_ * norm / scale);
    }
}

}  // namespace hil::sim::radar
