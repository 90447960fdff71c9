#include "spread_kernel.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim::radar {
namespace {

constexpr int kOffsets = 32;  // offsets at which the kernel's transform is sampled: exact to its 32nd alias

double bessel_i0(double x) {
    const double q = 0.25 * x * x;
    double term = 1.0, sum = 1.0;
    for (int k = 1; term > 1e-18 * sum; ++k) {
        term *= q / (static_cast<double>(k) * k);
        sum += term;
    }
    return sum;
}

double kaiser_bessel(double z, int width, double b) {
    const double x = 2.0 * z / width;
    return x * x < 1.0 ? bessel_i0(b * std::sqrt(1.0 - x * x)) / bessel_i0(b) : 1.0 / bessel_i0(b);
}

double tap(const SpreadKernel &kernel, int i, double x) {
    const int w = kernel.width;
    const bool mirrored = i >= (w + 1) / 2;
    const double *c = kernel.coefficient[mirrored ? w - 1 - i : i];
    const double t = mirrored ? 1.0 - 2.0 * x : 2.0 * x - 1.0;
    double sum = c[w];
    for (int d = w - 1; d >= 0; --d) sum = sum * t + c[d];
    return sum;
}

struct Sample {
    double re, im;
};

// Sum over the taps at offset x of exp(2 pi i k z / size).
Sample transform_at(const SpreadKernel &kernel, int k, int size, double x) {
    Sample sum{0.0, 0.0};
    for (int i = 0; i < kernel.width; ++i) {
        const double z = i + x - 0.5 * kernel.width;
        const double angle = 2.0 * det::kPi * k * z / size, value = tap(kernel, i, x);
        sum.re += value * det::cos(angle);
        sum.im += value * det::sin(angle);
    }
    return sum;
}

double transform(const SpreadKernel &kernel, int k, int size) {
    double sum = 0.0;
    for (int p = 0; p < kOffsets; ++p) sum += transform_at(kernel, k, size, (p + 0.5) / kOffsets).re;
    return sum / kOffsets;
}

}  // namespace

SpreadKernel spread_kernel(int width, double oversampling) {
    SpreadKernel kernel{};
    kernel.width = width;
    const double b = (width < 5 ? 0.96 : 0.98) * det::kPi * width * (1.0 - 0.5 / oversampling);
    const int points = width + 1;
    for (int i = 0; i < (width + 1) / 2; ++i) {
        // Interpolation at Chebyshev nodes: coefficients of T_j, then conversion to powers.
        double chebyshev[kMaxWidth + 1] = {};
        for (int j = 0; j < points; ++j) {
            for (int p = 0; p < points; ++p) {
                const double angle = det::kPi * (p + 0.5) / points;
                const double z = i + 0.5 * (det::cos(angle) + 1.0) - 0.5 * width;
                chebyshev[j] += kaiser_bessel(z, width, b) * det::cos(j * angle) * (j == 0 ? 1.0 : 2.0) / points;
            }
        }
        double before[kMaxWidth + 1] = {1.0}, now[kMaxWidth + 1] = {0.0, 1.0};
        double *c = kernel.coefficient[i];
        c[0] = chebyshev[0];
        for (int j = 1; j < points; ++j) {
            double next[kMaxWidth + 1] = {};
            for (int d = 0; d <= j; ++d) {
                c[d] += chebyshev[j] * now[d];
                if (d + 1 < points) next[d + 1] += 2.0 * now[d];
            }
            for (int d = 0; d < j; ++d) next[d] -= before[d];
            for (int d = 0; d < points; ++d) {
                before[d] = now[d];
                now[d] = next[d];
            }
        }
    }
    // The middle tap of an odd width is its own mirror image.
    for (int d = 1; width % 2 == 1 && d <= width; d += 2) kernel.coefficient[width / 2][d] = 0.0;
    return kernel;
}

std::vector<double> spread_scale(const SpreadKernel &kernel, int first, int count, int size) {
    std::vector<double> scale(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) scale[static_cast<std::size_t>(i)] = 1.0 / transform(kernel, first + i, size);
    return scale;
}

double spread_error(const SpreadKernel &kernel, int count, int size) {
    constexpr int kOutputs = 17;  // in the upper half; the lower half is its mirror image
    double worst = 0.0;
    double scale[kOutputs];
    int index[kOutputs];
    for (int o = 0; o < kOutputs; ++o) {
        index[o] = count / 2 * o / (kOutputs - 1);
        scale[o] = 1.0 / transform(kernel, index[o], size);
    }
    for (int p = 0; p <= kOffsets; ++p) {
        double sum = 0.0;
        for (int o = 0; o < kOutputs; ++o) {
            const Sample at = transform_at(kernel, index[o], size, static_cast<double>(p) / kOffsets);
            const double re = at.re * scale[o] - 1.0, im = at.im * scale[o];
            sum += (re * re + im * im) * (o == 0 || o == kOutputs - 1 ? 0.5 : 1.0);
        }
        const double error = std::sqrt(sum / (kOutputs - 1));
        worst = error > worst ? error : worst;
    }
    return worst;
}

}  // namespace hil::sim::radar
