#include "fft.hpp"

#include "detmath.hpp"

namespace hil::sim::radar {

using frame::Isa;
HIL_BY_ISA(FftKernels, fft_kernels, fft_kernels_of_isa)

FftTable::FftTable(int count) : rows(count), cosine(count / 2), sine(count / 2), place(count) {
    for (int j = 0; j < rows / 2; ++j) {
        cosine[j] = det::cos(2.0 * det::kPi * j / rows);
        sine[j] = det::sin(2.0 * det::kPi * j / rows);
    }
    for (int n = 0; n < rows; ++n) {
        int reversed = 0;
        for (int bit = 1, from = n; bit < rows; bit *= 2, from /= 2) reversed = 2 * reversed + from % 2;
        place[n] = reversed;
    }
}

int power_of_two_from(int n) {
    int power = 1;
    while (power < n) power *= 2;
    return power;
}

}  // namespace hil::sim::radar
