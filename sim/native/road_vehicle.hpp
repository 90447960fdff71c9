// Road vehicle that follows a closed path, with wheels that roll without slip on straights.
//
// Bodies: the chassis, then the wheels. With the path's place o(s), heading psi and speed v,
//
//     p_i = o + R_z(psi) r_i         v_i = v do/ds + psi' x R_z(psi) r_i         q_i = q_z(psi) q_y(theta)
//
// r_i the wheel's centre in the vehicle, theta = s / radius, rounded so that a lap has a whole number of turns, and
// psi' = v dpsi/ds. The wheels do not steer. The pedals of a bicycle go round their axle r_i at the radius a_i and stay
// level: p_i = o + R_z(psi) (r_i + R_y(theta) (a_i, 0, 0)), q_i = q_z(psi).
#pragma once

#include <vector>

#include "actor.hpp"
#include "walk_path.hpp"

namespace hil::sim {

struct RoadWheel {
    double x, y, z, turns_per_m, arm;  // centre in the vehicle [m]; `arm`: a_i of a pedal [m], 0 of a wheel
};

class RoadVehicle : public Actor {
public:
    // `ground_m`: height of the road. `bound_z_m`, `bound_radius_m`: height and radius of a sphere around everything,
    // centred above the path.
    RoadVehicle(WalkPath path, std::vector<RoadWheel> wheels, double ground_m, double bound_z_m, double bound_radius_m);

    std::size_t bodies() const override { return 1 + wheels_.size(); }
    Sphere bound(std::int64_t t_ns) const override;
    void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const override;

private:
    WalkPath path_;
    std::vector<RoadWheel> wheels_;
    double ground_m_, bound_z_m_, bound_radius_m_;
};

}  // namespace hil::sim
