// Echoes onto the oversampled grid (synthesis_kernels.hpp). Tables of all three files of an instruction set end here.
#include "echo_lanes.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {

Weighing weigh(const EchoModel &, const EchoView &, double *);
std::size_t count_below(const double *, std::size_t, double);
void direct(const EchoModel &, const EchoView &, const std::int32_t *, std::size_t, int, double *);
template <class Real>
void transform(const EchoModel &, const Grid<Real> &, int, int, const double *, const Transform<Real> &);
extern template void transform(const EchoModel &, const Grid<double> &, int, int, const double *,
                               const Transform<double> &);
extern template void transform(const EchoModel &, const Grid<float> &, int, int, const double *,
                               const Transform<float> &);

namespace {

template <class Real>
struct alignas(64) BlockPlaces {
    Real tap[2][kMaxWidth][kBlock];     // kernel across chirps, across samples
    double term[kMaxNodes + 1][kBlock];  // L_k of each echo's speed; a last one of zeros fills up a cell
    Real weight[kBlock][kCell<Real>];
    std::int64_t start[2][kBlock];      // first row, first column
};

HIL_INLINE void store_as(double *to, const D &x) { store(to, x); }
HIL_INLINE void store_as(float *to, const D &x) {
    typedef float Half __attribute__((vector_size(kRegisterBytes / 2)));
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        const Half h = __builtin_convertvector(x.r[i], Half);
        __builtin_memcpy(to + i * (kRegisterBytes / 8), &h, sizeof h);
    }
}

// First grid point under the kernel and the taps' values, eight echoes at a time.
template <int kWidth, class Real>
HIL_INLINE void place(const SpreadKernel &kernel, const double *frequency, int size, int count, std::int64_t *start,
                      Real (*tap)[kBlock]) {
    for (int first = 0; first < count; first += D::kCount) {
        const D left = load<D>(frequency + first) * (double)size - 0.5 * kWidth;
        const D shifted = left + 0.5 + kNearest;  // up to a whole point; on one, either of the two will do
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
            store_as(tap[i] + first, even + odd);
            if (i != kWidth - 1 - i) store_as(tap[kWidth - 1 - i] + first, even - odd);
        }
    }
}

HIL_INLINE void lagrange(const SpeedNodes &nodes, const double *speed, int count, double (*term)[kBlock]) {
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

// Each echo's weight in the cells of the plane whose first term is `first_term`.
template <class Real>
HIL_INLINE void weigh_terms(const EchoBlock &block, int receivers, int first_term, double scale, int count,
                            BlockPlaces<Real> &places) {
    constexpr int kHalf = kGroup * kTerms<Real>;
    for (int k = 0; k < receivers; ++k) {
        for (int first = 0; first < count; first += D::kCount) {
            const D re = load<D>(block.re[k] + first) * scale, im = load<D>(block.im[k] + first) * scale;
            for (int t = 0; t < kTerms<Real>; ++t) {
                const D term = load<D>(places.term[first_term + t] + first);
                alignas(64) Real a[D::kCount], b[D::kCount];
                store_as(a, re * term);
                store_as(b, im * term);
                for (int e = 0; e < D::kCount; ++e) {
                    places.weight[first + e][t * kGroup + k] = a[e];
                    places.weight[first + e][kHalf + t * kGroup + k] = b[e];
                }
            }
        }
    }
}

// Register by register: GCC 12 takes an array of packs through memory in pieces of other sizes, ten times as slow.
template <class Real>
HIL_INLINE typename RegisterOf<Real>::Type load_register(const Real *from) {
    typename RegisterOf<Real>::Type v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}

// One echo's part of a register into the width x width cells under its kernel.
template <int kWidth, class Real>
HIL_INLINE void add_footprint(const typename RegisterOf<Real>::Type &weight, const BlockPlaces<Real> &places, int e,
                              Real *corner, long stride) {
    typename RegisterOf<Real>::Type across[kWidth];
#pragma GCC unroll 16
    for (int b = 0; b < kWidth; ++b) across[b] = weight * places.tap[1][b][e];
#pragma GCC unroll 1
    for (int a = 0; a < kWidth; ++a, corner += stride) {
        const Real down = places.tap[0][a][e];
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) {
            const auto sum = load_register<Real>(corner + b * kCell<Real>) + across[b] * down;
            __builtin_memcpy(corner + b * kCell<Real>, &sum, sizeof sum);
        }
    }
}

// The cells under a kernel that begins at (row, column), in every plane, into their doubles.
void empty(const Grid<float> &grid, int planes, long row, long column, int width) {
    for (long r = row; r < row + width; ++r) {
        for (int j = 0; j < planes; ++j) {
            const long line = j * grid.plane + r * grid.stride;
            double *to = grid.emptied + line;
            if (!grid.emptied_rows[r]) __builtin_memset(to, 0, (std::size_t)grid.stride * sizeof(double));
            float *from = grid.cells + line;
            for (long i = column * kCell<float>; i < (column + width) * kCell<float>; ++i) {
                to[i] += (double)from[i];
                from[i] = 0.0f;
            }
        }
        grid.emptied_rows[r] = 1;
    }
}
HIL_INLINE void count_addition(const Grid<double> &, int, long, long, int) {}
HIL_INLINE void count_addition(const Grid<float> &grid, int planes, long row, long column, int width) {
    std::uint8_t &additions = grid.additions[row * grid.columns + column];
    if (++additions < kMostAdditions) return;
    empty(grid, planes, row, column, width);
    additions = 0;
}

template <int kWidth, class Real>
void spread_width(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
                  int first_receiver, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
                  const Grid<Real> &grid) {
    constexpr int kReals = kRegisterBytes / (int)sizeof(Real);
    EchoBlock block;
    BlockPlaces<Real> places;
    const int receivers = model.receivers - first_receiver < kGroup ? model.receivers - first_receiver : kGroup;
    __builtin_memset(places.weight, 0, sizeof places.weight);
    for (int e = 0; e < kBlock; ++e) {
        places.term[0][e] = 1.0;
        places.term[nodes.count][e] = 0.0;
    }
    for (std::size_t from = 0; from < count; from += kBlock) {
        const int now = count - from < kBlock ? (int)(count - from) : kBlock;
        fill_block(model, echoes, index + from, now, first_receiver, block);
        place<kWidth>(kernel, block.alpha, grid.rows, now, places.start[0], places.tap[0]);
        place<kWidth>(kernel, block.beta, grid.columns, now, places.start[1], places.tap[1]);
        if (nodes.count > 1) lagrange(nodes, block.speed, now, places.term);
        for (int j = 0; j < planes; ++j) {
            weigh_terms(block, receivers, first_term + j * kTerms<Real>, grid.scale, now, places);
            Real *plane = grid.cells + j * grid.plane;
            for (int e = 0; e < now; ++e) {
                Real *corner = plane + places.start[0][e] * grid.stride + places.start[1][e] * kCell<Real>;
                for (int part = 0; part < kParts; ++part) {
                    add_footprint<kWidth>(load_register<Real>(places.weight[e] + part * kReals), places, e,
                                          corner + part * kReals, grid.stride);
                }
            }
        }
        for (int e = 0; e < now; ++e) {
            const long row = places.start[0][e], column = places.start[1][e];
            grid.touched[column] = 1;
            count_addition(grid, planes, row, column, kWidth);
        }
    }
}

template <class Real>
void spread(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
            int first_receiver, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
            const Grid<Real> &grid) {
#define HIL_WIDTH(w)                                                                                              \
    case w: spread_width<w>(model, echoes, index, count, first_receiver, kernel, nodes, first_term, planes, grid); \
        break;
    switch (kernel.width) {
        HIL_WIDTH(2) HIL_WIDTH(3) HIL_WIDTH(4) HIL_WIDTH(5) HIL_WIDTH(6) HIL_WIDTH(7) HIL_WIDTH(8) HIL_WIDTH(9)
        HIL_WIDTH(10) HIL_WIDTH(11) HIL_WIDTH(12) HIL_WIDTH(13) HIL_WIDTH(14) HIL_WIDTH(15) HIL_WIDTH(16)
    }
#undef HIL_WIDTH
}

}  // namespace

extern const SynthesisKernels synthesis_kernels_of_isa;
const SynthesisKernels synthesis_kernels_of_isa{weigh, count_below, direct, {spread<double>, transform<double>},
                                                {spread<float>, transform<float>}};

}  // namespace hil::sim::radar::HIL_ISA
