// Dead time between the commands of a tick and what follows them: a speed controller's input filter, protocol and
// update period.
//
//   u_out(t) = u(t - D),   u(t) = u_k for t_k <= t < t_{k+1},   D = n T + r,  n whole ticks,  0 <= r < T
//
// In the tick from t_k the output is u_{k-n-1} until t_k + r and u_{k-n} from there: exact for every D, as the command is
// a step function. Before the first tick all commands are 0. A remainder below 1e-6 T counts as none.
//
// Deterministic. No allocation after construction.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace hil::sim {

class CommandDelay {
  public:
    CommandDelay() = default;

    // Delays the commands first .. first + count - 1 of `commands`; the others pass.
    CommandDelay(double dead_time_s, double tick_s, int commands, int first, int count)
        : commands_(commands), first_(first), count_(count) {
        const double ticks = dead_time_s / tick_s;
        double whole = std::floor(ticks), rest = ticks - whole;
        if (rest > 1.0 - kNone) {
            whole += 1.0;
            rest = 0.0;
        }
        change_s_ = rest < kNone ? 0.0 : rest * tick_s;
        rows_ = static_cast<std::size_t>(whole) + 2;
        on_ = count > 0 && (whole > 0.0 || change_s_ > 0.0);
        past_.assign(rows_ * static_cast<std::size_t>(commands), 0.0);
        out_[0].assign(static_cast<std::size_t>(commands), 0.0);
        out_[1] = out_[0];
    }

    bool on() const { return on_; }
    bool splits() const { return on_ && change_s_ > 0.0; }  // the output changes within a tick
    double change_s() const { return change_s_; }           // from the start of the tick

    void forget() { past_.assign(past_.size(), 0.0); }

    // Takes the commands of the coming tick. Returns -1, or the index of the first value that is not finite.
    int push(const double *controls) {
        for (int i = 0; i < commands_; ++i) {
            if (!std::isfinite(controls[i])) return i;
        }
        newest_ = newest_ == 0 ? rows_ - 1 : newest_ - 1;
        double *row = past_.data() + newest_ * static_cast<std::size_t>(commands_);
        for (int i = 0; i < commands_; ++i) row[i] = controls[i];
        for (int part = 0; part < 2; ++part) {
            const std::size_t age = splits() && part == 0 ? rows_ - 1 : rows_ - 2;
            const double *then = past_.data() + (newest_ + age) % rows_ * static_cast<std::size_t>(commands_);
            for (int i = 0; i < commands_; ++i) {
                out_[part][static_cast<std::size_t>(i)] = i >= first_ && i < first_ + count_ ? then[i] : controls[i];
            }
        }
        return -1;
    }

    const double *first() const { return out_[0].data(); }   // until change_s(), or for the whole tick
    const double *second() const { return out_[1].data(); }  // from there
    bool changes() const { return out_[0] != out_[1]; }

  private:
    static constexpr double kNone = 1e-6;
    int commands_ = 0, first_ = 0, count_ = 0;
    bool on_ = false;
    double change_s_ = 0.0;
    std::size_t rows_ = 0, newest_ = 0;
    std::vector<double> past_, out_[2];  // rows by age from `newest_`, cyclic
};

}  // namespace hil::sim
