// Which instruction set the frame kernels use: the best that this CPU has, or one that a test asks for.
//
// Every set gives the same bits (docs/determinism.md), so the choice is about speed alone.
#pragma once

#include <string>

namespace hil::sim::frame {

enum class Isa { kBase, kAvx2, kAvx512 };

// Best of this CPU. HIL_ISA=base or avx2 in the environment lowers it.
Isa best_isa();
bool has_isa(Isa isa);
const char *isa_name(Isa isa);
// "" is the best of this CPU. std::invalid_argument for a name that is none, or that this CPU has not.
Isa isa_by_name(const std::string &name);

}  // namespace hil::sim::frame

// Defines `const Type &function(Isa)`: what each instruction set's *.isa.cpp defines under the name `object`. For use
// within namespace hil::sim::frame.
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
