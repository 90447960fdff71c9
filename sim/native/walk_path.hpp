// Closed walking path, evaluated from its tables: distance along the path at a time, and position at a distance.
//
// Equations and tables: sim/scene/maps/walk_path.py. tests/reference/walker_reference.py is a Python version with the
// same bits. No allocation after construction.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace hil::sim {

inline double smoothstep(double u) { return u * u * u * (10.0 + u * (6.0 * u - 15.0)); }
inline double smoothstep_slope(double u) { return 30.0 * u * u * (1.0 - u) * (1.0 - u); }

// Part of the lap in which the speed is constant or changes once.
struct WalkPiece {
    double start_s, duration_s, start_m, speed_before_mps, speed_after_mps;
};

// Straight from (x, y) in the direction (cos, sin).
struct WalkStraight {
    double start_m, x_m, y_m, cos, sin;
};

inline constexpr int kCornerPieces = 16;

struct WalkCorner {
    double start_m, length_m, heading_rad, turn_rad;
    std::array<std::array<double, 6>, kCornerPieces + 1> knots;  // x, y [m], and their first and second derivatives by s
};

struct WalkProgress {
    std::int64_t laps;
    double s_m, speed_mps;  // into the lap
};

struct WalkPlace {
    double x_m, y_m, cos, sin, dx_ds, dy_ds, yaw_per_m;

    // Cosine and sine of half the heading, without trigonometry. At cos = -1 the sign is arbitrary, because both
    // quaternions are the same attitude.
    std::pair<double, double> half_heading() const;
};

class WalkPath {
public:
    // Straight i ends where corner i begins; both are sorted by start position, pieces by start time. At t = 0 the lap
    // is `offset_s` old. Throws std::invalid_argument for an empty table, different numbers of corners and straights,
    // or times that are not finite.
    WalkPath(std::vector<WalkPiece> pieces, std::vector<WalkStraight> straights, std::vector<WalkCorner> corners,
             double lap_s, double offset_s);

    WalkProgress progress(std::int64_t t_ns) const;
    WalkPlace place(double s_m) const;

private:
    std::vector<WalkPiece> pieces_;
    std::vector<WalkStraight> straights_;
    std::vector<WalkCorner> corners_;
    double lap_s_, offset_s_;
};

}  // namespace hil::sim
