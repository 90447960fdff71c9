#include "picture_values.hpp"

#include "isa.hpp"

namespace hil::sim::frame {

HIL_BY_ISA(PictureValueKernels, picture_value_kernels, kPictureValueKernels)


void depth_values(const float *depth_m, double steps_per_m, std::size_t n, std::uint16_t *out) {
    picture_value_kernels(best_isa()).depth(depth_m, steps_per_m, n, out);
}

void normal_values(const float *normal, std::size_t n, std::uint8_t *out) {
    picture_value_kernels(best_isa()).normal(normal, n, out);
}

}  // namespace hil::sim::frame
