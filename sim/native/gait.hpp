// Limbs of a walking person as poses over the phase of the step cycle; sim/scene/maps/walker.py has the path equations.
//
// Frame H follows the walker: x along its heading, y left, z up, origin on the ground below the pelvis. Poses in H are
// functions of the phase phi = s / L alone, with s the distance walked and L the length of a cycle (two steps), so
// speed only scales time. After Boulic, Magnenat-Thalmann & Thalmann, "A global human walking model with real-time
// kinematic personification", The Visual Computer 6 (1990), with v' = speed / leg length:
//
//     cycle L = 1.346 sqrt(v') leg        stance share = 0.752 - 0.143 / T, T = L / speed
//     pelvis  z = z_0 + 0.015 v' leg sin(4 pi phi - 0.7 pi)        arm swing 9.88 v' degrees
//
// With their tables of joint angles the feet slide by centimetres. Here the path of the foot is given: in stance it
// rolls over heel, sole and ball, each at rest on the ground (in H: moving at -s'); in swing it follows a polynomial.
// Hip and knee angles follow by two-link inverse kinematics. Foot pitch and path have continuous second derivatives.
//
// Angles are about y, positive turns z towards x. Each limb is a row (x, y, z, cos theta/2, sin theta/2, cos yaw/2,
// sin yaw/2, dx, dy, dz, dtheta, dyaw) with derivatives by phi; rotation R = Rz(yaw) Ry(theta). No allocation; arrays
// are the caller's.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "actor.hpp"
#include "walk_path.hpp"

namespace hil::sim {

inline constexpr int kLimbs = 15;
inline constexpr int kLimbValues = 12;  // x, y, z, cos and sin of half the pitch and of half the yaw, derivatives

using LimbRow = std::array<double, kLimbValues>;
using LimbRows = std::array<LimbRow, kLimbs>;

// Lengths [m] of a person, in the order of sim/scene/maps/figure.py's `lengths_m`.
struct FigureLengths {
    double thigh, shank, ankle, heel, ball, hip_half, shoulder_half, shoulder_above_hip, head_above_hip,
        torso_above_hip, upper_arm, forearm, hand, height;
};

// A figure with the values that follow from its speed: lengths [m], angles [rad], `stance` a share of the cycle.
struct GaitShape : FigureLengths {
    double cycle, stance, bob, arm_rad, lift, ahead, swing_from_x, swing_from_z, swing_to_x, swing_to_z, hip;
};

// Fits the steps of a figure at a cruising speed; `cycle_m` should be near the natural length. The distance at which a
// foot lands ahead of the hip is chosen for the highest pelvis, so that knees are straightest. Throws
// std::invalid_argument if the legs are too short for the steps.
GaitShape fit_gait(const FigureLengths &figure, double speed_mps, double cycle_m);

// Writes the rows of all limbs in frame H at `phase` in [0, 1), in the order of LIMBS in sim/scene/maps/figure.py. The
// left foot strikes at phase 0. Derivatives are by phase.
void gait_rows(const GaitShape &shape, double phase, LimbRows &rows);

// Thigh, shank and foot of a person at rest with flat feet: hip at (0, y, hip_z), ankle at (ankle_x, y, ankle_z).
void resting_leg(const FigureLengths &figure, double y, double hip_z, double ankle_x, double ankle_z, LimbRow *rows);

// Upper arm, forearm and hand of a person at rest: shoulder at (0, y, z), pitch of upper arm and forearm [rad].
void resting_arm(const FigureLengths &figure, double y, double z, double upper_rad, double fore_rad, LimbRow *rows);

// Legs on the pedals of a bicycle. The feet stay at the angle `foot_rad`, and each ankle is at rest relative to its
// pedal, so it goes round the point (axle_x, axle_z) at the radius `crank`, once in a cycle:
//
//     ankle = axle + crank (cos theta, -sin theta),   theta = 2 pi phi on the left, half a turn later on the right
struct Pedalling : FigureLengths {
    double hip_x, hip_z, half_width, axle_x, axle_z, crank, foot_rad;
};

// Writes thigh, shank and foot of the left leg, then of the right one.
void pedalling_legs(const Pedalling &legs, double phase, LimbRow *rows);

// Walker: a step cycle along a path. Its bodies are its limbs.
class Walker : public Actor {
public:
    // `bound_z_m`, `bound_radius_m`: height and radius of a sphere around all limbs, centred above the path.
    Walker(const GaitShape &shape, WalkPath path, double cycles_per_m, double ground_m, double bound_z_m,
           double bound_radius_m);

    // A person on wheels: in frame H the limbs stay as `seated` has them.
    Walker(const LimbRows &seated, WalkPath path, double ground_m, double bound_z_m, double bound_radius_m);

    // A cyclist: all but the legs as `seated` has them. Throws std::invalid_argument for legs that do not reach.
    Walker(const LimbRows &seated, const Pedalling &legs, WalkPath path, double cycles_per_m, double ground_m,
           double bound_z_m, double bound_radius_m);

    std::size_t bodies() const override { return kLimbs; }
    Sphere bound(std::int64_t t_ns) const override;

    // Phase of the step cycle or of the cranks, [0, 1).
    double phase(std::int64_t t_ns) const;

    void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const override;

private:
    double phase_at(double s_m) const;

    GaitShape shape_{};
    std::optional<LimbRows> seated_;
    std::optional<Pedalling> legs_;
    WalkPath path_;
    double cycles_per_m_, ground_m_, bound_z_m_, bound_radius_m_;
};

}  // namespace hil::sim
