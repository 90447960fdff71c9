#include "road_vehicle.hpp"

#include <cmath>
#include <utility>

#include "detmath.hpp"

namespace hil::sim {

RoadVehicle::RoadVehicle(WalkPath path, std::vector<RoadWheel> wheels, double ground_m, double bound_z_m,
                         double bound_radius_m)
    : path_(std::move(path)),
      wheels_(std::move(wheels)),
      ground_m_(ground_m),
      bound_z_m_(bound_z_m),
      bound_radius_m_(bound_radius_m) {}

Sphere RoadVehicle::bound(std::int64_t t_ns) const {
    const WalkPlace place = path_.place(path_.progress(t_ns).s_m);
    return {{place.x_m, place.y_m, bound_z_m_}, bound_radius_m_};
}

void RoadVehicle::pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const {
    constexpr double kHalfTurn = 3.141592653589793;
    const WalkProgress progress = path_.progress(t_ns);
    const WalkPlace place = path_.place(progress.s_m);
    const double c = place.cos, s = place.sin, speed = progress.speed_mps, yaw_rate = speed * place.yaw_per_m;
    const auto [hc, hs] = place.half_heading();
    for (std::size_t i = 0; i <= wheels_.size(); ++i) {
        double *p = p_WB + 3 * i, *q = q_WB + 4 * i, *v = v_WB_W + 3 * i, *w = w_WB_W + 3 * i;
        double rx = 0.0, ry = 0.0, rz = 0.0, ahead = 0.0, climb = 0.0;  // the last two: velocity of a pedal in its circle
        q[0] = hc, q[1] = 0.0, q[2] = 0.0, q[3] = hs;
        w[0] = 0.0, w[1] = 0.0, w[2] = yaw_rate;
        if (i > 0) {
            auto [x, y, z, turns_per_m, arm] = wheels_[i - 1];
            const double turns = progress.s_m * turns_per_m, half_spin = kHalfTurn * (turns - std::floor(turns));
            const double tc = det::cos(half_spin), ts = det::sin(half_spin), spin = 2.0 * kHalfTurn * turns_per_m * speed;
            if (arm == 0.0) {
                q[0] = hc * tc, q[1] = -hs * ts, q[2] = hc * ts, q[3] = hs * tc;
                w[0] = -s * spin, w[1] = c * spin;
            } else {
                const double px = arm * (tc * tc - ts * ts), pz = -2.0 * arm * tc * ts;
                x += px, z += pz, ahead = spin * pz, climb = -spin * px;
            }
            rx = c * x - s * y, ry = s * x + c * y, rz = z;
        }
        p[0] = place.x_m + rx, p[1] = place.y_m + ry, p[2] = ground_m_ + rz;
        v[0] = speed * place.dx_ds - yaw_rate * ry + c * ahead;
        v[1] = speed * place.dy_ds + yaw_rate * rx + s * ahead;
        v[2] = climb;
    }
}

}  // namespace hil::sim
