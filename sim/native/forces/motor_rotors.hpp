// Rotors driven by the motors of motor.hpp: `rotor_constants.motor`. `Model` computes their loads (rotors.hpp,
// blade_rotors.hpp, tunnel_rotors.hpp); the speed follows from voltage and load in place of the first order lag.
//
//   J dO/dt = K I - K I_0 O / (O + O_f) - Q(O, flow)
//
// Own states: speeds. Integrated with the body: speeds, charge drawn from the battery since the start of the tick, and
// the angles of unbalanced rotors.
//
// A rotor with a forced speed O_s (a fault) goes there with the time constants of the lag; its motor takes the current
// that this needs if O_s > 0, and none if it is stuck at rest. One that is not driven (desynchronised) has I = 0: it
// slows down by friction and Q, or turns as a windmill.
//
// Limits of a step, besides those of the model, whose |dO/dt| is twice that of the static torque, and 0.5 g / sqrt(kappa)
// for a fall through the vortex ring state:
//   lambda h <= 0.3            lambda the fastest rate of the speed: back-EMF, friction, aerodynamic torque
//   |dO/dt| h <= 0.3 d         d the distance from O to the poles of friction and current: -O_f, (u V +- i u I_r R) / K
//
// In contact the speeds advance by the exponential Euler method with lambda: first order, as all of contact.
#pragma once

#include <cmath>

#include "blade_rotors.hpp"
#include "detmath.hpp"
#include "motor.hpp"

namespace hil::sim {

template <class Model>
class MotorRotors : public Model {
  public:
    MotorRotors(const Model &rotors, const MotorParams &motor) : Model(rotors), m_(motor) {
        for (bool &driven : driven_) driven = true;
    }

    bool set_driven(int rotor, bool driven) override {
        driven_[rotor] = driven;
        return true;
    }
    void repair() override {
        Model::repair();
        for (bool &driven : driven_) driven = true;
    }

    void prepare(const StepTimes &times, const Inertia &inertia) override {
        Model::prepare(times, inertia);
        const double K = m_.torque_nm_per_a;
        const double slope = 2.0 * p_.moment_ratio_m * p_.thrust_coefficient_n_per_radps2 * p_.max_speed_radps;
        rate_per_s_ = (K * K / m_.resistance_ohm + K * m_.no_load_current_a / kFrictionSpeed_radps + slope) /
                      p_.inertia_kgm2;
        falling_ = p_.air.kappa_m2 > 0.0 ? 0.5 * kFall_mps2 / std::sqrt(p_.air.kappa_m2) : 0.0;
        for (int hard = 0; hard < kContactKinds; ++hard) {
            const double turn = rate_per_s_ * this->contact_s_[hard];
            mean_[hard] = (1.0 - det::exp(-turn)) / turn;
        }
    }

    int command(const double *control, double voltage) override {
        voltage_v_ = voltage * m_.nominal_voltage_v;
        for (int i = 0; i < p_.count; ++i) {
            if (!std::isfinite(control[i])) return i;
            duty_[i] = duty_of(i, control[i]);
        }
        return -1;
    }

    void begin_tick(const double *own) override {
        charge_c_ = 0.0;
        in_contact_ = false;
        this->fastest_ = 0.0;
        for (int i = 0; i < p_.count; ++i) {
            speed_[i] = own[i];
            if (!(this->imbalance_kgm_[i] > 0.0)) continue;
            const double free = duty_[i] * voltage_v_ / m_.torque_nm_per_a;
            const double most = own[i] > free ? own[i] : free;
            this->fastest_ = most > this->fastest_ ? most : this->fastest_;
        }
        start_step();
    }

    void end_tick(double *own) override {
        for (int i = 0; i < p_.count; ++i) {
            own[i] = speed_[i] > 0.0 ? speed_[i] : 0.0;
            const double angle = this->phase_[i];
            this->phase_[i] = angle - 2.0 * det::kPi * std::floor(angle / (2.0 * det::kPi));
        }
    }

    int integrals() const override { return 2 * p_.count + 1; }
    void integrated(double *values) const override {
        for (int i = 0; i < p_.count; ++i) {
            values[i] = speed_[i];
            values[p_.count + 1 + i] = this->phase_[i];
        }
        values[p_.count] = charge_c_;
    }
    void set_integrated(const double *values) override {
        for (int i = 0; i < p_.count; ++i) {
            speed_[i] = values[i];
            if (!this->imbalanced_) continue;
            this->phase_[i] = values[p_.count + 1 + i];
            const double pull = this->imbalance_kgm_[i] * (speed_[i] * speed_[i]);
            this->push_x_[i] = pull * det::cos(this->phase_[i]);
            this->push_y_[i] = pull * det::sin(this->phase_[i]);
        }
        charge_c_ = values[p_.count];
        start_step();
    }
    void rates(double *values) const override {
        for (int i = 0; i < p_.count; ++i) {
            values[i] = this->accel_[i];
            values[p_.count + 1 + i] = this->imbalanced_ ? p_.spin[i] * speed_[i] : 0.0;
        }
        values[p_.count] = battery_a_;
    }

    double step_rate_per_s(bool classical) const override {
        const double lag = Model::step_rate_per_s(true);  // an unbalanced rotor
        double fastest = rate_per_s_;
        for (int i = 0; i < p_.count; ++i) {
            const double tau = std::fmin(p_.time_constant_up_s, p_.time_constant_down_s);
            if (this->forced_speed_radps_[i] >= 0.0 && 1.0 / tau > fastest) fastest = 1.0 / tau;
        }
        fastest /= classical ? 1.0 : kRatePerStep;
        return lag > fastest ? lag : fastest;
    }

    double longest_step(const double *s, const double *wind_W, double longest_s) const override {
        double step = Model::longest_step(s, wind_W, longest_s);
        for (int i = 0; i < p_.count; ++i) {
            const double change = start_rate_[i] * step;
            double distance = speed_[i] + kFrictionSpeed_radps;
            if (!m_.braking && driven(i)) {
                const double K = m_.torque_nm_per_a, off = speed_[i] - duty_[i] * voltage_v_ / K;
                const double blur = duty_[i] * (kConductionShare * m_.nominal_voltage_v / K);
                const double pole = std::sqrt(off * off + blur * blur);
                if (blur > 0.0 && pole < distance) distance = pole;
            }
            if (change > kPolePerStep * distance) step *= kPolePerStep * distance / change;
        }
        return step;
    }

    void at(int, int, double) override {}
    void end_step(int, double) override {}
    void add(const Instant &now, Wrench &out) const override {
        Model::evaluate(now);
        battery_a_ = 0.0;
        for (int i = 0; i < p_.count; ++i) {
            const double torque = Model::torque_nm(i);
            this->accel_[i] = rate_of(i, torque);
            if (in_contact_) this->accel_[i] *= mean_[hard_];
            battery_a_ += battery_current(i, torque);
        }
        Model::assemble(now, out);
    }

    void at_contact(const double *own, bool hard) override {
        for (int i = 0; i < p_.count; ++i) {
            speed_[i] = own[i];
            this->push_x_[i] = this->push_y_[i] = 0.0;  // as for the lag
        }
        if (!in_contact_) charge_c_ = 0.0;  // of the free flight that contact replaces
        in_contact_ = true;
        hard_ = hard;
    }
    void end_contact(double *own, bool hard) override {
        for (int i = 0; i < p_.count; ++i) {
            const double next = own[i] + this->contact_s_[hard] * this->accel_[i];
            own[i] = next > 0.0 ? next : 0.0;
        }
        charge_c_ += battery_a_ * this->contact_s_[hard];
    }
    void at_instant(const double *own) override {
        for (int i = 0; i < p_.count; ++i) {
            speed_[i] = own[i];
            this->push_x_[i] = this->push_y_[i] = 0.0;
        }
        in_contact_ = false;
    }

    double power_w(const Instant &, const double *) override { return 0.0; }
    double work_j(const double *) const override { return 0.0; }
    bool electric() const override { return true; }
    double supply_a(const double *control, const double *own, double voltage, double &per_share_a) const override {
        double sum = 0.0;
        for (int i = 0; i < p_.count; ++i) {
            if (!driven(i)) continue;
            const double duty = duty_of(i, control[i]);
            const MotorCurrent now = motor_current(m_, duty, voltage * m_.nominal_voltage_v, own[i]);
            sum += duty * now.current_a;
            per_share_a += duty * now.per_volt_s * m_.nominal_voltage_v;
        }
        return sum;
    }
    double charge_c() const override { return charge_c_; }

  private:
    using Model::p_;
    using Model::speed_;
    static constexpr double kRatePerStep = 0.3;
    // Of |dO/dt| for the poles of the model, because here the flow acts on the speed as well.
    static constexpr double kHeadroom = 2.0;
    static constexpr double kFall_mps2 = 10.0;  // a change of the flow along the axis by the motion of the body
    static constexpr double kPolePerStep = 0.3;

    bool forced(int i) const { return this->forced_speed_radps_[i] >= 0.0; }
    bool driven(int i) const { return driven_[i] && !forced(i); }
    double duty_of(int i, double control) const {
        if (!driven(i)) return 0.0;
        return control < 0.0 ? 0.0 : (control > 1.0 ? 1.0 : control);
    }

    double rate_of(int i, double torque_nm) const {
        const double speed = speed_[i];
        if (forced(i)) {
            const double ahead = this->forced_speed_radps_[i] - speed;
            return ahead / this->tau_s(ahead > 0.0);
        }
        const double current = driven_[i] ? motor_current(m_, duty_[i], voltage_v_, speed).current_a : 0.0;
        return (m_.torque_nm_per_a * (current - friction_current_a(m_, speed)) - torque_nm) / p_.inertia_kgm2;
    }

    double battery_current(int i, double torque_nm) const {
        if (driven(i)) return duty_[i] * motor_current(m_, duty_[i], voltage_v_, speed_[i]).current_a;
        if (!(this->forced_speed_radps_[i] > 0.0)) return 0.0;
        const double K = m_.torque_nm_per_a;
        const double I = (p_.inertia_kgm2 * this->accel_[i] + torque_nm) / K + friction_current_a(m_, speed_[i]);
        const double power_w = I * (K * speed_[i] + m_.resistance_ohm * I);
        return power_w > 0.0 ? power_w / voltage_v_ : 0.0;
    }

    // What the model's longest_step takes for speed (command_ + lag_) and its rate (rate_ lag_).
    void start_step() {
        for (int i = 0; i < p_.count; ++i) {
            start_rate_[i] = std::fabs(rate_of(i, Rotors::torque_nm(i)));
            const double rate = kHeadroom * start_rate_[i] + falling_;
            this->rate_[i] = 1.0;
            this->lag_[i] = rate;
            this->command_[i] = speed_[i] - rate;
        }
    }

    MotorParams m_;
    bool driven_[kMaxRotors];
    double duty_[kMaxRotors] = {};
    double voltage_v_ = 0.0;
    double start_rate_[kMaxRotors] = {};  // |dO/dt| with the static torque
    double falling_ = 0.0;                // rate of O that moves a rotor as far from the poles as a free fall does
    double rate_per_s_ = 0.0;             // lambda
    double mean_[kContactKinds] = {};  // of a rate over a contact sub-step, over that at its start
    mutable double battery_a_ = 0.0;
    double charge_c_ = 0.0;
    bool in_contact_ = false, hard_ = false;
};

}  // namespace hil::sim
