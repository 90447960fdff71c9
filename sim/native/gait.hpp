// A walking person's limbs: the step cycle of sim/scene/maps/gait.py, carried along as sim/scene/maps/walker.py says.
//
// The equations stand there; here they are evaluated in the same order, so that both give the same bits
// (tests/reference/walker_reference.py). No allocation; arrays are the caller's.
#pragma once

#include <array>
#include <cstdint>

#include "actor.hpp"
#include "walk_path.hpp"

namespace hil::sim {

inline constexpr int kLimbs = 15;
inline constexpr int kLimbValues = 12;  // x, y, z, cos and sin of half the pitch and of half the yaw, derivatives

using LimbRows = std::array<std::array<double, kLimbValues>, kLimbs>;

// Lengths [m] of the figure and what follows from its speed; names as in sim/scene/maps/gait.py.
struct GaitShape {
    double thigh, shank, ankle, heel, ball, hip_half, shoulder_half, shoulder_above_hip, head_above_hip,
        torso_above_hip, upper_arm, forearm, hand;
    double cycle, stance, bob, arm_rad, lift, ahead, swing_from_x, swing_from_z, swing_to_x, swing_to_z, hip;
};

// All limbs at `phase` in [0, 1), by the walker's own frame H; derivatives by phase.
void gait_rows(const GaitShape &shape, double phase, LimbRows &rows);

// One walker: a step cycle carried along a path. Its bodies are its limbs.
class Walker : public Actor {
public:
    // `bound_z_m`, `bound_radius_m`: of the sphere that holds all limbs; its middle is above the pelvis's path.
    Walker(const GaitShape &shape, WalkPath path, double cycles_per_m, double ground_m, double bound_z_m,
           double bound_radius_m);

    std::size_t bodies() const override { return kLimbs; }
    Sphere bound(std::int64_t t_ns) const override;

    // Of the step cycle, [0, 1).
    double phase(std::int64_t t_ns) const;

    void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const override;

private:
    double phase_at(double s_m) const;

    GaitShape shape_;
    WalkPath path_;
    double cycles_per_m_, ground_m_, bound_z_m_, bound_radius_m_;
};

}  // namespace hil::sim
