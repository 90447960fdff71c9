// Spreading of echoes onto a grid of two terms in single precision (synthesis_kernels.hpp).
//
// A run is a sequence of echoes whose kernels begin in the same cell, such as those of neighbouring pixels. It is added
// in registers, in the order of the echoes, so the sums are the same as one by one.
#include "pair_block.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

constexpr int kPair = kTerms<float>;
constexpr int kReals = kRegisterBytes / (int)sizeof(float);
// Cells that are summed in registers at once; the other registers hold an echo's products.
constexpr int kCellsInRegisters = kRegisterBytes == 64 ? 25 : 10;

struct Run {
    int first, last;  // echoes of the block, the last exclusive
    int row, column;
};

// Empties the cells under a kernel that begins at (row, column), in every plane, into their doubles.
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

// Finds the runs of the block; cells that have no additions left for a run are emptied first.
template <int kWidth>
int find_runs(const Grid<float> &grid, int planes, int count, const PairBlock &block, Run *run) {
    static_assert(kBlock == 64);
    alignas(64) std::int32_t room[I::kCount + kBlock];
    std::int32_t *cell = room + I::kCount;
    cell[-1] = -1;
    for (int first = 0; first < kBlock; first += I::kCount) {
        store(cell + first, load<I>(block.start[0] + first) * (std::int32_t)grid.columns + load<I>(block.start[1] + first));
    }
    std::uint64_t begins = 0;  // bit per echo: it is in another cell than the previous one
    for (int first = 0; first < kBlock; first += I::kCount) {
        begins |= (std::uint64_t)bits(load<I>(cell + first) != load<I>(cell + first - 1)) << first;
    }
    if (count < kBlock) begins = (begins & (((std::uint64_t)1 << count) - 1)) | (std::uint64_t)1 << count;
    int runs = 0;
    for (int first = 0; first < count; first = run[runs++].last) {
        begins &= begins - 1;
        const int last = begins != 0 ? __builtin_ctzll(begins) : kBlock;
        const int row = block.start[0][first], column = block.start[1][first];
        run[runs] = {first, last, row, column};
        __builtin_memset(grid.rows_used + row, 1, kWidth);
        __builtin_memset(grid.columns_used + column, 1, kWidth);
        std::uint8_t &additions = grid.additions[cell[first]];
        if (additions + (last - first) > kMostAdditions) {
            empty(grid, planes, row, column, kWidth);
            additions = 0;
        }
        additions = (std::uint8_t)(additions + (last - first));
    }
    return runs;
}

// Writes each echo's weights in the cells of the plane whose first term is `first_term`.
HIL_NOINLINE void weigh_terms(const PairBlock &block, int first_term, int count, float (*weight)[kCell<float>]) {
    for (int e = 0; e < count; ++e) {
        for (int half = 0; half < 2; ++half) {
            Four w;
            __builtin_memcpy(&w, block.weight[e] + half * kGroup, sizeof w);
            for (int t = 0; t < kPair; ++t) {
                const Four product = w * block.term[first_term + t][e];
                __builtin_memcpy(weight[e] + (half * kPair + t) * kGroup, &product, sizeof product);
            }
        }
    }
}

typedef float CellRegister __attribute__((vector_size(kRegisterBytes), aligned(4), may_alias));

// Adds a run's part of a register to `kRows` lines of the cells under its kernel, from line `row` on.
template <int kWidth, int kRows>
HIL_INLINE void add_lines(const PairBlock &block, const Run &run, int row, const float (*weight)[kCell<float>], int part,
                          float *corner, long stride) {
    float *line[kRows];
    FloatRegister sum[kRows][kWidth];
#pragma GCC unroll 16
    for (int a = 0; a < kRows; ++a) {
        line[a] = corner + (row + a) * stride;
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) sum[a][b] = *(const CellRegister *)(line[a] + b * kCell<float>);
    }
#pragma GCC unroll 1
    for (int e = run.first; e < run.last; ++e) {
        const FloatRegister w = *(const CellRegister *)(weight[e] + part * kReals);
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) {
            const FloatRegister across = w * block.tap[1][b][e];
#pragma GCC unroll 16
            for (int a = 0; a < kRows; ++a) sum[a][b] = sum[a][b] + across * block.tap[0][row + a][e];
        }
    }
#pragma GCC unroll 16
    for (int a = 0; a < kRows; ++a) {
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) *(CellRegister *)(line[a] + b * kCell<float>) = sum[a][b];
    }
}

// Adds one echo's part of a register to the cells under its kernel.
template <int kWidth>
HIL_INLINE void add_echo(const PairBlock &block, int e, const float (*weight)[kCell<float>], int part, float *corner,
                         long stride) {
    const FloatRegister w = *(const CellRegister *)(weight[e] + part * kReals);
    FloatRegister across[kWidth];
#pragma GCC unroll 16
    for (int b = 0; b < kWidth; ++b) across[b] = w * block.tap[1][b][e];
#pragma GCC unroll 1
    for (int a = 0; a < kWidth; ++a, corner += stride) {
        const float down = block.tap[0][a][e];
#pragma GCC unroll 16
        for (int b = 0; b < kWidth; ++b) {
            CellRegister *cell = (CellRegister *)(corner + b * kCell<float>);
            *cell = *cell + across[b] * down;
        }
    }
}

template <int kWidth>
HIL_INLINE void add_run(const PairBlock &block, const Run &run, const float (*weight)[kCell<float>], float *plane,
                        long stride) {
    constexpr int kFit = kCellsInRegisters / kWidth;
    constexpr int kRows = kFit < 1 ? 1 : kFit < kWidth ? kFit : kWidth;
    float *corner = plane + run.row * stride + run.column * (long)kCell<float>;
    if (run.last - run.first == 1) {
        for (int part = 0; part < kParts; ++part) {
            add_echo<kWidth>(block, run.first, weight, part, corner + part * kReals, stride);
        }
        return;
    }
    for (int part = 0; part < kParts; ++part) {
        int row = 0;
#pragma GCC unroll 1
        for (; row + kRows <= kWidth; row += kRows) {
            add_lines<kWidth, kRows>(block, run, row, weight, part, corner + part * kReals, stride);
        }
        constexpr int kRest = kWidth % kRows;
        if constexpr (kRest > 0) {
            add_lines<kWidth, kRest>(block, run, row, weight, part, corner + part * kReals, stride);
        }
    }
}

// Not inlined: it does not depend on the width, and would be compiled once for every width.
HIL_NOINLINE void make_ready(const EchoModel &model, const EchoView &echoes, const std::int32_t *index,
                                          int count, int group, const SpeedNodes &nodes, int width,
                                          const Grid<float> &grid, PairBlock &block) {
    fill_phases(model, echoes, index, count, group, nodes, grid.scale, width, grid.rows, grid.columns, block);
    fill_weights(count, model.in_group[group], block);
    fill_terms(nodes, count, block);
}

template <int kWidth>
void spread_width(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
                  int group, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
                  const Grid<float> &grid) {
    PairBlock block;
    alignas(64) float weight[kBlock][kCell<float>];
    Run run[kBlock];
    __builtin_memset(&block, 0, sizeof block);  // whole packs are read, also if the last one is incomplete
    for (std::size_t from = 0; from < count; from += kBlock) {
        const int now = count - from < kBlock ? (int)(count - from) : kBlock;
        make_ready(model, echoes, index + from, now, group, nodes, kWidth, grid, block);
        fill_taps<kWidth>(kernel, block.offset[0], now, block.tap[0]);
        fill_taps<kWidth>(kernel, block.offset[1], now, block.tap[1]);
        const int runs = find_runs<kWidth>(grid, planes, now, block, run);
        for (int j = 0; j < planes; ++j) {
            weigh_terms(block, first_term + j * kPair, now, weight);
            for (int i = 0; i < runs; ++i) add_run<kWidth>(block, run[i], weight, grid.cells + j * grid.plane, grid.stride);
        }
    }
}

}  // namespace

void spread_pairs(const EchoModel &model, const EchoView &echoes, const std::int32_t *index, std::size_t count,
                  int group, const SpreadKernel &kernel, const SpeedNodes &nodes, int first_term, int planes,
                  const Grid<float> &grid) {
#define HIL_WIDTH(w)                                                                                              \
    case w: spread_width<w>(model, echoes, index, count, group, kernel, nodes, first_term, planes, grid); \
        break;
    switch (kernel.width) {
        HIL_WIDTH(2) HIL_WIDTH(3) HIL_WIDTH(4) HIL_WIDTH(5) HIL_WIDTH(6) HIL_WIDTH(7)
    }
#undef HIL_WIDTH
}

}  // namespace hil::sim::radar::HIL_ISA
