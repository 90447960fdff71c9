#include "isa.hpp"

#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <stdexcept>

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#include <cpuid.h>
#endif

namespace hil::sim::frame {

bool has_isa(Isa isa) {
#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
    // __builtin_cpu_supports is not used: with some compilers (zig) its support library cannot be linked into a module.
    if (isa == Isa::kBase) return true;
    unsigned a = 0, b = 0, c = 0, d = 0, state = 0, high = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return false;
    __asm__("xgetbv" : "=a"(state), "=d"(high) : "c"(0));  // register sets that the operating system saves
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return false;
    const unsigned wanted = isa == Isa::kAvx2 ? bit_AVX2 : bit_AVX512F | bit_AVX512DQ | bit_AVX512BW | bit_AVX512VL;
    const unsigned kept = isa == Isa::kAvx2 ? 0x06u : 0xe6u;
    return (b & wanted) == wanted && (state & kept) == kept;
#else
    return isa == Isa::kBase;
#endif
}

Isa best_isa() {
    static const Isa best = [] {
        const char *limit = std::getenv("HIL_ISA");
        for (const Isa isa : {Isa::kAvx512, Isa::kAvx2}) {
            const bool above = limit != nullptr && (std::strcmp(limit, "base") == 0 ||
                                                    (std::strcmp(limit, "avx2") == 0 && isa == Isa::kAvx512));
            if (!above && has_isa(isa)) return isa;
        }
        return Isa::kBase;
    }();
    return best;
}

const char *isa_name(Isa isa) {
    switch (isa) {
        case Isa::kAvx512: return "avx512";
        case Isa::kAvx2: return "avx2";
        default: return "base";
    }
}

Isa isa_by_name(const std::string &name) {
    if (name.empty()) return best_isa();
    for (const Isa isa : {Isa::kBase, Isa::kAvx2, Isa::kAvx512}) {
        if (name != isa_name(isa)) continue;
        if (!has_isa(isa)) throw std::invalid_argument("this CPU has no " + name);
        return isa;
    }
    throw std::invalid_argument("unknown instruction set '" + name + "': base, avx2 or avx512");
}

}  // namespace hil::sim::frame
