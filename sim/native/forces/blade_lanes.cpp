#include "blade_lanes.hpp"

#include "frame/isa.hpp"

namespace hil::sim {

using frame::Isa;
HIL_BY_ISA(BladeKernel, blade_kernel_of, blade_kernel)

const BladeKernel &blade_kernel() { return blade_kernel_of(frame::best_isa()); }

}  // namespace hil::sim
