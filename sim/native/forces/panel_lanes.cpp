#include "panel_lanes.hpp"

#include "frame/isa.hpp"

namespace hil::sim {

using frame::Isa;
HIL_BY_ISA(PanelKernel, panel_kernel_of, panel_kernel)

const PanelKernel &panel_kernel() { return panel_kernel_of(frame::best_isa()); }

}  // namespace hil::sim
