// Which instruction set the frame kernels use: the best that this CPU has, or one that a test asks for.
//
// Every set gives the same bits (docs/determinism.md), so the choice is about speed alone.
#pragma once

namespace hil::sim::frame {

enum class Isa { kBase, kAvx2, kAvx512 };

// Best of this CPU. HIL_ISA=base or avx2 in the environment lowers it.
Isa best_isa();
bool has_isa(Isa isa);
const char *isa_name(Isa isa);

}  // namespace hil::sim::frame
