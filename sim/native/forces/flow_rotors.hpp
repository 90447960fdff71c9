// Rotors whose torque depends on the flow: their work has no closed form and is integrated with the body.
//
// A model computes the loads of all rotors at their speeds in `evaluate`, adds them to the body in `assemble`, and writes
// the shaft power of the last `evaluate` to `power_w_`. `assemble` takes the rates of the speeds from `accel_`.
#pragma once

#include "rotors.hpp"

namespace hil::sim {

class FlowRotors : public Rotors {
  public:
    using Rotors::Rotors;

    virtual void evaluate(const Instant &now) const = 0;
    virtual void assemble(const Instant &now, Wrench &out) const = 0;

    void begin_tick(const double *own) override {
        Rotors::begin_tick(own);
        work_j_ = 0.0;
        in_contact_ = false;
    }
    int integrals() const override { return 1; }
    void integrated(double *values) const override { values[0] = work_j_; }
    void set_integrated(const double *values) override { work_j_ = values[0]; }
    void rates(double *values) const override { values[0] = power_w_; }
    void add(const Instant &now, Wrench &out) const override {
        evaluate(now);
        assemble(now, out);
    }
    void at_contact(const double *own, bool hard) override {
        Rotors::at_contact(own, hard);
        if (!in_contact_) work_j_ = 0.0;  // of the free flight that contact replaces
        in_contact_ = true;
    }
    void end_contact(double *own, bool hard) override {
        work_j_ += power_w_ * contact_s_[hard];
        Rotors::end_contact(own, hard);
    }
    double power_w(const Instant &now, const double *own) override {
        for (int i = 0; i < p_.count; ++i) speed_[i] = own[i];
        evaluate(now);
        return power_w_ > 0.0 ? power_w_ : 0.0;
    }
    double work_j(const double *) const override { return work_j_; }

  protected:
    mutable double power_w_ = 0.0;
    double work_j_ = 0.0;  // since the start of the tick
    bool in_contact_ = false;
};

}  // namespace hil::sim
