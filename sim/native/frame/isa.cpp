#include "isa.hpp"

#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <stdexcept>

namespace hil::sim::frame {

bool has_isa(Isa isa) {
#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
    switch (isa) {
        case Isa::kBase: return true;
        case Isa::kAvx2: return __builtin_cpu_supports("avx2");
        case Isa::kAvx512:
            return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
    }
    return false;
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
