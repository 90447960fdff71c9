// Moving object whose poses are a pure function of time. Contract: `Actor` in sim/scene/scene_map.py.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim {

struct Sphere {
    double centre_W[3], radius_m;
};

class Actor {
public:
    virtual ~Actor() = default;
    virtual std::size_t bodies() const = 0;

    // Sphere that encloses the actor.
    virtual Sphere bound(std::int64_t t_ns) const = 0;

    // Poses and velocities of all bodies in W: (bodies, 3), (bodies, 4) w-x-y-z, (bodies, 3), (bodies, 3).
    virtual void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const = 0;
};

}  // namespace hil::sim
