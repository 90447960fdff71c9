// Times at which an integrator looks at a body: known before the first tick, so that a force can prepare for them.
#pragma once

#include "dormand_prince.hpp"

namespace hil::sim {

inline constexpr int kLevels = 7;       // a tick has base * 2^level steps
inline constexpr int kContactKinds = 2; // ordinary, hard landing

struct StepTimes {
    double tick_s;
    int base;        // steps of a tick, before any halving
    bool classical;  // method of order 4, else of order 8
    int contact_substeps[kContactKinds];

    // Nodes of a step: the stages of order 8, or start, middle; then the end of the step.
    static constexpr int kMaxNodes = dp8::kStages + 1;
    int nodes() const { return classical ? 3 : kMaxNodes; }
    double node(int n) const {  // share of the step
        if (classical) return 0.5 * n;
        return n < dp8::kStages ? dp8::kC[n] : 1.0;
    }
    double step_s(int level) const { return tick_s / (base << level); }
    double contact_s(bool hard) const { return tick_s / contact_substeps[hard]; }
};

}  // namespace hil::sim
