// The actors of a geometry: posed at a time, with the geoms on their bodies, and only where they matter.
//
//     T_WG(t) = T_WB(t) T_BG
//
// Not for two threads at a time. The geometry must outlive this.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "../actor.hpp"
#include "geometry.hpp"
#include "reach.hpp"

namespace hil::sim::frame {

// A geom that sits on an actor's body.
struct BodyGeom {
    int geom, body;
    double p_BG[3], R_BG[9];  // row-major
};

class Actors {
public:
    explicit Actors(Geometry &geometry) : geometry_(geometry) {}

    // std::invalid_argument for a geom that stands still or does not exist, and for a body that the actor has not.
    void add(std::shared_ptr<const Actor> actor, std::vector<BodyGeom> geoms);

    // Poses those that are not yet where they are at `t_ns`; returns how many. Those that `reach` misses are hidden
    // instead, until they are brought.
    int pose_within(std::int64_t t_ns, const Reach *reach);

    // How many are not where they are at `t_ns`.
    int absent(std::int64_t t_ns) const;

private:
    struct Member {
        std::shared_ptr<const Actor> actor;
        std::vector<BodyGeom> geoms;
        std::optional<std::int64_t> posed_ns;  // none: hidden, or never posed
    };

    void move(const Member &member, std::int64_t t_ns);

    Geometry &geometry_;
    std::vector<Member> members_;
    std::vector<double> p_WB_, q_WB_, v_WB_W_, w_WB_W_;  // of the actor at hand
};

}  // namespace hil::sim::frame
