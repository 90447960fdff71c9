// Vehicle whose states are given from outside, tick by tick, as an actor. Body 0 is the airframe B, body 1 + i rotor i.
//
// At t it has the last state that is not later than t (the first one if all are later), moved on by s = t - t_state
// with constant velocities:
//
//     p + v s        q exp(w s)        angle + spin O s
//
// A rotor's angle is the integral of its speed O over the states, by the trapezoidal rule, and 0 at the first one.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "actor.hpp"
#include "rotation.hpp"

namespace hil::sim {

struct RotorMount {
    Vec3 p_BR;
    Quat q_BR;    // of the rotor at angle 0; its z axis is the axis of rotation
    double spin;  // +1: counter-clockwise about z
};

struct PlacedState {
    std::int64_t t_ns;
    Vec3 p_WB;
    Quat q_WB;
    Vec3 v_WB_W, w_WB_B;
    std::vector<double> speed_radps, angle_rad;  // of each rotor
};

class PlacedVehicle : public Actor {
public:
    // `radius_m`: of a sphere around the origin of B that encloses the vehicle.
    PlacedVehicle(std::vector<RotorMount> rotors, double radius_m);

    // Adds a state; its angles are filled in here. A time that is not later than the last one begins anew. States of
    // the last kHistoryNs are kept. Throws std::invalid_argument for another number of rotors.
    void place(PlacedState state);

    // The states from the one in force at t on, with their angles; each is 14 + 2 `rotors` numbers of 8 bytes.
    std::vector<std::uint8_t> states_since(std::int64_t t_ns) const;

    // Replaces all states by those of a `states_since` of an equal vehicle. Throws std::invalid_argument for another
    // length.
    void restore(const std::uint8_t *data, std::size_t size);

    std::size_t bodies() const override { return 1 + rotors_.size(); }
    Sphere bound(std::int64_t t_ns) const override;

    // Before the first `place` the vehicle is outside the world, where nothing is shown.
    void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const override;

private:
    static constexpr std::int64_t kHistoryNs = 1'000'000'000;  // of the longest sweep of a LiDAR

    const PlacedState *at(std::int64_t t_ns) const;

    std::vector<RotorMount> rotors_;
    double radius_m_;
    std::deque<PlacedState> states_;
};

}  // namespace hil::sim
