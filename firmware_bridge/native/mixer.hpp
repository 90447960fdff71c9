// Control allocation: normalised torque and thrust -> motor commands, for 3..8 rotors.
//
// Effectiveness of rotor i with position p, axis a (normalised) and relative thrust coefficient c = CT / greatest CT, per
// thrust T_i of the strongest rotor (FRD, thrust along -z), as PX4 computes it:
//     [roll, pitch, yaw] += c (p x a - km a) T_i,   thrust += -c a_z T_i
// An upright rotor has a = (0, 0, -1): [-py, px, km, 1]. Forces across z are not controlled.
// A rotor that points ahead more than up (the pusher of a VTOL) is left out: its command stays 0, as PX4's standard VTOL.
// The allocation is the pseudo-inverse B^T (B B^T)^-1, its columns scaled as PX4 scales them: roll and pitch by one
// factor so that a symmetric quad has +-sqrt(1/2), yaw to a largest entry of 1, thrust to a mean of 1. So the inputs
// are fractions: thrust in [0, 1], torques in about [-1, 1].
//
// Saturation, airmode off. Let r_i be the part of roll and pitch, T_min the idle thrust:
//     1. roll and pitch are scaled down only if max r - min r exceeds the whole range 1 - T_min;
//     2. thrust is lowered until thrust + max r <= 1 (roll and pitch win over thrust);
//     3. if thrust + min r < T_min, roll and pitch are scaled down (thrust is never raised for them);
//     4. yaw gets the remaining range.
// Motor command u from thrust T by the inverse of T = f u^2 + (1 - f) u, f = THR_MDL_FAC.
//
// No allocation; arguments may alias; + - * / sqrt only, Gauss elimination with pivoting in fixed order.
#pragma once

#include <array>

#include "params.hpp"

namespace hil::flight {

// Share of the demand that the mixer produced; 1 is all of it.
struct Saturation {
    double roll_pitch = 1.0, yaw = 1.0;
    double thrust_excess = 0.0;  // demanded minus produced, > 0 when thrust was lowered
};

class Mixer {
   public:
    // False, and unchanged, if the geometry cannot produce all three torques and thrust.
    bool configure(const Params &params);

    // u_out[0..kMaxRotors): motor commands 0..1, zero beyond the rotor count.
    Saturation allocate(double roll, double pitch, double yaw, double thrust, double *u_out) const;

    double motor_command(double thrust_fraction) const;
    int rotor_count() const { return count_; }
    bool lifts(int rotor) const { return lifts_[rotor]; }
    double idle_command() const { return idle_command_; }
    // Normalised allocation, entry (rotor, axis), axes roll, pitch, yaw, thrust.
    double entry(int rotor, int axis) const { return mix_[rotor][axis]; }

   private:
    int count_ = 0;
    bool lifts_[kMaxRotors] = {};
    double mix_[kMaxRotors][4] = {};
    double curve_ = 1.0, idle_command_ = 0.0, idle_thrust_ = 0.0;
};

}  // namespace hil::flight
