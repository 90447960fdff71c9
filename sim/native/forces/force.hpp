// What acts on a body: a list of these, of which the body knows none by name.
//
// A kind of force is one class below Force in a file of this folder, with its equation, and its binding (force_binding.hpp);
// sim/physics/forces/ holds the model of its parameters under the same name. One object stands for all places of its
// kind on a body (all rotors, all wheels), so that places may act on each other.
//
// Commands and own states. A force may take commands, held over a tick, and have states of its own (a rotor's speed),
// which follow those of the body in `truth`. It advances them itself, in closed form for constant commands: body and
// forces are then consistent at every stage of the integrator, and a lag does not reduce the order of the body.
//
// Integrated quantities. What has no closed form (work, a speed that depends on the flow) is integrated with the body, by
// the same method: a force names how many such values it has, and their rates at each stage after `add`.
//
// One tick of free flight, in this order:
//   command        latches the commands of the tick
//   begin_tick     reads the own states
//   step_rate, damping_per_s, longest_step   bound the steps
//   for each step: at (each stage), set_integrated, add, rates; then end_step, set_integrated
//   longest_step_by_rates  between the first stage of a step and the others
//   end_tick       writes the own states
// A contact sub-step: at_contact, add, end_contact.
//
// Determinism: + - * / sqrt and detmath.hpp only, fixed order. No allocation after `prepare`. An object belongs to one
// body and holds what `at` computed until the next `at`.
#pragma once

#include <cmath>

#include "step_times.hpp"

namespace hil::sim {

inline constexpr int kPoseVelocity = 13;  // p_WB[3], q_WB[4], v_WB_W[3], w_WB_B[3]: the states of the body
inline constexpr int kP = 0, kQ = 3, kV = 7, kW = 10;

// Of all forces of a body: speeds and angles of 8 rotors, and the charge of each of up to 8 sets of them.
inline constexpr int kMostIntegrals = 24;

struct Jet;
struct Slipstreams;

// Body at one instant.
struct Instant {
    const double *s;  // p, q, v, w
    double R[9];      // R(q_WB), row-major
    double air_B[3];  // velocity through the air [m/s]
    double density_ratio;  // of the air, over 1.225 kg/m3
    Slipstreams *slipstreams = nullptr;  // of the forces before this one; null where no force asks for them
};

struct Wrench {
    double force_B[3];   // without gravity and contact
    double torque_B[3];  // about the centre of mass, without w x (I w)
};

struct Inertia {
    double mass_kg;
    double moments_kgm2[3];
    bool skewed = false;    // the axes of B are not the principal axes; else the tensors below are not read
    double tensor_kgm2[9] = {};
    double inverse[9] = {};
    double least_principal_kgm2 = 0.0;

    double least_kgm2() const {
        if (skewed) return least_principal_kgm2;
        const double *I = moments_kgm2;
        const double xy = I[0] < I[1] ? I[0] : I[1];
        return I[2] < xy ? I[2] : xy;
    }
};

// Velocity of the vehicle through the air, in B.
inline void air_velocity(const double R[9], const double *s, const double *wind_W, double air[3]) {
    const double dv[3] = {s[kV] - wind_W[0], s[kV + 1] - wind_W[1], s[kV + 2] - wind_W[2]};
    air[0] = R[0] * dv[0] + R[3] * dv[1] + R[6] * dv[2];
    air[1] = R[1] * dv[0] + R[4] * dv[1] + R[7] * dv[2];
    air[2] = R[2] * dv[0] + R[5] * dv[1] + R[8] * dv[2];
}

// Velocity through the air of the point `r` of the body, in B: air + w x r.
inline void point_velocity(const double air[3], const double *w, const double *r, double u[3]) {
    u[0] = air[0] + (w[1] * r[2] - w[2] * r[1]);
    u[1] = air[1] + (w[2] * r[0] - w[0] * r[2]);
    u[2] = air[2] + (w[0] * r[1] - w[1] * r[0]);
}

// Rate at which the flow turns in a body that turns with w, in steady flight: that part of w which is across the flow [rad/s].
// A roll about the flow turns nothing. V = |air| > 0.
inline double turn_across(const double *w, const double air[3], double V) {
    const double x = w[1] * air[2] - w[2] * air[1], y = w[2] * air[0] - w[0] * air[2], z = w[0] * air[1] - w[1] * air[0];
    return std::sqrt((x * x + y * y) + z * z) / V;
}

class Force {
  public:
    virtual ~Force() = default;

    virtual int commands() const { return 0; }
    virtual int states() const { return 0; }

    // Once, before the first tick.
    virtual void prepare(const StepTimes &, const Inertia &) {}

    // A command is 0..1, or -1..1 if it is signed (a control surface).
    virtual bool is_signed(int /*command*/) const { return false; }

    // Latches commands [commands()], saturated. `voltage` = V / V_nominal of the battery, 1 without one. Returns -1,
    // or the index of the first value that is not finite.
    virtual int command(const double * /*control*/, double /*voltage*/) { return -1; }

    // Own states at which they come to rest under the latched commands.
    virtual void settle(double * /*own*/) const {}

    virtual void begin_tick(const double * /*own*/) {}
    // Values that the integrator advances with the body; `integrated` writes them at the start of a tick.
    virtual int integrals() const { return 0; }
    virtual void integrated(double * /*values*/) const {}
    virtual void set_integrated(const double * /*values*/) {}
    // Their rates by the last `add`.
    virtual void rates(double * /*values*/) const {}
    virtual void end_tick(double * /*own*/) {}

    // Greatest rate of the force's own change in this tick [1/s]: a step is no longer than its inverse.
    virtual double step_rate_per_s(bool /*classical*/) const { return 0.0; }
    // Part of lambda, the fastest damping or gyroscopic rate of the body's motion at this airspeed [1/s].
    virtual double damping_per_s(double /*airspeed_mps*/) const { return 0.0; }
    // Longest step from here, at most `longest_s`. `s`: p, q, v, w. Not asked for by the classical method.
    virtual double longest_step(const double * /*s*/, const double * /*wind_W*/, double longest_s) const {
        return longest_s;
    }

    // Longest step by the rates of p, q, v, w at its start, where the forces were added just now. Asked of bodies with
    // slipstreams only, and not for the classical method.
    virtual double longest_step_by_rates(const double * /*s*/, const double * /*ds*/, double longest_s) const {
        return longest_s;
    }

    // Time from these own states to the next corner of their motion under the latched commands, where its slope or that of its
    // rate jumps [s]; 0: none. A tick ends a part there. Not asked for by the classical method.
    virtual double corner_s(const double * /*own*/) const { return 0.0; }

    // Own states `t_s` after the start of the step, which is a node of steps of this level.
    virtual void at(int /*level*/, int /*node*/, double /*t_s*/) {}
    // Adds the wrench that the own states of the last `at` or `at_contact` make.
    virtual void add(const Instant &, Wrench &) const = 0;
    virtual void end_step(int /*level*/, double /*h_s*/) {}

    // Own states at the start of a contact sub-step, with their mean rates over it.
    virtual void at_contact(const double * /*own*/, bool /*hard*/) {}
    virtual void end_contact(double * /*own*/, bool /*hard*/) {}
    // Own states with their rates at one instant.
    virtual void at_instant(const double * /*own*/) {}
    // Puts what this force moves of others where these own states have it, at rest: before power_w and jet.
    virtual void pose(const double * /*own*/) {}

    // Mechanical power now [W], and work over a tick that began at these own states [J]: what a battery must deliver.
    virtual double power_w(const Instant &, const double * /*own*/) { return 0.0; }
    virtual double work_j(const double * /*own_before*/) const { return 0.0; }

    // Current that the force takes from a battery at its own states with these commands [A], at `voltage` as in `command`;
    // adds its derivative by `voltage` to `per_share_a`. Only for a force that is `electric`, whose work counts nothing.
    virtual bool electric() const { return false; }
    virtual double supply_a(const double * /*control*/, const double * /*own*/, double /*voltage*/,
                            double & /*per_share_a*/) const {
        return 0.0;
    }
    // Charge that it took since `begin_tick` [C].
    virtual double charge_c() const { return 0.0; }

    // True if the force needs the slipstreams of the rotors of its body: slipstream.hpp.
    virtual bool feels_slipstreams() const { return false; }

    // Wake that other vehicles feel. `s`: p, q, v, w. Returns false without one.
    virtual bool jet(const double * /*s*/, const double * /*own*/, const double * /*wind_W*/, Jet &) const {
        return false;
    }

    // Value of own state `i` that counts as full, for observations.
    virtual double full_scale(int /*i*/) const { return 1.0; }

    // Returns to the condition of a new object: no faults.
    virtual void repair() {}

    bool attached = false;  // to a body
};

}  // namespace hil::sim
