#include "actors.hpp"

#include <stdexcept>
#include <utility>

namespace hil::sim::frame {

void Actors::add(std::shared_ptr<const Actor> actor, std::vector<BodyGeom> geoms) {
    const std::size_t bodies = actor->bodies();
    for (const BodyGeom &g : geoms) {
        const auto &known = geometry_.geoms();
        if (g.geom < 0 || static_cast<std::size_t>(g.geom) >= known.size() || !known[g.geom].moving) {
            throw std::invalid_argument("an actor's geom must exist and be moving: call add_geom with moving=True");
        }
        if (g.body < 0 || static_cast<std::size_t>(g.body) >= bodies) {
            throw std::invalid_argument("an actor's geom names a body index that the actor does not have");
        }
    }
    if (q_WB_.size() < 4 * bodies) {
        p_WB_.resize(3 * bodies), q_WB_.resize(4 * bodies), v_WB_W_.resize(3 * bodies), w_WB_W_.resize(3 * bodies);
    }
    members_.push_back({std::move(actor), std::move(geoms), std::nullopt});
}

int Actors::pose_within(std::int64_t t_ns, const Reach *reach) {
    int posed = 0;
    for (std::size_t i = 0; i < members_.size(); ++i) {
        Member &member = members_[i];
        if (static_cast<int>(i) == left_out_) {
            hide(member);
            continue;
        }
        if (member.posed_ns == t_ns) {
            continue;
        }
        if (reach == nullptr || !reach->misses(member.actor->bound(t_ns))) {
            move(member, t_ns);
            member.posed_ns = t_ns;
            ++posed;
        } else {
            hide(member);
        }
    }
    return posed;
}

int Actors::absent(std::int64_t t_ns) const {
    int count = 0;
    for (std::size_t i = 0; i < members_.size(); ++i) {
        const auto &posed_ns = members_[i].posed_ns;
        count += static_cast<int>(i) == left_out_ ? posed_ns.has_value() : posed_ns != t_ns;
    }
    return count;
}

void Actors::hide(Member &member) {
    if (!member.posed_ns) return;
    for (const BodyGeom &g : member.geoms) geometry_.hide(g.geom);
    member.posed_ns.reset();
}

void Actors::move(const Member &member, std::int64_t t_ns) {
    member.actor->pose(t_ns, p_WB_.data(), q_WB_.data(), v_WB_W_.data(), w_WB_W_.data());
    for (const BodyGeom &geom : member.geoms) {
        const double *q = q_WB_.data() + 4 * geom.body, *p_WB = p_WB_.data() + 3 * geom.body;
        const double *v = v_WB_W_.data() + 3 * geom.body, *w = w_WB_W_.data() + 3 * geom.body;
        const double a = q[0], b = q[1], c = q[2], d = q[3];
        const double R[9] = {a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c),
                             2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b),
                             2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d};
        double p_WG[3], R_WG[9], arm_W[3], v_WG_W[3];
        for (int r = 0; r < 3; ++r) {
            arm_W[r] = R[3 * r] * geom.p_BG[0] + R[3 * r + 1] * geom.p_BG[1] + R[3 * r + 2] * geom.p_BG[2];
            p_WG[r] = p_WB[r] + arm_W[r];
            for (int k = 0; k < 3; ++k) {
                R_WG[3 * r + k] =
                    R[3 * r] * geom.R_BG[k] + R[3 * r + 1] * geom.R_BG[3 + k] + R[3 * r + 2] * geom.R_BG[6 + k];
            }
        }
        for (int r = 0; r < 3; ++r) {
            const int j = (r + 1) % 3, k = (r + 2) % 3;
            v_WG_W[r] = v[r] + w[j] * arm_W[k] - w[k] * arm_W[j];
        }
        geometry_.move(geom.geom, p_WG, R_WG, v_WG_W, w);
    }
}

}  // namespace hil::sim::frame
