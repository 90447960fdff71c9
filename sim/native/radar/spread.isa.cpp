// Spreading of echoes onto a grid of one term in double, and the table of all kernels of an instruction set
// (synthesis_kernels.hpp).
#include "echo_lanes.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {

Weighing weigh(const EchoModel &, const EchoView &, double *);
std::size_t count_below(const double *, std::size_t, double);
void direct(const EchoModel &, const EchoView &, const std::int32_t *, std::size_t, int, double *, double *);
template <class Real>
void transform(const EchoModel &, const Grid<Real> &, int, int, const double *, const Transform<Real> &);
extern template void transform(const EchoModel &, const Grid<double> &, int, int, const double *,
                               const Transform<double> &);
extern template void transform(const EchoModel &, const Grid<float> &, int, int, const double *,
                               const Transform<float> &);
void spread_pairs(const EchoModel &, const EchoView &, const std::int32_t *, std::size_t, int, const SpreadKernel &,
                  const SpeedNodes &, int, int, const Grid<float> &);

namespace {

struct alignas(64) BlockPlaces {
    double tap[2][kMaxWidth][kBlock];  // kernel across chirps, across samples
    double term[kMaxNodes][kBlock];    // L_k of each echo's speed
    double weight[kBlock][kCell<double>];
    std::int64_t start[2][kBlock];     // first row, first column
};

// Writes the first grid point under the kernel and the values of the taps, eight echoes at a time.
template <int kWidth>
HIL_INLINE void place(const SpreadKernel &kernel, const double *frequency, int size, int count, std::int64_t *start,
                      double (*tap)[kBlock]) {
    for (int first = 0; first < count; first += D::kCount) {
        const D left = load<D>(frequency + first) * (double)size - 0.5 * kWidth;
        const D shifted = left + 0.5 + kNearest;  // rounded up to a grid point; on one, either neighbour will do
        const D point = shifted - kNearest;
        store(start + first, as<L>(shifted) & splat<L>((std::int64_t)size - 1));
        const D t = (point - left) * 2.0 - 1.0;
        const D t2 = t * t;
#pragma GCC unroll 8
        for (int i = 0; i < (kWidth + 1) / 2; ++i) {
            const double *c = kernel.coefficient[i];
            constexpr int kEven = kWidth / 2 * 2, kOdd = (kWidth - 1) / 2 * 2 + 1;
            D even = splat<D>(c[kEven]), odd = splat<D>(c[kOdd]);
            for (int d = kEven - 2; d >= 0; d -= 2) even = even * t2 + c[d];
            for (int d = kOdd - 2; d >= 1; d -= 2) odd = odd * t2 + c[d];
            odd = odd * t;
            store(tap[i] + first, even + odd);
            if (i != kWidth - 1 - i) store(tap[kWidth - 1 - i] + first, even - odd);
        }
    }
}

HIL_NOINLINE void lagrange(const SpeedNodes &nodes, const double *speed, int count, double (*term)[kBlock]) {
    const double shrink = nodes.half_span > 0.0 ? 1.0 / nodes.half_span : 0.0;
    for (int first = 0; first < count; first += D::kCount) {
        const D s = (load<D>(speed + first) - nodes.middle) * shrink;
        D before = splat<D>(1.0);
        for (int k = 0; k < nodes.count; ++k) {
            store(term[k] + first, before * nodes.scale[k]);
            before = before * (s - nodes.node[k]);
        }
        D after = splat<D>(1.0);
        for (int k = nodes.count - 1; k >= 0; --k) {
            store(term[k] + first, load<D>(term[k] + first) * after);
            after = after * (s - nodes.node[k]);
        }
    }
}

// Writes each echo's weight in the cells of a term's plane.
HIL_NOINLINE void weigh_term(const EchoBlock &block, int receivers, int term, int count, BlockPlaces &places) {
    for (int k = 0; k < receivers; ++k) {
        for (int first = 0; first < count; first += D::kCount) {
            const D share = load<D>(places.term[term] + first);
            alignas(64) double re[D::kCount], im[D::kCount];
            store(re, load<D>(block.re[k] + first) * share);
            store(im, load<D>(block.im[k] + first) * share);
            for (int e = 0; e < D::kCount; ++e) {
                places.weight[first + e][k] = re[e];
                places.weight[first + e][kGroup + k] = im[e];
            }
        }
    }
}

// Register by register: GCC 12 copies an array of packs through memory in pieces of other sizes, ten times slower.
HIL_INLINE DoubleRegister load_register(const double *from) {
    DoubleRegister v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}

// Adds one echo's part of a register to the width x width cells under its kernel.
template <int kWidth>
HIL_INLINE void add_footprint(const DoubleRegister &weight, const BlockPlaces &places, int e,
                              double *corner, long stride) {
    DoubleRegister across[kWidth];
#pragma GCC unroll 16
    for (int b = 0; b < kWidth; ++b) across[b] = weight * places.tap[1][b][e];
#pragma GCC unroll 1
    for (int a = 0; a < kWidth; ++a, corner += stride) {
        const double down = places.tap[0][a][e];
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) {
            const auto sum = load_register(corner + b * kCell<double>) + across[b] * down;
            __builtin_memcpy(corner + b * kCell<double>, &sum, sizeof sum);
        }
    }
}

// Not inlined: it does not depend on the width, and would be compiled once for every width.
HIL_NOINLINE void make_ready(const EchoModel &model, const EchoView &echoes, const std::int32_t *index,
                                          int count, int group, const SpeedNodes &nodes, EchoBlock &block,
                                          BlockPlaces &places) {
    fill_block(model, echoes, index, count, group, block);
    if (nodes.count > 1) lagrange(nodes, block.speed, count, places.term);
}

template <int kWidth>
void spread_width(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
                  int group, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
                  const Grid<double> &grid) {
    constexpr int kReals = kRegisterBytes / (int)sizeof(double);
    EchoBlock block;
    BlockPlaces places;
    const int receivers = model.in_group[group];
    __builtin_memset(places.weight, 0, sizeof places.weight);
    for (int e = 0; e < kBlock; ++e) places.term[0][e] = 1.0;
    for (std::size_t from = 0; from < count; from += kBlock) {
        const int now = count - from < kBlock ? (int)(count - from) : kBlock;
        make_ready(model, echoes, index + from, now, group, nodes, block, places);
        place<kWidth>(kernel, block.alpha, grid.rows, now, places.start[0], places.tap[0]);
        place<kWidth>(kernel, block.beta, grid.columns, now, places.start[1], places.tap[1]);
        for (int j = 0; j < planes; ++j) {
            weigh_term(block, receivers, first_term + j, now, places);
            double *plane = grid.cells + j * grid.plane;
            for (int e = 0; e < now; ++e) {
                double *corner = plane + places.start[0][e] * grid.stride + places.start[1][e] * kCell<double>;
                for (int part = 0; part < kParts; ++part) {
                    add_footprint<kWidth>(load_register(places.weight[e] + part * kReals), places, e,
                                          corner + part * kReals, grid.stride);
                }
            }
        }
        for (int e = 0; e < now; ++e) {
            __builtin_memset(grid.rows_used + places.start[0][e], 1, kWidth);
            __builtin_memset(grid.columns_used + places.start[1][e], 1, kWidth);
        }
    }
}

void spread(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
            int group, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
            const Grid<double> &grid) {
#define HIL_WIDTH(w)                                                                                              \
    case w: spread_width<w>(model, echoes, index, count, group, kernel, nodes, first_term, planes, grid); \
        break;
    switch (kernel.width) {
        HIL_WIDTH(5) HIL_WIDTH(6) HIL_WIDTH(7) HIL_WIDTH(8) HIL_WIDTH(9) HIL_WIDTH(10)
        HIL_WIDTH(11) HIL_WIDTH(12) HIL_WIDTH(13) HIL_WIDTH(14) HIL_WIDTH(15) HIL_WIDTH(16)
    }
#undef HIL_WIDTH
}

}  // namespace

extern const SynthesisKernels synthesis_kernels_of_isa;
const SynthesisKernels synthesis_kernels_of_isa{weigh, count_below, direct, {spread, transform<double>},
                                                {spread_pairs, transform<float>}};

}  // namespace hil::sim::radar::HIL_ISA
