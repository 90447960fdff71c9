#include "sweep_rays.hpp"

#include <cmath>

#include "detmath.hpp"

namespace hil::sim::frame {

HIL_BY_ISA(SweepKernel, sweep_kernel_of, sweep_rays_of_isa)

SweepKernel sweep_kernel(Isa isa) { return sweep_kernel_of(isa); }

void far_cos_and_sinc(double x2, double &cosine, double &sinc) {
    const double x = std::sqrt(x2);
    cosine = det::cos(x);
    sinc = det::sin(x) / x;
}

}  // namespace hil::sim::frame
