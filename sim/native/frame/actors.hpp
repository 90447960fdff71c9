// Actors of a geometry. Moves the geoms on their bodies to the poses at a time, if they can affect a sensor.
//
//     T_WG(t) = T_WB(t) T_BG
//
// Not thread-safe. The geometry must outlive this object.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "../actor.hpp"
#include "geometry.hpp"
#include "reach.hpp"

namespace hil::sim::frame {

// A geom that is fixed to an actor's body.
struct BodyGeom {
    int geom, body;
    double p_BG[3], R_BG[9];  // row-major
};

class Actors {
public:
    explicit Actors(Geometry &geometry) : geometry_(geometry) {}

    // Throws std::invalid_argument for a geom that is static or does not exist, and for a body that does not exist.
    void add(std::shared_ptr<const Actor> actor, std::vector<BodyGeom> geoms);

    // Leaves out one actor, the number `index` in the order of adding (-1: none): `pose_within` hides it.
    void leave_out(int index) { left_out_ = index; }

    // Hides an actor until it is posed again, for an actor whose poses have changed.
    void hide(int index) { hide(members_.at(static_cast<std::size_t>(index))); }

    // Poses the actors that are not yet posed at `t_ns`; returns their number. Actors that `reach` misses are hidden
    // until a later call poses them. A null `reach` misses none.
    int pose_within(std::int64_t t_ns, const Reach *reach);

    // Number of actors that are not posed at `t_ns`; the actor that is left out counts if it is not hidden.
    int absent(std::int64_t t_ns) const;

private:
    struct Member {
        std::shared_ptr<const Actor> actor;
        std::vector<BodyGeom> geoms;
        std::optional<std::int64_t> posed_ns;  // no value: hidden, or never posed
    };

    void move(const Member &member, std::int64_t t_ns);
    void hide(Member &member);

    Geometry &geometry_;
    std::vector<Member> members_;
    int left_out_ = -1;
    std::vector<double> p_WB_, q_WB_, v_WB_W_, w_WB_W_;  // buffers of `move`
};

}  // namespace hil::sim::frame
