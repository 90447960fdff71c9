// Butterflies of the column transforms. See fft.hpp.
#include "fft.hpp"
#include "../frame/lane_memory.hpp"

namespace hil::sim::radar::HIL_ISA {

namespace {

// a, b -> a + w b, a - w b with w = c - j s.
HIL_INLINE void butterfly(double *__restrict ar, double *__restrict ai, double *__restrict br, double *__restrict bi,
                          int columns, double c, double s) {
    for (int i = 0; i < columns; ++i) {
        const double tr = c * br[i] + s * bi[i], ti = c * bi[i] - s * br[i];
        br[i] = ar[i] - tr;
        bi[i] = ai[i] - ti;
        ar[i] += tr;
        ai[i] += ti;
    }
}

// The same for w = 1.
HIL_INLINE void butterfly_of_one(double *__restrict ar, double *__restrict ai, double *__restrict br,
                                 double *__restrict bi, int columns) {
    for (int i = 0; i < columns; ++i) {
        const double tr = br[i], ti = bi[i];
        br[i] = ar[i] - tr;
        bi[i] = ai[i] - ti;
        ar[i] += tr;
        ai[i] += ti;
    }
}

void columns_of(double *re, double *im, int rows, int columns, int stride, const double *cosine, const double *sine) {
    for (int half = 1; half < rows; half *= 2) {
        const int step = rows / (2 * half);
        for (int first = 0; first < rows; first += 2 * half) {
            for (int j = 0; j < half; ++j) {
                const long a = (long)(first + j) * stride, b = a + (long)half * stride;
                if (j == 0) butterfly_of_one(re + a, im + a, re + b, im + b, columns);
                else butterfly(re + a, im + a, re + b, im + b, columns, cosine[j * step], sine[j * step]);
            }
        }
    }
}

}  // namespace

extern const FftKernels fft_kernels_of_isa;
const FftKernels fft_kernels_of_isa = {columns_of};

}  // namespace hil::sim::radar::HIL_ISA
