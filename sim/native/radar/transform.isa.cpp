// Transform of one plane of a grid to samples: FFT along the chirps, FFT along the samples, remainder
// (synthesis_kernels.hpp).
#include "echo_lanes.hpp"
#include "synthesis_kernels.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

// Half a cell, 32 bytes: the real parts or the imaginary ones of its receivers and terms.
constexpr int kHalfBytes = kRegisterBytes < 32 ? kRegisterBytes : 32;
constexpr int kHalfParts = 32 / kHalfBytes;
template <class Real>
struct Half {
    typedef Real Register __attribute__((vector_size(kHalfBytes)));
    static constexpr int kCount = kHalfBytes / (int)sizeof(Real);
    Register r[kHalfParts];
};
#define HIL_HALF_BINARY(op)                                                        \
    template <class Real>                                                          \
    HIL_INLINE Half<Real> operator op(const Half<Real> &a, const Half<Real> &b) {  \
        Half<Real> v;                                                              \
        HIL_UNROLL for (int i = 0; i < kHalfParts; ++i) v.r[i] = a.r[i] op b.r[i]; \
        return v;                                                                  \
    }
HIL_HALF_BINARY(+)
HIL_HALF_BINARY(-)
HIL_HALF_BINARY(*)
#undef HIL_HALF_BINARY
template <class Real>
HIL_INLINE Half<Real> operator*(const Half<Real> &a, Real b) {
    Half<Real> v;
    HIL_UNROLL for (int i = 0; i < kHalfParts; ++i) v.r[i] = a.r[i] * b;
    return v;
}

template <class Real>
struct Cell {  // a complex number for each receiver and term
    Half<Real> re, im;
};
template <class Real>
HIL_INLINE Half<Real> half(const Real *from) {
    Half<Real> h;
    HIL_UNROLL for (int i = 0; i < kHalfParts; ++i) __builtin_memcpy(&h.r[i], from + i * h.kCount, sizeof h.r[i]);
    return h;
}
template <class Real>
HIL_INLINE void put(Real *to, const Half<Real> &h) {
    HIL_UNROLL for (int i = 0; i < kHalfParts; ++i) __builtin_memcpy(to + i * h.kCount, &h.r[i], sizeof h.r[i]);
}
template <class Real>
HIL_INLINE Cell<Real> cell(const Real *from) {
    return {half(from), half(from + kCell<Real> / 2)};
}
template <class Real>
HIL_INLINE void put(Real *to, const Cell<Real> &c) {
    put(to, c.re);
    put(to + kCell<Real> / 2, c.im);
}
template <class Real>
HIL_INLINE Cell<Real> operator+(const Cell<Real> &a, const Cell<Real> &b) {
    return {a.re + b.re, a.im + b.im};
}
template <class Real>
HIL_INLINE Cell<Real> operator-(const Cell<Real> &a, const Cell<Real> &b) {
    return {a.re - b.re, a.im - b.im};
}
template <class Real>
HIL_INLINE Cell<Real> turned(const Cell<Real> &a, const Real *cos_sin) {
    return {a.re * cos_sin[0] - a.im * cos_sin[1], a.re * cos_sin[1] + a.im * cos_sin[0]};
}

template <class Real>
HIL_INLINE double energy(const Real *from) {
    double sum = 0.0;
    for (int i = 0; i < kCell<Real>; ++i) sum = sum + (double)from[i] * (double)from[i];
    return sum;
}

// Adds the energy of outputs of a line within the frame and beyond it. `scale` is that of the first output, -count / 2.
template <class Real>
void add_growth(const Real *line, int size, int count, int outer, const double *scale, const double *outer_scale,
                double weight, int axis, Growth &growth) {
    const int half = count / 2;
    for (int i = 0; i < count; i += 4) {  // every fourth output is enough
        growth.within[axis] += energy(line + (long)kCell<Real> * ((i - half) & (size - 1))) * (scale[i] * scale[i] * weight);
    }
    for (int i = 0; i < outer; i += 4) {
        const double factor = outer_scale[i] * outer_scale[i] * weight;
        growth.beyond[axis] += energy(line + (long)kCell<Real> * (half + i)) * factor;
        growth.beyond[axis] += energy(line + (long)kCell<Real> * ((-half - i) & (size - 1))) * factor;
    }
}

// y_k = sum over l of x_l exp(2 pi i k l / size): radix 4, self-sorting (Stockham), one radix 2 at the end if the power
// is odd. Overwrites x and y; returns the one that holds the result.
template <class Real>
Real *fft(Real *x, Real *y, int size, const Real *twiddle) {
    int stride = 1;
    int left = size;
    for (; left >= 4; left /= 4, stride *= 4) {
        const int quarter = left / 4;
        for (int p = 0; p < quarter; ++p) {
            const Real *w1 = twiddle + 2 * p * stride, *w2 = twiddle + 4 * p * stride, *w3 = twiddle + 6 * p * stride;
            for (int q = 0; q < stride; ++q) {
                const Real *from = x + (long)kCell<Real> * (q + stride * p);
                const long step = (long)kCell<Real> * stride * quarter;
                const Cell<Real> a = cell(from), b = cell(from + step), c = cell(from + 2 * step), d = cell(from + 3 * step);
                const Cell<Real> sum_ac = a + c, ac = a - c, sum_bd = b + d, bd = b - d;
                const Cell<Real> first = {ac.re - bd.im, ac.im + bd.re}, third = {ac.re + bd.im, ac.im - bd.re};
                Real *to = y + (long)kCell<Real> * (q + stride * 4 * p);
                put(to, sum_ac + sum_bd);
                put(to + (long)kCell<Real> * stride, turned(first, w1));
                put(to + 2l * kCell<Real> * stride, turned(sum_ac - sum_bd, w2));
                put(to + 3l * kCell<Real> * stride, turned(third, w3));
            }
        }
        Real *swap = x;
        x = y;
        y = swap;
    }
    if (left == 2) {
        for (int q = 0; q < stride; ++q) {
            const Cell<Real> a = cell(x + (long)kCell<Real> * q), b = cell(x + (long)kCell<Real> * (q + stride));
            put(y + (long)kCell<Real> * q, a + b);
            put(y + (long)kCell<Real> * (q + stride), a - b);
        }
        return y;
    }
    return x;
}

// Adds the emptied sums back to the cells after the last echo.
void refill(const Grid<double> &, double *, int) {}
void refill(const Grid<float> &grid, float *plane, int width) {
    const double *emptied = grid.emptied + (plane - grid.cells);
    for (int r = 0; r < grid.rows + width; ++r) {
        if (!grid.emptied_rows[r]) continue;
        const long from = grid.row(r), to = from + (long)(grid.columns + width) * kCell<float>;
        for (long i = from; i < to; ++i) plane[i] = (float)((double)plane[i] + emptied[i]);
    }
}

// Adds the halo to the cells that it wraps to, and marks their rows and columns as used. The marks are the same for each
// plane of a grid.
template <class Real>
void fold(const Grid<Real> &grid, Real *plane, int width) {
    const int columns = grid.columns + width;
    for (int r = 0; r < width; ++r) {
        if (!grid.rows_used[grid.rows + r]) continue;
        grid.rows_used[r] = 1;
        Real *to = plane + grid.row(r), *from = plane + grid.row(grid.rows + r);
        for (long i = 0; i < (long)columns * kCell<Real>; i += kCell<Real>) put(to + i, cell(to + i) + cell(from + i));
    }
    for (int c = 0; c < width; ++c) {
        if (!grid.columns_used[grid.columns + c]) continue;
        grid.columns_used[c] = 1;
        for (int r = 0; r < grid.rows; ++r) {
            if (!grid.rows_used[r]) continue;
            Real *to = plane + grid.row(r) + (long)c * kCell<Real>;
            put(to, cell(to) + cell(to + (long)grid.columns * kCell<Real>));
        }
    }
}

HIL_INLINE void store_factor(double *to, const D &x) { store(to, x); }
HIL_INLINE void store_factor(float *to, const D &x) { store_single(to, x); }

// factor: cos and sin, times the scales, of the remainder at chirp m: samples in packs of eight, cos then sin. `offset`:
// of mu, its transmitter's delta_p included.
template <class Real>
void remainder_row(const EchoModel &model, double speed, int m, double offset, double chirp_scale,
                   const double *sample_scale, Real *factor) {
    const Remainder g = remainder_at(model, splat<D>(speed));
    const double mu = m - model.middle_chirp + offset;
    for (int n = 0; n < model.samples; n += D::kCount) {
        alignas(64) double lane[D::kCount], scale[D::kCount];
        for (int i = 0; i < D::kCount; ++i) {
            lane[i] = n + i - model.middle_sample + model.sample_offset;
            scale[i] = n + i < model.samples ? sample_scale[n + i] : 0.0;
        }
        const D nu = load<D>(lane), size = load<D>(scale) * chirp_scale;
        D c = splat<D>(1.0), s = splat<D>(0.0);
        if (speed != 0.0) turn((g.mixed * mu + g.sample * nu) * nu + g.chirp * (mu * mu), c, s);
        store_factor(factor + 2 * n, c * size);
        store_factor(factor + 2 * n + D::kCount, s * size);
    }
}

// Adds the cell times each term's factor, times `unscale`, to the sum in double. `unscale` may exceed the range of float.
HIL_INLINE void add_turned(const double *from, const double *factor, long, double, double *sum) {
    const Cell<double> value = cell(from);
    const double c = factor[0], d = factor[D::kCount];
    put(sum, cell<double>(sum) + Cell<double>{value.re * c - value.im * d, value.re * d + value.im * c});
}
HIL_INLINE void add_turned(const float *from, const float *factor, long next_term, double unscale, double *sum) {
    typedef double FourDoubles __attribute__((vector_size(32)));
    Four v[4];  // re of both terms, im of both
    __builtin_memcpy(v, from, sizeof v);
    const float c = factor[0], d = factor[D::kCount], e = factor[next_term], f = factor[next_term + D::kCount];
    const Four part[4] = {v[0] * c - v[2] * d, v[1] * e - v[3] * f, v[0] * d + v[2] * c, v[1] * f + v[3] * e};
    for (int i = 0; i < 2; ++i) {
        FourDoubles to;
        __builtin_memcpy(&to, sum + i * kGroup, sizeof to);
        to += (__builtin_convertvector(part[2 * i], FourDoubles) + __builtin_convertvector(part[2 * i + 1], FourDoubles)) * unscale;
        __builtin_memcpy(sum + i * kGroup, &to, sizeof to);
    }
}

// Copies the lines under a kernel; the others are set to zero.
template <class Real>
HIL_INLINE void gather_used(const Real *from, long step, int count, const std::uint8_t *used, Real *x) {
    const Cell<Real> none{};
    for (int i = 0; i < count; ++i) put(x + (long)kCell<Real> * i, used[i] ? cell(from + i * step) : none);
}

}  // namespace

template <class Real>
void transform(const EchoModel &model, const Grid<Real> &grid, int which, int width, const double *speed,
               const Transform<Real> &t) {
    Real *plane = grid.cells + which * grid.plane;
    refill(grid, plane, width);
    fold(grid, plane, width);
    Real *x = t.work, *y = t.work + (long)kCell<Real> * (grid.rows > grid.columns ? grid.rows : grid.columns);
    const double unscale = 1.0 / grid.scale, squared = unscale * unscale;
    const long line = (long)kCell<Real> * (grid.columns + 1);  // not a power of two, so that a column's cells are in different cache sets
    for (int c = 0; c < grid.columns; ++c) {
        if (!grid.columns_used[c]) continue;
        gather_used(plane + (long)c * kCell<Real>, grid.stride, grid.rows, grid.rows_used, x);
        const Real *found = fft(x, y, grid.rows, t.chirp_twiddle);
        if (c % 4 == 0) {
            add_growth(found, grid.rows, model.chirps, t.chirp_outer, t.chirp_scale, t.chirp_outer_scale, squared, 1,
                       *t.growth);
        }
        for (int m = 0; m < model.chirps; ++m) {
            const int at = (m - model.middle_chirp) & (grid.rows - 1);
            put(t.by_chirp + m * line + (long)c * kCell<Real>, cell<Real>(found + (long)kCell<Real> * at));
        }
    }
    const long next_term = 2l * ((model.samples + D::kCount - 1) / D::kCount * D::kCount);
    for (int m = 0; m < model.chirps; ++m) {
        gather_used(t.by_chirp + m * line, kCell<Real>, grid.columns, grid.columns_used, x);
        const Real *found = fft(x, y, grid.columns, t.sample_twiddle);
        if (m % 4 == 0) {
            add_growth(found, grid.columns, model.samples, t.sample_outer, t.sample_scale, t.sample_outer_scale,
                       t.chirp_scale[m] * t.chirp_scale[m] * squared, 0, *t.growth);
        }
        for (int k = 0; k < kTerms<Real>; ++k) {
            remainder_row(model, speed[k], m, model.chirp_offset + t.offset, t.chirp_scale[m], t.sample_scale, t.factor + k * next_term);
        }
        double *sum = t.sum + (long)m * model.samples * kChannel;
        for (int n = 0; n < model.samples; ++n, sum += kChannel) {
            const int at = (n - model.middle_sample) & (grid.columns - 1);
            const Real *factor = t.factor + 2 * (n & ~(D::kCount - 1)) + (n & (D::kCount - 1));
            add_turned(found + (long)kCell<Real> * at, factor, next_term, unscale, sum);
        }
    }
}

template void transform(const EchoModel &, const Grid<double> &, int, int, const double *, const Transform<double> &);
template void transform(const EchoModel &, const Grid<float> &, int, int, const double *, const Transform<float> &);

}  // namespace hil::sim::radar::HIL_ISA
