#include "scatterers.hpp"

namespace hil::sim::radar {

using frame::Isa;

HIL_BY_ISA(ScatterKernels, scatter_kernels, scatter_kernels_of_isa)

}  // namespace hil::sim::radar
