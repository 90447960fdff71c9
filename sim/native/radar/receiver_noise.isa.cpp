#include "../frame/lane_memory.hpp"
#include "receiver_noise.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

using frame::HIL_ISA::DoubleRegister;

constexpr std::size_t kWide = sizeof(DoubleRegister) / sizeof(double);
// Enough parallel sums to hide the latency of an addition, in half of the registers of SSE2 and AVX2. Pack<double> of
// lanes.hpp is not used: compilers keep an array of packs in memory.
constexpr std::size_t kSums = 8;
constexpr std::size_t kBlock = kSums * kWide;
#define HIL_EACH_SUM _Pragma("GCC unroll 8") for (std::size_t i = 0; i < kSums; ++i)

HIL_INLINE DoubleRegister load(const double *p) {
    DoubleRegister v;
    __builtin_memcpy(&v, p, sizeof v);
    return v;
}

bool chirp(const ChirpTask &task) {
    for (std::size_t n = 0; n < task.padded; n += kBlock) {
        DoubleRegister noise[kSums];
        HIL_EACH_SUM noise[i] = DoubleRegister{};
        if (task.colour_from != nullptr) {
            for (std::size_t j = 0; j < task.samples; ++j) {
                const double white = (double)task.white[j];
                const double *colour = task.colour_from + (n + task.samples - j);
                HIL_EACH_SUM noise[i] = noise[i] + load(colour + i * kWide) * white;
            }
            HIL_EACH_SUM noise[i] = load(task.envelope + n + i * kWide) * noise[i];
        }
        HIL_EACH_SUM {
            const std::size_t at = n + i * kWide;
            DoubleRegister x = load(task.fixed + at) + task.offset;
            if (task.start != nullptr) x = x + load(task.start + at) * task.decay;
            x = x + noise[i];
            __builtin_memcpy(task.work + at, &x, sizeof x);
        }
    }
    if (task.white_sigma > 0.0) {
        for (std::size_t n = 0; n < task.samples; ++n) {
            task.work[n] = task.work[n] + task.envelope[n] * (task.white_sigma * (double)task.white[n]);
        }
    }
    const double odd = task.converter.odd_width, even = 2.0 - odd, top = task.converter.top;
    bool finite = true;
    for (std::size_t n = 0; n < task.samples; ++n) {
        const double signal = task.signal[n];
        finite &= signal - signal == 0.0;
        double x = task.work[n] + signal;
        // Clip to [0, top], with NaN as 0. Between them, values are quantised at the borders of the codes.
        x = x > 0.0 ? x : 0.0;
        x = x < top ? x : top;
        const double shifted = x + 0.5 * even;
        const std::int32_t pair = (std::int32_t)(0.5 * shifted);
        const double within = shifted - (double)(2 * pair);
        const std::int32_t code = 2 * pair + (within >= even ? 1 : 0);
        task.out[n] = (std::uint16_t)(code < (std::int32_t)top ? code : (std::int32_t)top);
    }
    return finite;
}

#undef HIL_EACH_SUM

}  // namespace

extern const ReceiverKernel kReceiverKernel;
const ReceiverKernel kReceiverKernel{chirp};

}  // namespace hil::sim::radar::HIL_ISA
