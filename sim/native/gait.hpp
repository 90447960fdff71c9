// A walking person's limbs: the step cycle of sim/scene/maps/gait.py, carried along as sim/scene/maps/walker.py says.
//
// The equations stand there; here they are evaluated in the same order, so that both give the same bits
// (tests/unit/test_gait_kernel.py). No allocation; arrays are the caller's.
#pragma once

#include <array>

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

// Where the walker is and how it moves on: place and heading on its path, their change by metre, speed [m/s].
struct WalkState {
    double x, y, cos, sin, dx_ds, dy_ds, yaw_per_m, speed, cycles_per_m, ground;
};

// All limbs at `phase` in [0, 1), by the walker's own frame H; derivatives by phase.
void gait_rows(const GaitShape &shape, double phase, LimbRows &rows);

// Poses and velocities of all limbs in W: (15, 3), (15, 4) w-x-y-z, (15, 3), (15, 3).
void walker_pose(const GaitShape &shape, double phase, const WalkState &walk, double *p_WB, double *q_WB,
                 double *v_WB_W, double *w_WB_W);

}  // namespace hil::sim
