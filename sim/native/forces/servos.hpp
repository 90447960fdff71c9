// Deflections of control surfaces: servos with limits, a rate limit and a lag. A force that has surfaces holds one
// Servos and passes its life cycle on; the deflections are own states of that force.
//
// Per surface (u the command, saturated to -1..1; d its deflection [rad]):
//   target   c = u d_max for u >= 0, -u d_min below         d_max at command +1, d_min at -1, of either sign
//            c = d_0 + the same                             for a servo whose neutral angle d_0 is not 0
//   motion   dd/dt = (c - d) / tau, limited to -r..r         r = 0 in the parameters: no limit
//
// Closed form for a constant target, with e = c - d at the start and s its sign:
//   t_1 = max(0, |e| / r - tau)                              d moves at the rate s r until t_1
//   d   = c - e_1 exp(-(t - t_1) / tau),  e_1 = e - s r t_1  from there
//
// d and its rate are continuous at t_1, the rate's slope is not: no step of the integrator may cross t_1. A tick ends a part
// there (corner_s). In a force without corners, longest_step() ends steps before t_1 and takes the shortest one across it.
//
// Limits of a step h: h <= 2 tau (not the classical method).
//
// Faults, from the next tick on: `stuck` runs to an angle and ignores the commands; `floating`, which no servo holds, is
// carried by the air to its neutral angle 0, without a rate limit; `lost` has no effect on the air (`effect` 0).
#pragma once

#include <cmath>
#include <vector>

#include "detmath.hpp"
#include "step_times.hpp"

namespace hil::sim {

inline constexpr int kMaxSurfaces = 16;  // of one force: the commands of a vehicle

struct ServoParams {
    double max_rad;  // deflection at command +1
    double min_rad;  // at command -1
    double rate_radps;  // 0: no limit
    double time_constant_s;
    double neutral_rad = 0.0;  // d_0, at command 0; max_rad and min_rad are then from there
};

enum class SurfaceState { kHealthy, kStuck, kFloating, kLost };

class Servos {
  public:
    Servos() = default;
    explicit Servos(const std::vector<ServoParams> &params) : count_(static_cast<int>(params.size())) {
        for (int i = 0; i < count_; ++i) p_[i] = params[static_cast<std::size_t>(i)];
        repair();
    }

    int count() const { return count_; }
    const ServoParams &params(int i) const { return p_[i]; }

    // Deflections of the last `at`, `at_contact` or `at_instant` [rad].
    const double *angle() const { return angle_; }
    // Rate at that angle [rad/s].
    double rate(int i) const {
        const double wanted = (target_[i] - angle_[i]) / p_[i].time_constant_s, most = p_[i].rate_radps;
        if (!limited(i)) return wanted;
        return wanted > most ? most : (wanted < -most ? -most : wanted);
    }
    // Share of the surface's effect on the air: 1, or 0 when it is lost.
    double effect(int i) const { return effect_[i]; }

    void set_state(int i, SurfaceState state, double stuck_rad) {
        state_[i] = state;
        stuck_rad_[i] = stuck_rad;
        effect_[i] = state == SurfaceState::kLost ? 0.0 : 1.0;
    }

    void repair() {
        for (int i = 0; i < count_; ++i) set_state(i, SurfaceState::kHealthy, 0.0);
    }

    void prepare(const StepTimes &times) {
        times_ = times;
        for (bool &filled : filled_) filled = false;
        lag_rate_per_s_ = 0.0;
        for (int i = 0; i < count_; ++i) {
            const double rate = 1.0 / (kLagsPerStep * p_[i].time_constant_s);
            if (rate > lag_rate_per_s_) lag_rate_per_s_ = rate;
        }
        last_node_ = times.nodes() - 1;
        for (int hard = 0; hard < kContactKinds; ++hard) {
            contact_s_[hard] = times.contact_s(hard);
            fill(contact_left_[hard], contact_s_[hard]);
        }
    }

    // Latches the commands. Returns -1, or the index of the first that is not finite.
    int command(const double *control) {
        for (int i = 0; i < count_; ++i) {
            if (!std::isfinite(control[i])) return i;
            const double u = control[i] < -1.0 ? -1.0 : (control[i] > 1.0 ? 1.0 : control[i]);
            target_[i] = u >= 0.0 ? u * p_[i].max_rad : -u * p_[i].min_rad;
            if (p_[i].neutral_rad != 0.0) target_[i] += p_[i].neutral_rad;
            if (state_[i] == SurfaceState::kStuck) target_[i] = stuck_rad_[i];
            if (state_[i] == SurfaceState::kFloating) target_[i] = 0.0;
        }
        return -1;
    }

    // Deflections at which the surfaces come to rest.
    void settle(double *own) const {
        for (int i = 0; i < count_; ++i) own[i] = target_[i];
    }

    double full_scale(int i) const {
        const double neutral = p_[i].neutral_rad;
        const double up = std::fabs(neutral + p_[i].max_rad), down = std::fabs(neutral + p_[i].min_rad);
        return up > down ? up : down;
    }

    void begin_tick(const double *own) {
        for (int i = 0; i < count_; ++i) start(i, own[i]);
    }
    void end_tick(double *own) const {
        for (int i = 0; i < count_; ++i) own[i] = target_[i] - gap_[i];
    }

    double step_rate_per_s(bool classical) const { return classical ? 0.0 : lag_rate_per_s_; }

    // First t_1 from these deflections on; 0: none is to come.
    double corner_s(const double *own) const {
        double first = 0.0;
        for (int i = 0; i < count_; ++i) {
            const double slow = limited_for_s(i, target_[i] - own[i]);
            if (slow > 0.0 && (!(first > 0.0) || slow < first)) first = slow;
        }
        return first;
    }

    double longest_step(double longest_s) const {
        for (int i = 0; i < count_; ++i) {
            if (kink_s_[i] > 0.0 && kink_s_[i] < longest_s) longest_s = kink_s_[i];
        }
        return longest_s;
    }

    void at(int level, int node, double t_s) {
        fill_level(level);
        for (int i = 0; i < count_; ++i) angle_[i] = target_[i] - gap_after(i, t_s, left_[level][node][i]);
    }

    void end_step(int level, double h_s) {
        fill_level(level);
        for (int i = 0; i < count_; ++i) {
            gap_[i] = gap_after(i, h_s, left_[level][last_node_][i]);
            kink_s_[i] = kink_s_[i] > h_s ? kink_s_[i] - h_s : 0.0;
        }
    }

    void at_contact(const double *own) {
        for (int i = 0; i < count_; ++i) angle_[i] = own[i];
    }
    void end_contact(double *own, bool hard) {
        for (int i = 0; i < count_; ++i) {
            start(i, own[i]);
            own[i] = target_[i] - gap_after(i, contact_s_[hard], contact_left_[hard][i]);
        }
    }
    void at_instant(const double *own) { at_contact(own); }

  private:
    static constexpr double kLagsPerStep = 2.0;

    double left_after(int i, double t_s) const { return det::exp(-t_s / p_[i].time_constant_s); }

    // e^(-t / tau) of all surfaces; those of one time constant share it.
    void fill(double *left, double t_s) const {
        for (int i = 0; i < count_; ++i) {
            const bool same = i > 0 && p_[i].time_constant_s == p_[i - 1].time_constant_s;
            left[i] = same ? left[i - 1] : left_after(i, t_s);
        }
    }
    // Few levels are ever used, and a tick in parts prepares anew for each.
    void fill_level(int level) {
        if (filled_[level]) return;
        filled_[level] = true;
        for (int n = 0; n <= last_node_; ++n) fill(left_[level][n], times_.node(n) * times_.step_s(level));
    }

    bool limited(int i) const { return p_[i].rate_radps > 0.0 && state_[i] != SurfaceState::kFloating; }

    // t_1 for the error e; 0 without a limit, or where it is past.
    double limited_for_s(int i, double gap) const {
        if (!limited(i)) return 0.0;
        const double slow = std::fabs(gap) / p_[i].rate_radps - p_[i].time_constant_s;
        return slow > 0.0 ? slow : 0.0;
    }

    void start(int i, double angle) {
        gap_[i] = target_[i] - angle;
        kink_s_[i] = limited_for_s(i, gap_[i]);
    }

    // e(t) for `left` = exp(-t / tau).
    double gap_after(int i, double t_s, double left) const {
        const double kink = kink_s_[i];
        if (!(kink > 0.0)) return gap_[i] * left;
        const double rate = gap_[i] > 0.0 ? p_[i].rate_radps : -p_[i].rate_radps;
        if (t_s <= kink) return gap_[i] - rate * t_s;
        return (gap_[i] - rate * kink) * left_after(i, t_s - kink);
    }

    int count_ = 0, last_node_ = 0;
    StepTimes times_{};
    bool filled_[kLevels] = {};
    ServoParams p_[kMaxSurfaces] = {};
    SurfaceState state_[kMaxSurfaces] = {};
    double stuck_rad_[kMaxSurfaces] = {}, effect_[kMaxSurfaces] = {};
    double left_[kLevels][StepTimes::kMaxNodes][kMaxSurfaces] = {}, contact_left_[kContactKinds][kMaxSurfaces] = {};
    double contact_s_[kContactKinds] = {}, lag_rate_per_s_ = 0.0;

    double target_[kMaxSurfaces] = {};
    double gap_[kMaxSurfaces] = {};     // e at the start of the step
    double kink_s_[kMaxSurfaces] = {};  // t_1 from the start of the step; 0: past
    double angle_[kMaxSurfaces] = {};
};

}  // namespace hil::sim
