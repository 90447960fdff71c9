// Choice of the instruction set of the frame kernels: the best of this CPU, or one that a test names.
//
// Every set gives the same bits (docs/determinism.md), so the choice affects speed only.
#pragma once

#include <string>

namespace hil::sim::frame {

enum class Isa { kBase, kAvx2, kAvx512 };

// Best of this CPU. HIL_ISA=base or avx2 in the environment lowers it.
Isa best_isa();
bool has_isa(Isa isa);
const char *isa_name(Isa isa);
// Set with this name; "" is the best of this CPU. Throws std::invalid_argument if it is unknown or this CPU lacks it.
Isa isa_by_name(const std::string &name);

}  // namespace hil::sim::frame

// Defines `const Type &function(Isa)`, which returns the `object` that the *.isa.cpp of that instruction set defines.
// For use within namespace hil::sim::frame.
#if defined(__x86_64__) || defined(_M_X64)
#define HIL_BY_ISA(Type, function, object)                     \
    namespace base { extern const Type object; }               \
    namespace avx2 { extern const Type object; }               \
    namespace avx512 { extern const Type object; }             \
    const Type &function(Isa isa) {                            \
        if (isa == Isa::kAvx512) return avx512::object;        \
        return isa == Isa::kAvx2 ? avx2::object : base::object; \
    }
#else
#define HIL_BY_ISA(Type, function, object)        \
    namespace base { extern const Type object; }  \
    const Type &function(Isa) { return base::object; }
#endif
