// A force with control surfaces: their commands, deflections and faults. A kind adds its equation (`add`) and its limits.
#pragma once

#include <vector>

#include "force.hpp"
#include "servos.hpp"

namespace hil::sim {

class SurfacedForce : public Force {
  public:
    explicit SurfacedForce(const std::vector<ServoParams> &surfaces) : servos_(surfaces) {}

    // State of a surface from the next tick on; `stuck_rad` is read when it is stuck.
    void set_surface(int surface, SurfaceState state, double stuck_rad) { servos_.set_state(surface, state, stuck_rad); }

    int commands() const override { return servos_.count(); }
    bool is_signed(int) const override { return true; }
    int states() const override { return servos_.count(); }
    void prepare(const StepTimes &times, const Inertia &) override { servos_.prepare(times); }
    int command(const double *control, double) override { return servos_.command(control); }
    void settle(double *own) const override { servos_.settle(own); }
    void begin_tick(const double *own) override { servos_.begin_tick(own); }
    void end_tick(double *own) override { servos_.end_tick(own); }
    double step_rate_per_s(bool classical) const override { return servos_.step_rate_per_s(classical); }
    double corner_s(const double *own) const override { return servos_.corner_s(own); }
    void at(int level, int node, double t_s) override { servos_.at(level, node, t_s); }
    void end_step(int level, double h_s) override { servos_.end_step(level, h_s); }
    void at_contact(const double *own, bool) override { servos_.at_contact(own); }
    void end_contact(double *own, bool hard) override { servos_.end_contact(own, hard); }
    void at_instant(const double *own) override { servos_.at_instant(own); }
    double full_scale(int i) const override { return servos_.full_scale(i); }
    void repair() override { servos_.repair(); }

  protected:
    Servos servos_;
};

}  // namespace hil::sim
