#include "../frame/lanes.hpp"
#include "receiver_noise.hpp"

namespace hil::sim::radar::HIL_ISA {
namespace {

using frame::HIL_ISA::D;
using frame::HIL_ISA::load;
using frame::HIL_ISA::splat;
using frame::HIL_ISA::store;

// Four packs: enough sums at once to hide the time an addition takes, few enough for the registers of SSE2.
constexpr int kPacks = 4;
constexpr std::size_t kBlock = kPacks * (std::size_t)D::kCount;

bool chirp(const ChirpTask &task) {
    for (std::size_t n = 0; n < task.padded; n += kBlock) {
        D sum[kPacks];
        for (int p = 0; p < kPacks; ++p) {
            const std::size_t at = n + (std::size_t)(p * D::kCount);
            sum[p] = load<D>(task.fixed + at) + task.offset;
            if (task.start != nullptr) sum[p] = sum[p] + load<D>(task.start + at) * task.decay;
        }
        if (task.colour_from != nullptr) {
            for (std::size_t j = 0; j < task.samples; ++j) {
                const D white = splat<D>((double)task.white[j]);
                const double *colour = task.colour_from + (n + task.samples - j);
                HIL_UNROLL for (int p = 0; p < kPacks; ++p) {
                    sum[p] = sum[p] + load<D>(colour + p * D::kCount) * white;
                }
            }
        }
        for (int p = 0; p < kPacks; ++p) store(task.work + n + (std::size_t)(p * D::kCount), sum[p]);
    }
    const double odd = task.converter.odd_width, even = 2.0 - odd, top = task.converter.top;
    bool finite = true;
    for (std::size_t n = 0; n < task.samples; ++n) {
        const double signal = task.signal[n];
        finite &= signal - signal == 0.0;
        double x = task.work[n] + signal;
        // Written so that a NaN is 0; what lies between 0 and the top is cut at the codes' own borders.
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

}  // namespace

extern const ReceiverKernel kReceiverKernel;
const ReceiverKernel kReceiverKernel{chirp};

}  // namespace hil::sim::radar::HIL_ISA
