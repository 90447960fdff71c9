#include "lidar_receiver.hpp"

#include <cmath>

namespace hil::sim::frame {

HIL_BY_ISA(ReceiveKernel, receive_kernel_of, receive_of_isa)

ReceiveKernel receive_kernel(Isa isa) { return receive_kernel_of(isa); }

void lambert_strength(const std::int32_t *geom, const double *normal_W, const double *direction_W,
                      const double *reflectivity, std::size_t count, double *strength) {
    for (std::size_t i = 0; i < count; ++i) {
        const double *n = normal_W + 3 * i, *d = direction_W + 3 * i;
        const double cosine = std::fabs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]);
        strength[i] = geom[i] >= 0 ? reflectivity[geom[i]] * cosine : 0.0;
    }
}

}  // namespace hil::sim::frame
