// From a grid of one term to the samples: FFT along the chirps, FFT along the samples, remainder (synthesis_kernels.hpp).
#include "echo_lanes.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

// Four doubles: one part, real or imaginary, of the receivers of a cell.
constexpr int kQuadBytes = kRegisterBytes < 32 ? kRegisterBytes : 32;
constexpr int kQuadParts = 32 / kQuadBytes, kQuadLanes = kQuadBytes / 8;
typedef double QuadRegister __attribute__((vector_size(kQuadBytes)));
struct Quad {
    QuadRegister r[kQuadParts];
};
#define HIL_QUAD_BINARY(op)                                                 \
    HIL_INLINE Quad operator op(const Quad &a, const Quad &b) {             \
        Quad v;                                                             \
        HIL_UNROLL for (int i = 0; i < kQuadParts; ++i) v.r[i] = a.r[i] op b.r[i]; \
        return v;                                                           \
    }
HIL_QUAD_BINARY(+)
HIL_QUAD_BINARY(-)
#undef HIL_QUAD_BINARY
HIL_INLINE Quad operator*(const Quad &a, double b) {
    Quad v;
    HIL_UNROLL for (int i = 0; i < kQuadParts; ++i) v.r[i] = a.r[i] * b;
    return v;
}

struct Cell {  // a complex number for each receiver
    Quad re, im;
};
HIL_INLINE Cell cell(const double *from) {
    Cell c;
    HIL_UNROLL for (int i = 0; i < kQuadParts; ++i) {
        __builtin_memcpy(&c.re.r[i], from + i * kQuadLanes, sizeof c.re.r[i]);
        __builtin_memcpy(&c.im.r[i], from + kGroup + i * kQuadLanes, sizeof c.im.r[i]);
    }
    return c;
}
HIL_INLINE void put(double *to, const Cell &c) {
    HIL_UNROLL for (int i = 0; i < kQuadParts; ++i) {
        __builtin_memcpy(to + i * kQuadLanes, &c.re.r[i], sizeof c.re.r[i]);
        __builtin_memcpy(to + kGroup + i * kQuadLanes, &c.im.r[i], sizeof c.im.r[i]);
    }
}
HIL_INLINE Cell operator+(const Cell &a, const Cell &b) { return {a.re + b.re, a.im + b.im}; }
HIL_INLINE Cell operator-(const Cell &a, const Cell &b) { return {a.re - b.re, a.im - b.im}; }
HIL_INLINE Cell turned(const Cell &a, const double *cos_sin) {
    return {a.re * cos_sin[0] - a.im * cos_sin[1], a.re * cos_sin[1] + a.im * cos_sin[0]};
}

HIL_INLINE double energy(const double *from) {
    double sum = 0.0;
    for (int i = 0; i < kChannel; ++i) sum = sum + from[i] * from[i];
    return sum;
}

// Adds the energy of outputs of a line within the frame and beyond it. `scale` is that of the first output, -count / 2.
void add_growth(const double *line, int size, int count, int outer, const double *scale, const double *outer_scale,
                double weight, int axis, Growth &growth) {
    const int half = count / 2;
    for (int i = 0; i < count; i += 4) {  // a sample of them is enough
        growth.within[axis] += energy(line + (long)kChannel * ((i - half) & (size - 1))) * (scale[i] * scale[i] * weight);
    }
    for (int i = 0; i < outer; i += 4) {
        const double factor = outer_scale[i] * outer_scale[i] * weight;
        growth.beyond[axis] += energy(line + (long)kChannel * (half + i)) * factor;
        growth.beyond[axis] += energy(line + (long)kChannel * ((-half - i) & (size - 1))) * factor;
    }
}

// y_k = sum over l of x_l exp(2 pi i k l / size): radix 4, self-sorting (Stockham), one radix 2 at the end where the
// power is odd. x is destroyed; the result is in the one returned of x and y.
double *fft(double *x, double *y, int size, const double *twiddle) {
    int stride = 1;
    int left = size;
    for (; left >= 4; left /= 4, stride *= 4) {
        const int quarter = left / 4;
        for (int p = 0; p < quarter; ++p) {
            const double *w1 = twiddle + 2 * p * stride, *w2 = twiddle + 4 * p * stride, *w3 = twiddle + 6 * p * stride;
            for (int q = 0; q < stride; ++q) {
                const double *from = x + (long)kChannel * (q + stride * p);
                const long step = (long)kChannel * stride * quarter;
                const Cell a = cell(from), b = cell(from + step), c = cell(from + 2 * step), d = cell(from + 3 * step);
                const Cell sum_ac = a + c, ac = a - c, sum_bd = b + d, bd = b - d;
                const Cell first = {ac.re - bd.im, ac.im + bd.re}, third = {ac.re + bd.im, ac.im - bd.re};
                double *to = y + (long)kChannel * (q + stride * 4 * p);
                put(to, sum_ac + sum_bd);
                put(to + (long)kChannel * stride, turned(first, w1));
                put(to + 2l * kChannel * stride, turned(sum_ac - sum_bd, w2));
                put(to + 3l * kChannel * stride, turned(third, w3));
            }
        }
        double *swap = x;
        x = y;
        y = swap;
    }
    if (left == 2) {
        for (int q = 0; q < stride; ++q) {
            const Cell a = cell(x + (long)kChannel * q), b = cell(x + (long)kChannel * (q + stride));
            put(y + (long)kChannel * q, a + b);
            put(y + (long)kChannel * (q + stride), a - b);
        }
        return y;
    }
    return x;
}

// The halo back to where it belongs.
void fold(const Grid &grid, double *plane, int width) {
    const int columns = grid.columns + width;
    for (int r = 0; r < width; ++r) {
        double *to = plane + grid.row(r), *from = plane + grid.row(grid.rows + r);
        for (long i = 0; i < (long)columns * kChannel; i += kChannel) {
            put(to + i, cell(to + i) + cell(from + i));
        }
    }
    for (int r = 0; r < grid.rows; ++r) {
        double *row = plane + grid.row(r);
        for (long i = 0; i < (long)width * kChannel; i += kChannel) {
            const long beyond = (long)grid.columns * kChannel + i;
            put(row + i, cell(row + i) + cell(row + beyond));
        }
    }
}

// factor: cos and sin, times the scales, of the remainder at chirp m: samples in packs of eight, cos then sin.
void remainder_row(const EchoModel &model, double speed, int m, const Transform &t) {
    const Remainder g = remainder_at(model, splat<D>(speed));
    const double mu = m - model.middle_chirp + model.chirp_offset;
    for (int n = 0; n < model.samples; n += D::kCount) {
        alignas(64) double lane[D::kCount], scale[D::kCount];
        for (int i = 0; i < D::kCount; ++i) {
            lane[i] = n + i - model.middle_sample + model.sample_offset;
            scale[i] = n + i < model.samples ? t.sample_scale[n + i] : 0.0;
        }
        const D nu = load<D>(lane), size = load<D>(scale) * t.chirp_scale[m];
        D c = splat<D>(1.0), s = splat<D>(0.0);
        if (speed != 0.0) turn((g.mixed * mu + g.sample * nu) * nu + g.chirp * (mu * mu), c, s);
        store(t.factor + 2 * n, c * size);
        store(t.factor + 2 * n + D::kCount, s * size);
    }
}

}  // namespace

void transform(const EchoModel &model, const Grid &grid, int which, int width, double speed, const Transform &t) {
    double *plane = grid.cells + which * grid.plane;
    fold(grid, plane, width);
    double *x = t.work, *y = t.work + (long)kChannel * (grid.rows > grid.columns ? grid.rows : grid.columns);
    int since = width;  // columns since the last one in which a kernel began
    for (int c = grid.columns - width; c < grid.columns; ++c) since = grid.touched[c] ? 0 : since + 1;
    for (int c = 0; c < grid.columns; ++c) {
        since = grid.touched[c] ? 0 : since + 1;
        if (since >= width) continue;
        double *column = plane + (long)c * kChannel;
        for (int r = 0; r < grid.rows; ++r) put(x + (long)kChannel * r, cell(column + grid.row(r)));
        const double *found = fft(x, y, grid.rows, t.chirp_twiddle);
        if (c % 4 == 0) {
            add_growth(found, grid.rows, model.chirps, t.chirp_outer, t.chirp_scale, t.chirp_outer_scale, 1.0, 1,
                       *t.growth);
        }
        for (int m = 0; m < model.chirps; ++m) {
            const int at = (m - model.middle_chirp) & (grid.rows - 1);
            put(column + grid.row(m), cell(found + (long)kChannel * at));
        }
    }
    for (int m = 0; m < model.chirps; ++m) {
        double *row = plane + grid.row(m);
        for (long c = 0; c < grid.columns; ++c) put(x + kChannel * c, cell(row + kChannel * c));
        const double *found = fft(x, y, grid.columns, t.sample_twiddle);
        if (m % 4 == 0) {
            add_growth(found, grid.columns, model.samples, t.sample_outer, t.sample_scale, t.sample_outer_scale,
                       t.chirp_scale[m] * t.chirp_scale[m], 0, *t.growth);
        }
        remainder_row(model, speed, m, t);
        double *sum = t.sum + (long)m * model.samples * kChannel;
        for (int n = 0; n < model.samples; ++n, sum += kChannel) {
            const int at = (n - model.middle_sample) & (grid.columns - 1);
            const Cell value = cell(found + (long)kChannel * at);
            const double *factor = t.factor + 2 * (n & ~(D::kCount - 1)) + (n & (D::kCount - 1));
            const double c = factor[0], d = factor[D::kCount];
            const Cell more = {value.re * c - value.im * d, value.re * d + value.im * c};
            put(sum, cell(sum) + more);
        }
    }
}

}  // namespace hil::sim::radar::HIL_ISA
